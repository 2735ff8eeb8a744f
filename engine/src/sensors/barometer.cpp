#include "flockstep/sensors/barometer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <string_view>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "sensors/noisy_sensor.hpp"
#include "sensors/presets.hpp"

namespace flockstep {

void BarometerConfig::validate() const { check_fields(*this, "barometer."); }

BarometerConfig BarometerConfig::preset(std::string_view product) {
  const std::array presets{
      BarometerConfig{.name = "px4-sih", .noise_std_pa = 1.0F},
      BarometerConfig{.name = "airsim", .noise_std_pa = 2.7F, .drift_std_pa = 185.0F, .drift_time_s = 3600.0F},
  };
  return sensors::preset_named(product, presets, "BarometerConfig.preset");
}

namespace sensors {
namespace {

// The International Standard Atmosphere (ISO 2533) up to 11 km.
constexpr double kSeaLevelPa = 101325.0;
constexpr double kSeaLevelK = 288.15;
constexpr double kLapseKpm = 0.0065;
constexpr double kExponent = 9.80665 * 0.0289644 / (8.31446 * kLapseKpm);  // 5.2558
constexpr double kLowestM = -5000.0, kHighestM = 11000.0;                  // the formula's limits

double pressure_at(double altitude_m) {
  return kSeaLevelPa * std::pow(1.0 - kLapseKpm / kSeaLevelK * std::clamp(altitude_m, kLowestM, kHighestM), kExponent);
}
double altitude_of(double pressure_pa) {
  return kSeaLevelK / kLapseKpm * (1.0 - std::pow(std::max(pressure_pa, 0.0) / kSeaLevelPa, 1.0 / kExponent));
}

class Barometer final : public NoisySensor<BarometerReadings> {
 public:
  Barometer(const BarometerConfig& config, const SensorSetup& setup)
      : NoisySensor(
            "barometer", config.name, config, setup, stream_named("barometer noise"),
            allocated<BarometerReadings>({.num_drones = setup.num_drones}), config.noise_std_pa > 0.0F,
            std::array{Drift::gauss_markov(config.drift_std_pa, config.drift_time_s), Drift{.start_std = config.bias_std_pa}}),
        config_(config) {}

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override {
    for (const DroneIndex drone : drones) {
      const double z = static_cast<double>(position_of(surroundings.state, drone).z());
      publish_pressure(pressure_at(z + static_cast<double>(config_.altitude_m)), readings_.truth(), drone);
    }
  }
  void add_errors(std::span<const DroneIndex> drones, const State& state) override {
    if (!has_errors_) return;
    for (const DroneIndex drone : drones) {
      const auto [noise, move] = normals<2>(state, drone);
      const float* const drift = drifts_.advance(state, drone, {&move, 1});
      const double error = static_cast<double>(config_.noise_std_pa * noise + drift[0] + drift[1]);
      publish_pressure(std::max(static_cast<double>(readings_.truth().pressure[drone]) + error, 0.0), readings_.noisy(), drone);
    }
  }
  void publish_pressure(double pressure_pa, BarometerReadings& readings, DroneIndex drone) const {
    readings.pressure[drone] = static_cast<float>(pressure_pa);
    readings.height[drone] = static_cast<float>(altitude_of(pressure_pa) - static_cast<double>(config_.altitude_m));
  }

  BarometerConfig config_;
};

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const BarometerConfig& config, const SensorSetup& setup) {
  return std::make_unique<Barometer>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
