#include "flockstep/sensors/magnetometer.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <string_view>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "flockstep/pose.hpp"
#include "sensors/noisy_sensor.hpp"
#include "sensors/presets.hpp"
#include "sensors/rows.hpp"

namespace flockstep {

void MagnetometerConfig::validate() const { check_fields(*this, "magnetometer."); }

MagnetometerConfig MagnetometerConfig::preset(std::string_view product) {
  const std::array presets{MagnetometerConfig{.name = "airsim", .noise_std_ut = 0.5F},
                           MagnetometerConfig{.name = "px4-sih", .noise_std_ut = 2.0F}};
  return sensors::preset_named(product, presets, "MagnetometerConfig.preset");
}

namespace sensors {
namespace {

// The constant errors of three axes, then a matrix of 3 x 3.
std::array<Drift, 12> drifts_of(const MagnetometerConfig& config) {
  std::array<Drift, 12> drifts;
  std::fill_n(drifts.begin(), 3, Drift{.start_std = config.hard_iron_std_ut});
  std::fill_n(drifts.begin() + 3, 9, Drift{.start_std = config.soft_iron_std});
  return drifts;
}

class Magnetometer final : public NoisySensor<MagnetometerReadings> {
 public:
  Magnetometer(const MagnetometerConfig& config, const SensorSetup& setup)
      : NoisySensor("magnetometer", config.name, config, setup, stream_named("magnetometer noise"),
                    allocated<MagnetometerReadings>({.num_drones = setup.num_drones}), config.noise_std_ut > 0.0F,
                    drifts_of(config)),
        noise_std_ut_(config.noise_std_ut),
        field_(Vec3::Map(config.field_ut.data())),
        to_sensor_(rotation_to_sensor(config.quat_wxyz)) {}

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override {
    for (const DroneIndex drone : drones) {
      const Quat to_body = pose_of(surroundings.state, drone).rotation.conjugate();
      put(to_sensor_ * (to_body * field_), readings_.truth().field, drone);
    }
  }
  void add_errors(std::span<const DroneIndex> drones, const State& state) override {
    if (!has_errors_) return;
    for (const DroneIndex drone : drones) {
      const std::array<float, 4> numbers = normals<4>(state, drone);
      const float* const iron = drifts_.advance(state, drone, {});
      const Vec3 field = of_row(readings_.truth().field, drone);
      const Vec3 error = Mat3::Map(iron + 3) * field + Vec3::Map(iron) + noise_std_ut_ * Vec3::Map(numbers.data());
      put(field + error, readings_.noisy().field, drone);
    }
  }

  float noise_std_ut_;
  Vec3 field_;      // uT, world frame
  Mat3 to_sensor_;  // rotation, body to sensor
};

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const MagnetometerConfig& config, const SensorSetup& setup) {
  return std::make_unique<Magnetometer>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
