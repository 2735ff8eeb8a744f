// BarometerConfig: a barometer, and its readings.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/arrays.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// Readings of one barometer.
struct BarometerReadings {
  std::vector<float> pressure;
  std::vector<float> height;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = BarometerReadings;
    return field_list(
        array("pressure", &C::pressure, {.unit = "Pa", .writer = "barometer", .about = "latest reading of the pressure"}),
        array("pressure_height", &C::height,
              {.unit = "m", .writer = "barometer", .about = "height above z = 0 at which the air has this pressure"}),
        array("pressure_age_s", &C::age_s, {.unit = "s", .writer = "barometer", .about = "age of the reading"}));
  }
};

// The pressure of the International Standard Atmosphere at the drone.
struct BarometerConfig {
  using Readings = BarometerReadings;  // what it publishes
  static constexpr const char* kAbout = "A barometer in the International Standard Atmosphere.";

  std::string name = "barometer";
  float altitude_m = 0.0F;
  float noise_std_pa = 0.0F;
  float bias_std_pa = 0.0F;
  float drift_std_pa = 0.0F;
  float drift_time_s = 3600.0F;
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = BarometerConfig;
    return field_list(
        field("name", &C::name, {.about = "Name, unique among the barometers.", .form = Form::plain_name}),
        field("altitude_m", &C::altitude_m,
              {.about = "Altitude of the world's z = 0 above sea level.", .unit = "m", .limits = between(-1000, 10000)}),
        field("noise_std_pa", &C::noise_std_pa, {.about = "Gaussian noise.", .unit = "Pa", .limits = between(0, 10000)}),
        field("bias_std_pa", &C::bias_std_pa,
              {.about = "Constant error, drawn for each episode.", .unit = "Pa", .limits = between(0, 10000)}),
        field("drift_std_pa", &C::drift_std_pa,
              {.about = "Drift from 0, which approaches this deviation (Gauss-Markov).",
               .unit = "Pa",
               .limits = between(0, 10000)}),
        field("drift_time_s", &C::drift_time_s, kDriftTime), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  // Returns the barometer of a simulator or a part; docs/reference/sensors.md lists them. Throws std::invalid_argument that lists
  // the names.
  FLOCKSTEP_API static BarometerConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const BarometerConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
