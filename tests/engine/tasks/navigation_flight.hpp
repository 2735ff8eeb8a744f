// A drone that flies by hand in a navigation task.
#pragma once

#include "episodes.hpp"

namespace flockstep::navigating {

using namespace testing;

// Positions and steps that are exact in float32, so that radii are hit exactly.
inline constexpr float kStep = 0.125F;
inline const Vec3 kStart(5, 10, 5);
inline const Vec3 kFirst(7, 10, 5);
inline const Vec3 kSecond(7, 13, 5);
inline const Vec3 kGoal(10, 13, 5);

// An empty hall of 20 x 20 x 10 m. In its middle nothing is within the LiDAR's range of 3 m.
inline std::shared_ptr<const World> hall(std::vector<Vec3> waypoints = {kFirst, kSecond}, const Vec3& goal = kGoal) {
  return make_world({primitive(PrimitiveKind::room, {10, 10, 5}, {10, 10, 5})},
                    {.start = kStart, .waypoints = std::move(waypoints), .goal = goal});
}

inline NavigationBatch one_drone(const LidarConfig& lidar = {}) {
  NavigationBatch config = navigation_batch(1, lidar);
  config.navigation.step_m = kStep;
  config.episode.autoreset_mode = AutoresetMode::disabled;  // keeps the final state visible
  return config;
}

// The order of NavigationReward's weights.
enum Term { kDistance, kCrash, kFreeSpace, kStepNumber, kActionChange, kOvershoot, kNumTerms };
using Terms = std::array<float, kNumTerms>;

class Flight {
 public:
  explicit Flight(const NavigationBatch& config, const std::shared_ptr<const World>& world = hall())
      : batch(config.make({world})) {
    batch.reset({});
  }

  void put(const Vec3& position, const Quat& q = Quat::Identity()) {
    batch.set_pose(std::span(position.data(), 3), std::vector<float>{q.w(), q.x(), q.y(), q.z()});
  }
  // Takes a step and returns the terms of its reward.
  Terms step(std::int64_t action) {
    batch.step(std::span<const std::int64_t>(&action, 1));
    return terms();
  }
  Terms step(const std::vector<float>& action) {
    batch.step(std::span<const float>(action));
    return terms();
  }
  Vec3 position() const { return Vec3(batch.state().position.data()); }
  std::int32_t goal_index() const { return task_array<std::int32_t>(batch, "goal_index")[0]; }
  std::vector<float> observation() const { return values_of(out().observation[0]); }
  const Outputs& out() const { return batch.outputs(); }

  Batch batch;

 private:
  Terms terms() const {
    Terms terms{};
    std::copy(out().reward_terms.begin(), out().reward_terms.end(), terms.begin());
    double sum = 0.0;
    for (const float term : terms) sum += static_cast<double>(term);
    EXPECT_NEAR(static_cast<double>(out().reward[0]), sum, 1e-6 * std::max(1.0, std::abs(sum)));
    return terms;
  }
};

inline void expect_flags(const Flight& flight, bool terminated, bool truncated, bool success, bool crashed) {
  EXPECT_EQ(flight.out().terminated[0], terminated);
  EXPECT_EQ(flight.out().truncated[0], truncated);
  EXPECT_EQ(flight.out().success[0], success);
  EXPECT_EQ(flight.out().crashed[0], crashed);
}

}  // namespace flockstep::navigating
