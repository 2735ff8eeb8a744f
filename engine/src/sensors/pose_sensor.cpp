#include "sensors/pose_sensor.hpp"

#include <algorithm>
#include <array>

#include "base/check_fields.hpp"
#include "base/indices.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "sensors/rows.hpp"

namespace flockstep {

void PoseSensorConfig::validate() const { check_fields(*this, "pose_sensor."); }

void PoseSensorConfig::check_motion(const DynamicsConfig& dynamics) const {
  require(!velocity_noise_std_mps || !dynamics.is_kinematic(), "pose_sensor.velocity_noise_std_mps",
          "None for kinematic motion (it has no velocities: give motion=\"rotors\")", velocity_noise_std_mps.value_or(0.0F));
}

namespace sensors {
namespace {

PoseReadings cleared(const PoseSensorConfig& config, const SensorSetup& setup) {
  auto readings = allocated<PoseReadings>({.num_drones = setup.num_drones});
  if (!config.velocity_noise_std_mps) readings.velocity.clear();
  return readings;
}

bool has_noise(const PoseSensorConfig& config) {
  return config.position_noise_std_m > 0.0F || config.orientation_noise_std_deg > 0.0F ||
         config.velocity_noise_std_mps.value_or(0.0F) > 0.0F;
}

// Three axes of two drifts of the position, and the yaw.
std::array<Drift, 7> drifts_of(const PoseSensorConfig& config) {
  const Drift walk{.density = config.position_random_walk};
  const Drift wander = Drift::gauss_markov(config.drift_std_m, config.drift_time_s);
  return {walk, walk, walk, wander, wander, wander, Drift{.density = radians(config.yaw_random_walk)}};
}

}  // namespace

PoseSensor::PoseSensor(const PoseSensorConfig& config, const SensorSetup& setup)
    : NoisySensor("pose_sensor", "pose", config, setup, stream_named("pose estimate"), cleared(config, setup), has_noise(config),
                  drifts_of(config)),
      config_(config) {}

std::unique_ptr<BlockSensor> make_sensor(const PoseSensorConfig& config, const SensorSetup& setup) {
  return std::make_unique<PoseSensor>(config, setup);
}

void PoseSensor::assume_truth(const State& state) {
  for (PoseReadings* const readings : {&readings_.truth(), &readings_.published()}) {
    readings->position = state.position;
    readings->quat_wxyz = state.quat_wxyz;
    if (config_.velocity_noise_std_mps) readings->velocity = state.flight.velocity;
  }
}

void PoseSensor::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  const State& state = surroundings.state;
  PoseReadings& truth = readings_.truth();
  const bool has_velocity = !truth.velocity.empty();
  for_each_contiguous(drones, [&](std::size_t first, std::size_t count) {
    std::copy_n(state.position.data() + 3 * first, 3 * count, truth.position.data() + 3 * first);
    std::copy_n(state.quat_wxyz.data() + 4 * first, 4 * count, truth.quat_wxyz.data() + 4 * first);
    if (has_velocity) std::copy_n(state.flight.velocity.data() + 3 * first, 3 * count, truth.velocity.data() + 3 * first);
  });
}

void PoseSensor::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (!has_errors_) return;
  const float orientation_std_rad = radians(config_.orientation_noise_std_deg);
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
    if (config_.velocity_noise_std_mps || !drifts_.are_none()) add_drift(state, drone, pose);
    store_pose(noisy.position.data() + 3 * drone, noisy.quat_wxyz.data() + 4 * drone, pose);
  }
}

void PoseSensor::add_drift(const State& state, DroneIndex drone, Pose& pose) {
  constexpr std::size_t kDrifts = 7;
  const std::array<float, 10> numbers = normals<10>(state, drone);
  const float* const drift = drifts_.advance(state, drone, std::span(numbers).first<kDrifts>());
  const Quat yaw(Eigen::AngleAxisf(drift[6], Vec3::UnitZ()));
  pose.position += Vec3(drift[0] + drift[3], drift[1] + drift[4], drift[2] + drift[5]);
  pose.rotation = yaw * pose.rotation;
  if (!config_.velocity_noise_std_mps) return;
  const Vec3 velocity = yaw * Vec3::Map(readings_.truth().velocity.data() + 3 * drone) +
                        *config_.velocity_noise_std_mps * Vec3::Map(numbers.data() + kDrifts);
  std::copy_n(velocity.data(), 3, readings_.noisy().velocity.data() + 3 * drone);
}

}  // namespace sensors
}  // namespace flockstep
