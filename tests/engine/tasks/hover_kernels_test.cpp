#include "tasks/hover_kernels.hpp"

#include <bit>

#include "flockstep/pose.hpp"
#include "on_target.hpp"
#include "random.hpp"

namespace flockstep::task {
namespace {

using dynamics::kLanes;
using namespace testing;
using Vec3d = Eigen::Vector3d;

constexpr float kSpinUnit = 10.0F;
constexpr float kHovering = 1500.0F;  // rad/s, and 1 more for each drone

RotorUnits rotor_units() {
  RotorUnits units;
  for (std::size_t i = 0; i < kLanes; ++i) {
    units.hovering[i] = kHovering + static_cast<float>(i);
    units.inverse_below[i] = 1.0F / 1300.0F;
    units.inverse_above[i] = 1.0F / 900.0F;
  }
  return units;
}

constexpr double kReach = 0.1;  // m

// Sixteen drones in flight, at distances from very near to far from the point that they hold.
struct Flights {
  explicit Flights(unsigned seed) {
    Random random(seed);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const float away = std::pow(10.0F, random.within(-4.0F, 2.0F));
      add(middle, random.point(50.0F));
      const Vec3 from(middle[3 * i], middle[3 * i + 1], middle[3 * i + 2]);
      add(position, from + away * random.direction());
      add(velocity, random.point(5.0F));
      add(spin, random.point(20.0F));
      const Quat q = random.rotation();
      quat.insert(quat.end(), {q.w(), q.x(), q.y(), q.z()});
      for (int k = 0; k < 4; ++k) {
        rotor.push_back(random.within(200.0F, 2400.0F));
        action.push_back(random.within(-1.0F, 1.0F));
        action_before.push_back(random.within(-1.0F, 1.0F));
      }
    }
  }

  static void add(std::vector<float>& rows, const Vec3& v) { rows.insert(rows.end(), {v.x(), v.y(), v.z()}); }
  HoverRows rows() const {
    return {middle.data(), position.data(), quat.data(),   velocity.data(),
            spin.data(),   rotor.data(),    action.data(), action_before.data()};
  }
  static Vec3d of(const std::vector<float>& rows, std::size_t i) {
    return Eigen::Vector3f(rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]).cast<double>();
  }

  std::vector<float> middle, position, quat, velocity, spin, rotor, action, action_before;
};

struct Result {
  HoverScores scores;
  std::array<float, kLanes * kHoverNumbers> observed;
};

Result run(const HoverRows& rows) {
  Result result{};
  score_hover(rows, kReach, result.scores);
  observe_hover(rows, rotor_units(), kSpinUnit, result.observed.data());
  return result;
}

void expect_same_bits(const Result& a, const Result& b) {
  for (std::size_t i = 0; i < kLanes; ++i) {
    EXPECT_EQ(std::bit_cast<std::uint64_t>(a.scores.distance[i]), std::bit_cast<std::uint64_t>(b.scores.distance[i]));
    EXPECT_EQ(std::bit_cast<std::uint64_t>(a.scores.holding[i]), std::bit_cast<std::uint64_t>(b.scores.holding[i]));
    for (const auto number : {&HoverScores::closeness, &HoverScores::speed, &HoverScores::spin, &HoverScores::change}) {
      EXPECT_EQ(std::bit_cast<std::uint32_t>((a.scores.*number)[i]), std::bit_cast<std::uint32_t>((b.scores.*number)[i]));
    }
  }
  for (std::size_t i = 0; i < a.observed.size(); ++i) {
    EXPECT_EQ(std::bit_cast<std::uint32_t>(a.observed[i]), std::bit_cast<std::uint32_t>(b.observed[i]));
  }
}

TEST(HoverKernels, ScoreAsTheFormulasDoInDoublePrecision) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    const Flights flights(seed);
    const HoverScores scores = run(flights.rows()).scores;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double distance = (Flights::of(flights.middle, i) - Flights::of(flights.position, i)).norm();
      EXPECT_NEAR(scores.distance[i], distance, 1e-15 * distance + 1e-18);
      EXPECT_NEAR(scores.holding[i], 1.0 / (1.0 + distance * distance / (kReach * kReach)), 1e-15);
      const double closeness = std::exp(std::max(-2.0 * distance, -80.0));
      EXPECT_NEAR(scores.closeness[i], closeness, 4e-7 * closeness * (1.0 + distance));  // the distance is rounded to float32
      EXPECT_NEAR(scores.speed[i], Flights::of(flights.velocity, i).norm(), 1e-5);
      EXPECT_NEAR(scores.spin[i], Flights::of(flights.spin, i).norm(), 1e-5);
      double change = 0.0;
      for (std::size_t k = 4 * i; k < 4 * i + 4; ++k) {
        change += std::pow(static_cast<double>(flights.action[k]) - static_cast<double>(flights.action_before[k]), 2.0) / 4.0;
      }
      EXPECT_NEAR(scores.change[i], change, 1e-6);
    }
  }
}

TEST(HoverKernels, ObserveTheStateInTheBodyFrame) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    const Flights flights(seed);
    const auto observed = run(flights.rows()).observed;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const float* const q = flights.quat.data() + 4 * i;
      const Eigen::Matrix3d to_body = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix().transpose();
      const Vec3d way = to_body * (Flights::of(flights.middle, i) - Flights::of(flights.position, i));
      const Vec3d velocity = to_body * Flights::of(flights.velocity, i), up = to_body.col(2),
                  spin = Flights::of(flights.spin, i) / static_cast<double>(kSpinUnit);
      const float* const row = observed.data() + kHoverNumbers * i;
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(row[k], way[k], 1e-5 * (1.0 + way.norm()));
        EXPECT_NEAR(row[3 + k], velocity[k], 1e-5);
        EXPECT_NEAR(row[6 + k], up[k], 1e-6);
        EXPECT_NEAR(row[9 + k], spin[k], 1e-6);
      }
      for (std::size_t k = 0; k < 4; ++k) {
        const double away = static_cast<double>(flights.rotor[4 * i + k]) - static_cast<double>(rotor_units().hovering[i]);
        EXPECT_NEAR(row[12 + k], away < 0.0 ? away / 1300.0 : away / 900.0, 1e-6);
      }
    }
  }
}

TEST(HoverKernels, GiveTheSameBitsOnEverySimdTarget) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Flights flights(seed);
    const Result best = run(flights.rows());
    on_every_target([&] { expect_same_bits(best, run(flights.rows())); });
  }
}

}  // namespace
}  // namespace flockstep::task
