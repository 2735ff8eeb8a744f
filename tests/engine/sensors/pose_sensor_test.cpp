#include "sensors/pose_sensor.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using testing::make_world;
using testing::primitive;

constexpr int kDrones = 4000;

BatchConfig noisy(int num_drones, float position_std_m, float orientation_std_deg) {
  BatchConfig config;
  config.num_envs = num_drones;
  config.num_threads = 1;
  config.pose_sensor = {.position_noise_std_m = position_std_m, .orientation_noise_std_deg = orientation_std_deg};
  return config;
}

Batch::Worlds hall() { return {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {10, 10, 10})})}; }

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0) / static_cast<double>(a.size());
}

// Returns the errors of a scan, divided by their standard deviation: three axes of the position, three of the rotation vector.
std::array<std::vector<double>, 6> errors_of(const Batch& batch, const Quat& rotation) {
  std::array<std::vector<double>, 6> errors;
  const State& state = batch.state();
  const double tilt_rad = static_cast<double>(batch.config().pose_sensor.orientation_noise_std_deg) * std::numbers::pi / 180.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(batch.config().num_drones()); ++i) {
    const float* const q = batch.pose_readings().quat_wxyz.data() + 4 * i;
    const Eigen::AngleAxisd turn(rotation.conjugate().cast<double>() * Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double off =
          static_cast<double>(batch.pose_readings().position[3 * i + axis]) - static_cast<double>(state.position[3 * i + axis]);
      errors[axis].push_back(off / static_cast<double>(batch.config().pose_sensor.position_noise_std_m));
      errors[3 + axis].push_back(turn.angle() * turn.axis()[static_cast<Eigen::Index>(axis)] / tilt_rad);
    }
  }
  return errors;
}

TEST(PoseSensor, IsExactWithoutNoise) {
  Batch batch(noisy(3, 0.0F, 0.0F), hall());
  batch.set_pose(std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8, 9}, {});
  batch.sense();
  EXPECT_EQ(batch.pose_readings().position, batch.state().position);
  EXPECT_EQ(batch.pose_readings().quat_wxyz, batch.state().quat_wxyz);
}

TEST(PoseSensor, NoiseIsNormalAndIndependentInEveryAxisAndScan) {
  Batch batch(noisy(kDrones, 0.125F, 5.0F), hall());
  const Quat rotation(0.5F, 0.5F, -0.5F, 0.5F);
  std::vector<float> quats;
  for (int i = 0; i < kDrones; ++i) quats.insert(quats.end(), {0.5F, 0.5F, -0.5F, 0.5F});
  batch.set_pose({}, quats);
  batch.sense();
  const auto first = errors_of(batch, rotation);
  batch.sense();
  const auto second = errors_of(batch, rotation);
  const double bound = 5.0 / std::sqrt(kDrones);  // five standard deviations
  for (std::size_t a = 0; a < 6; ++a) {
    SCOPED_TRACE(a);
    EXPECT_NEAR(std::accumulate(first[a].begin(), first[a].end(), 0.0) / kDrones, 0.0, bound);
    EXPECT_NEAR(correlation(first[a], first[a]), 1.0, std::sqrt(2.0) * bound);  // variance
    for (std::size_t b = 0; b < 6; ++b) {
      EXPECT_NEAR(correlation(first[a], second[b]), 0.0, bound) << b;
      if (a != b) {
        EXPECT_NEAR(correlation(first[a], first[b]), 0.0, bound) << b;
      }
    }
  }
}

}  // namespace
}  // namespace flockstep
