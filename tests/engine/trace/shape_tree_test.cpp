#include "trace/shape_tree.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "numbers.hpp"
#include "random.hpp"

namespace flockstep::trace {
namespace {

using testing::kInfinity;
using testing::Random;

// Returns the distance in double precision; 0 inside.
double distance(const Aabb& box, const Vec3& point) {
  const Eigen::Vector3d p = point.cast<double>();
  return (box.min.cast<double>() - p).cwiseMax(p - box.max.cast<double>()).cwiseMax(0.0).norm();
}

struct Boxes {
  std::vector<Aabb> boxes;
  std::vector<std::uint32_t> numbers;  // random order, no 0
  float reach = 1.0F;                  // m, extent of all boxes

  ShapeTree tree() const { return {boxes, numbers}; }
};

Boxes scattered(Random& random, std::size_t count, float reach, float size) {
  Boxes result;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 center = random.point(reach);
    const Vec3 half = Vec3(random.within(0, 1), random.within(0, 1), random.within(0, 1)) * (i % 7 == 0 ? 10.0F * size : size);
    result.boxes.push_back({center - half, center + half});
  }
  result.numbers.resize(count);
  std::iota(result.numbers.begin(), result.numbers.end(), 1U);
  std::shuffle(result.numbers.begin(), result.numbers.end(), random.generator());
  result.reach = reach;
  return result;
}

std::vector<std::uint32_t> near(const ShapeTree& tree, const Vec3& point, float radius) {
  std::vector<std::uint32_t> found;
  tree.for_each_near(point, radius, [&](std::uint32_t number) { found.push_back(number); });
  return found;
}

// Expects every box within the radius to be found once, and no other. Boxes at exactly the radius are ignored because of
// rounding. Returns the number found.
std::size_t expect_like_brute_force(const Boxes& boxes, const ShapeTree& tree, const Vec3& point, float radius) {
  std::vector<std::uint32_t> found = near(tree, point, radius);
  const std::size_t count = found.size();
  std::sort(found.begin(), found.end());
  EXPECT_EQ(std::adjacent_find(found.begin(), found.end()), found.end()) << "told twice";
  const double slack = 1e-6 * (static_cast<double>(boxes.reach) + static_cast<double>(point.norm()) +
                               (radius < kInfinity ? static_cast<double>(radius) : 0.0));
  for (std::size_t i = 0; i < boxes.boxes.size(); ++i) {
    const double apart = distance(boxes.boxes[i], point);
    const bool is_found = std::binary_search(found.begin(), found.end(), boxes.numbers[i]);
    if (std::abs(apart - static_cast<double>(radius)) <= slack) continue;
    EXPECT_EQ(is_found, apart < static_cast<double>(radius)) << "box " << i << ", " << apart << " m away";
  }
  return count;
}

TEST(ShapeTree, AgreesWithBruteForce) {
  for (const std::size_t count : {0U, 1U, 2U, 15U, 16U, 17U, 255U, 256U, 257U, 1000U, 4097U, 10'000U}) {
    SCOPED_TRACE(count);
    Random random(static_cast<unsigned>(count));
    const Boxes boxes = scattered(random, count, 20.0F, 0.5F);
    const ShapeTree tree = boxes.tree();
    EXPECT_EQ(tree.empty(), count == 0);
    std::size_t found = 0;
    for (int i = 0; i < 100; ++i) {
      const Vec3 point = random.point(i % 5 == 0 ? 40.0F : 20.0F);
      const float radius = std::array{0.0F, 0.3F, 2.0F, 10.0F}[static_cast<std::size_t>(i) % 4];
      found += expect_like_brute_force(boxes, tree, point, radius);
      ASSERT_FALSE(HasFailure());
    }
    EXPECT_GE(found, count / 2);
    EXPECT_EQ(expect_like_brute_force(boxes, tree, Vec3::Zero(), kInfinity), count) << "all are within an infinite radius";
    EXPECT_EQ(near(tree, Vec3::Constant(1e4F), 1.0F).size(), 0U);
  }
}

TEST(ShapeTree, BoxesOnALineInAPlaneAndAtOnePlace) {
  Random random(1);
  for (const Vec3& spread : {Vec3(1, 0, 0), Vec3(0, 1, 1), Vec3(0, 0, 0), Vec3(1e5F, 1e-5F, 1)}) {
    Boxes boxes = scattered(random, 500, 1.0F, 0.01F);
    for (Aabb& box : boxes.boxes) box = {box.min.cwiseProduct(spread), box.max.cwiseProduct(spread)};
    boxes.reach = std::max(1.0F, spread.maxCoeff());
    const ShapeTree tree = boxes.tree();
    for (int i = 0; i < 50; ++i) {
      expect_like_brute_force(boxes, tree, random.point(1.0F).cwiseProduct(spread), 0.2F * boxes.reach);
      ASSERT_FALSE(HasFailure());
    }
  }
}

TEST(ShapeTree, TheOrderDependsOnNothingButTheBoxes) {
  Random random(2);
  const Boxes boxes = scattered(random, 1000, 20.0F, 0.5F);
  const ShapeTree tree = boxes.tree();
  const ShapeTree again = boxes.tree();
  const std::vector<std::uint32_t> all = near(tree, Vec3::Zero(), kInfinity);
  for (int i = 0; i < 20; ++i) {
    const Vec3 point = random.point(20.0F);
    const std::vector<std::uint32_t> found = near(tree, point, 8.0F);
    EXPECT_EQ(found, near(again, point, 8.0F));
    // A smaller radius yields a subsequence of the full order.
    std::size_t at = 0;
    for (const std::uint32_t number : all) at += at < found.size() && found[at] == number;
    EXPECT_EQ(at, found.size());
  }
}

}  // namespace
}  // namespace flockstep::trace
