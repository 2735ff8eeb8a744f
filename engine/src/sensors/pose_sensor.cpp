#include "sensors/pose_sensor.hpp"

#include <algorithm>
#include <numbers>

#include "base/contiguous.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "sensors/rate.hpp"

namespace flockstep {

void PoseSensorConfig::validate() const {
  require_not_negative(position_noise_std_m, "pose_sensor.position_noise_std_m");
  require_not_negative(orientation_noise_std_deg, "pose_sensor.orientation_noise_std_deg");
  if (rate_hz) require_positive(*rate_hz, "pose_sensor.rate_hz");
}

namespace sensors {

PoseSensor::PoseSensor(const PoseSensorConfig& config, const ClockConfig& clock, std::size_t drones_per_env,
                       std::size_t num_drones)
    : config_(config),
      period_(period_in_ticks(config.rate_hz, clock, "pose_sensor.rate_hz")),
      drones_per_env_(drones_per_env),
      readings_{std::vector<float>(3 * num_drones), std::vector<float>(4 * num_drones)} {}

void PoseSensor::assume_truth(const State& state) {
  readings_.position = state.position;
  readings_.quat_wxyz = state.quat_wxyz;
}

void PoseSensor::visit(ArrayVisitor& visitor) { visitor.fields(readings_); }

Pose PoseSensor::pose(DroneIndex drone) const {
  const float* const p = readings_.position.data() + 3 * drone;
  const float* const q = readings_.quat_wxyz.data() + 4 * drone;
  return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
}

void PoseSensor::read(std::span<const DroneIndex> drones, const State& state) {
  if (config_.is_exact()) {
    for_each_contiguous(drones, [&](std::size_t first, std::size_t count) {
      std::copy_n(state.position.data() + 3 * first, 3 * count, readings_.position.data() + 3 * first);
      std::copy_n(state.quat_wxyz.data() + 4 * first, 4 * count, readings_.quat_wxyz.data() + 4 * first);
    });
    return;
  }
  const float orientation_std_rad = config_.orientation_noise_std_deg * std::numbers::pi_v<float> / 180.0F;
  for (const DroneIndex drone : drones) {
    Pose pose = pose_of(state, drone);
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    // With a rate of its own the sensor may read several times between two readings of the env.
    const auto reading = static_cast<std::uint32_t>(period_ == 0 ? state.sensed[key.env] : state.tick[key.env]);
    const std::uint32_t index = 2 * reading;
    const auto [px, py] = normal_pair(draw(state, key, Stream::position_noise, index));
    const auto [pz, unused] = normal_pair(draw(state, key, Stream::position_noise, index + 1));
    pose.position += config_.position_noise_std_m * Vec3(px, py, pz);
    const auto [rx, ry] = normal_pair(draw(state, key, Stream::orientation_noise, index));
    const auto [rz, unused_too] = normal_pair(draw(state, key, Stream::orientation_noise, index + 1));
    const Vec3 rotation_vector = orientation_std_rad * Vec3(rx, ry, rz);
    const float angle = rotation_vector.norm();
    if (angle > 0.0F) pose.rotation = pose.rotation * Quat(Eigen::AngleAxisf(angle, rotation_vector / angle));
    store_pose(readings_.position.data() + 3 * drone, readings_.quat_wxyz.data() + 4 * drone, pose);
  }
}

}  // namespace sensors
}  // namespace flockstep
