// MagnetometerConfig: a magnetometer, and its readings.
#pragma once

#include <array>
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

// Readings of one magnetometer.
struct MagnetometerReadings {
  std::vector<float> field;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = MagnetometerReadings;
    return field_list(array("magnetic_field", &C::field,
                            {.columns = 3,
                             .unit = "uT",
                             .frame = Frame::sensor,
                             .writer = "magnetometer",
                             .about = "latest reading of the magnetic field"}),
                      array("magnetic_age_s", &C::age_s, {.unit = "s", .writer = "magnetometer", .about = "age of the reading"}));
  }
};

// A magnetometer in a field that is the same everywhere. It reads (1 + A) B + h + noise, with the field B in its frame.
struct MagnetometerConfig {
  using Readings = MagnetometerReadings;  // what it publishes
  static constexpr const char* kAbout = "A magnetometer in a field that is the same everywhere.";

  std::string name = "magnetometer";
  std::array<float, 3> field_ut{0.0F, 20.0F, -45.0F};
  float noise_std_ut = 0.0F;
  float hard_iron_std_ut = 0.0F;
  float soft_iron_std = 0.0F;
  std::array<float, 4> quat_wxyz{1.0F, 0.0F, 0.0F, 0.0F};
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = MagnetometerConfig;
    return field_list(
        field("name", &C::name, {.about = "Name, unique among the magnetometers.", .form = Form::plain_name}),
        field("field_ut", &C::field_ut,
              {.about = "The field, world frame. The default is about central Europe's.", .unit = "uT", .limits = within(1000)}),
        field("noise_std_ut", &C::noise_std_ut, {.about = "Gaussian noise.", .unit = "uT", .limits = between(0, 1000)}),
        field("hard_iron_std_ut", &C::hard_iron_std_ut,
              {.about = "Constant error, drawn for each episode.", .unit = "uT", .limits = between(0, 1000)}),
        field("soft_iron_std", &C::soft_iron_std,
              {.about = "Elements of a matrix A, drawn for each episode. The field is multiplied by 1 + A.",
               .limits = between(0, 1)}),
        field("quat_wxyz", &C::quat_wxyz, kMountRotation), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  // Returns the magnetometer of a simulator; docs/reference/sensors.md lists them. Throws std::invalid_argument that lists the
  // names.
  FLOCKSTEP_API static MagnetometerConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const MagnetometerConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
