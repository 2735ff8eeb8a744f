#include "flockstep/sensors/optical_flow.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string_view>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/pose.hpp"
#include "sensors/lidar.hpp"
#include "sensors/noisy_sensor.hpp"
#include "sensors/presets.hpp"
#include "sensors/rows.hpp"

namespace flockstep {

void OpticalFlowConfig::validate() const { check_fields(*this, "optical_flow."); }

void OpticalFlowConfig::check_motion(const DynamicsConfig& dynamics) const {
  require(!dynamics.is_kinematic(), "optical_flow", "None for kinematic motion (it has no velocities: give motion=\"rotors\")",
          "an OpticalFlowConfig");
}

OpticalFlowConfig OpticalFlowConfig::preset(std::string_view product) {
  const std::array presets{
      OpticalFlowConfig{.name = "pmw3901", .max_range_m = 30.0F, .max_flow_radps = 7.4F, .noise_std_radps = 0.15F}};
  return sensors::preset_named(product, presets, "OpticalFlowConfig.preset");
}

namespace sensors {
namespace {

using Vec2 = Eigen::Vector2f;

constexpr float kHalf = std::numbers::sqrt2_v<float> / 2.0F;

class OpticalFlow final : public NoisySensor<OpticalFlowReadings> {
 public:
  OpticalFlow(const OpticalFlowConfig& config, const SensorSetup& setup)
      : NoisySensor("optical_flow", config.name, config, setup, stream_named("optical flow noise"),
                    allocated<OpticalFlowReadings>({.num_drones = setup.num_drones}),
                    config.noise_std_radps > 0.0F || config.max_flow_radps, std::span<const Drift>()),
        config_(config),
        offset_(Vec3::Map(config.offset_m.data())),
        beam_(
            {.beams = 1, .max_range_m = config.max_range_m, .offset_m = config.offset_m, .quat_wxyz = {kHalf, 0.0F, kHalf, 0.0F}},
            setup) {}

 private:
  // A point p of the ground in the body frame moves at -v - w x p.
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override {
    const State& state = surroundings.state;
    OpticalFlowReadings& truth = readings_.truth();
    for (const DroneIndex drone : drones) {
      beam_.scan(drone, surroundings, false, {&truth.distance[drone], 1});
      const float distance = truth.distance[drone];
      const Vec3 velocity = pose_of(state, drone).rotation.conjugate() * of_row(state.flight.velocity, drone);
      const Vec3 point = offset_ - distance * Vec3::UnitZ();
      const Vec3 motion = -velocity - of_row(state.flight.angular_velocity, drone).cross(point);
      const bool is_seen = distance > 0.0F && std::isfinite(distance);
      put_flow(is_seen ? Vec2(motion.head<2>() / distance) : Vec2(Vec2::Zero()), distance, truth, drone);
    }
  }
  void add_errors(std::span<const DroneIndex> drones, const State& state) override {
    if (!has_errors_) return;
    const float most = config_.max_flow_radps.value_or(std::numeric_limits<float>::infinity());
    for (const DroneIndex drone : drones) {
      const OpticalFlowReadings& truth = readings_.truth();
      const std::array<float, 2> numbers = normals<2>(state, drone);
      const float noise_std = std::isfinite(truth.distance[drone]) ? config_.noise_std_radps : 0.0F;
      const Vec2 flow = Vec2::Map(truth.flow.data() + 2 * drone) + noise_std * Vec2::Map(numbers.data());
      put_flow(flow.cwiseMax(-most).cwiseMin(most), truth.distance[drone], readings_.noisy(), drone);
    }
  }
  static void put_flow(const Vec2& flow, float distance, OpticalFlowReadings& readings, DroneIndex drone) {
    std::copy_n(flow.data(), 2, readings.flow.data() + 2 * drone);
    readings.distance[drone] = distance;
  }

  OpticalFlowConfig config_;
  Vec3 offset_;  // m, body frame
  Lidar beam_;   // measures the distance: its x is along the body's -z
};

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const OpticalFlowConfig& config, const SensorSetup& setup) {
  return std::make_unique<OpticalFlow>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
