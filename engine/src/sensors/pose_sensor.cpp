#include "sensors/pose_sensor.hpp"

#include <algorithm>
#include <numbers>

#include "base/check_fields.hpp"
#include "base/indices.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"

namespace flockstep {

void PoseSensorConfig::validate() const { check_fields(*this, "pose_sensor."); }

namespace sensors {

PoseSensor::PoseSensor(const PoseSensorConfig& config, const SensorSetup& setup)
    : SensorOf("pose_sensor", "pose", config, setup, {.num_drones = setup.num_drones}, !config.is_exact()), config_(config) {}

std::unique_ptr<BlockSensor> make_sensor(const PoseSensorConfig& config, const SensorSetup& setup) {
  return std::make_unique<PoseSensor>(config, setup);
}

void PoseSensor::assume_truth(const State& state) {
  for (PoseReadings* const readings : {&readings_.truth(), &readings_.published()}) {
    readings->position = state.position;
    readings->quat_wxyz = state.quat_wxyz;
  }
}

void PoseSensor::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  const State& state = surroundings.state;
  PoseReadings& truth = readings_.truth();
  for_each_contiguous(drones, [&](std::size_t first, std::size_t count) {
    std::copy_n(state.position.data() + 3 * first, 3 * count, truth.position.data() + 3 * first);
    std::copy_n(state.quat_wxyz.data() + 4 * first, 4 * count, truth.quat_wxyz.data() + 4 * first);
  });
}

void PoseSensor::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (config_.is_exact()) return;
  const float orientation_std_rad = config_.orientation_noise_std_deg * std::numbers::pi_v<float> / 180.0F;
  const PoseReadings& truth = readings_.truth();
  PoseReadings& noisy = readings_.noisy();
  for (const DroneIndex drone : drones) {
    Pose pose = load_pose(truth.position.data() + 3 * drone, truth.quat_wxyz.data() + 4 * drone);
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    const std::uint32_t index = 2 * reading_of(state, key.env);
    const auto [px, py] = normal_pair(draw(state, key, Stream::position_noise, index));
    const auto [pz, unused] = normal_pair(draw(state, key, Stream::position_noise, index + 1));
    pose.position += config_.position_noise_std_m * Vec3(px, py, pz);
    const auto [rx, ry] = normal_pair(draw(state, key, Stream::orientation_noise, index));
    const auto [rz, unused_too] = normal_pair(draw(state, key, Stream::orientation_noise, index + 1));
    const Vec3 rotation_vector = orientation_std_rad * Vec3(rx, ry, rz);
    const float angle = rotation_vector.norm();
    if (angle > 0.0F) pose.rotation = pose.rotation * Quat(Eigen::AngleAxisf(angle, rotation_vector / angle));
    store_pose(noisy.position.data() + 3 * drone, noisy.quat_wxyz.data() + 4 * drone, pose);
  }
}

}  // namespace sensors
}  // namespace flockstep
