// Searches among balls, linear and in slices, against brute force.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <utility>
#include <vector>

#include "random.hpp"
#include "trace/near_balls.hpp"

namespace flockstep::trace {
namespace {

using testing::Random;

struct SomeBalls {
  std::vector<float> centers, radii;

  std::size_t count() const { return radii.size(); }
  Balls view() const { return {centers.data(), radii.data(), count()}; }
  Vec3 center(std::size_t i) const { return Vec3::Map(centers.data() + 3 * i); }

  // The distance of two balls over the sum of their radii, in double precision.
  static double nearness(const Vec3& a, const Vec3& b, float radii) {
    return (a.cast<double>() - b.cast<double>()).norm() / static_cast<double>(radii);
  }
};

SomeBalls any_balls(Random& random, std::size_t count) {
  SomeBalls balls;
  const Vec3 spread(std::exp(random.within(-5, 5)), std::exp(random.within(-5, 5)), std::exp(random.within(-5, 5)));
  const Vec3 middle = random.point(random.generator()() % 4 == 0 ? 10000.0F : 10.0F);
  const float largest = std::exp(random.within(-4, 1));
  const bool is_even = random.generator()() % 4 == 0;  // many balls have equal coordinates
  for (std::size_t i = 0; i < count; ++i) {
    Vec3 center = middle + spread.cwiseProduct(random.point(1.0F));
    if (is_even) center = center.array().round();
    if (random.generator()() % 200 == 0) center += Vec3(5000, 0, 0);
    balls.centers.insert(balls.centers.end(), {center.x(), center.y(), center.z()});
    balls.radii.push_back(random.generator()() % 10 == 0 ? -1.0F : random.within(0, largest));
  }
  return balls;
}

TEST(NearBalls, ALinearSearchFindsTheBallsOfBruteForce) {
  Random random(3);
  std::size_t found_in_all = 0;
  for (int round = 0; round < 2000; ++round) {
    const SomeBalls balls = any_balls(random, static_cast<std::size_t>(round % 41));  // the arrays end with the last ball
    const Vec3 origin = balls.count() == 0 ? Vec3(Vec3::Zero()) : balls.center(random.generator()() % balls.count());
    const float range = std::exp(random.within(-4, 4));
    std::vector<std::uint32_t> found(balls.count());
    found.resize(find_near_balls(balls.view(), origin, range, found.data()));
    ASSERT_EQ(std::ranges::adjacent_find(found, std::greater_equal{}), found.end());
    for (std::size_t i = 0; i < balls.count(); ++i) {
      const double nearness = SomeBalls::nearness(balls.center(i), origin, balls.radii[i] + range);
      const bool is_found = std::ranges::binary_search(found, i);
      if (balls.radii[i] < 0.0F || nearness > 1.0 + 3e-5) {
        EXPECT_FALSE(is_found) << "ball " << i << " of " << balls.count();
      } else if (nearness <= 1.0) {
        EXPECT_TRUE(is_found) << "ball " << i << " of " << balls.count();
      }
    }
    found_in_all += found.size();
  }
  EXPECT_GT(found_in_all, 10'000U);
}

TEST(BallSlices, ASearchFindsTheBallsThatALinearSearchFinds) {
  Random random(1);
  std::size_t found_in_all = 0;
  BallSlices slices;
  for (int round = 0; round < 400; ++round) {
    const std::size_t count = std::array<std::size_t, 8>{0, 1, 7, 32, 33, 100, 1000, 4096}[random.generator()() % 8];
    const SomeBalls balls = any_balls(random, count);
    slices.sort(balls.view());
    std::vector<std::uint32_t> expected(count), found(count);
    for (int search = 0; search < 20; ++search) {
      const bool is_at_ball = count > 0 && random.generator()() % 2 == 0;
      const Vec3 origin = (is_at_ball ? balls.center(random.generator()() % count) : Vec3(Vec3::Zero())) +
                          random.point(is_at_ball ? 1.0F : 20.0F);
      const float range = std::exp(random.within(-4, 4));
      expected.resize(count);
      found.resize(count + BallColumns::kPadding);
      expected.resize(find_near_balls(balls.view(), origin, range, expected.data()));
      found.resize(slices.find(origin, range, found.data()));
      std::ranges::sort(found);
      ASSERT_EQ(found, expected) << "round " << round;
      found_in_all += found.size();
    }
  }
  EXPECT_GT(found_in_all, 100'000U);
}

TEST(BallSlices, EachPairThatOverlapsIsFoundOnce) {
  Random random(2);
  std::size_t found_in_all = 0;
  BallSlices slices;
  for (int round = 0; round < 200; ++round) {
    const std::size_t count = std::array<std::size_t, 7>{0, 1, 2, 8, 32, 33, 300}[random.generator()() % 7];
    const SomeBalls balls = any_balls(random, count);
    slices.sort(balls.view());
    std::set<std::pair<std::size_t, std::size_t>> pairs;
    slices.for_each_pair([&](std::size_t a, std::size_t b) {
      ASSERT_NE(a, b);
      EXPECT_TRUE(pairs.insert(std::minmax(a, b)).second) << a << ' ' << b;
    });
    for (std::size_t a = 0; a < count; ++a) {
      for (std::size_t b = a + 1; b < count; ++b) {
        const bool are_there = balls.radii[a] >= 0.0F && balls.radii[b] >= 0.0F;
        const double nearness = SomeBalls::nearness(balls.center(a), balls.center(b), balls.radii[a] + balls.radii[b]);
        const bool is_found = pairs.contains({a, b});
        if (!are_there || nearness > 1.0 + 3e-5) {
          EXPECT_FALSE(is_found) << a << ' ' << b;
        } else if (nearness <= 1.0) {
          EXPECT_TRUE(is_found) << a << ' ' << b;
        }
      }
    }
    found_in_all += pairs.size();
  }
  EXPECT_GT(found_in_all, 10'000U);
}

}  // namespace
}  // namespace flockstep::trace
