// GpsReceiverConfig: a receiver of satellite navigation, and its readings.
#pragma once

#include <cstdint>
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

// Readings of one receiver.
struct GpsReceiverReadings {
  std::vector<float> position;
  std::vector<float> velocity;
  std::vector<std::uint8_t> fix;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = GpsReceiverReadings;
    constexpr const char* kWriter = "GPS receiver";
    return field_list(
        array("gps_position", &C::position,
              {.columns = 3, .unit = "m", .frame = Frame::world, .writer = kWriter, .about = "latest position with a fix"}),
        array("gps_velocity", &C::velocity,
              {.columns = 3,
               .unit = "m/s",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "latest velocity with a fix. Empty with kinematic motion"}),
        array("gps_fix", &C::fix, {.values = Values::flag, .writer = kWriter, .about = "True if the latest reading has a fix"}),
        array("gps_age_s", &C::age_s, {.unit = "s", .writer = kWriter, .about = "age of the reading"}));
  }
};

// Position and velocity with white noise, an error that wanders slowly, and times without a fix.
struct GpsReceiverConfig {
  using Readings = GpsReceiverReadings;  // what it publishes
  // The docstring.
  static constexpr const char* kAbout =
      "A GPS receiver: position and velocity with errors, and times without a fix, in which they keep their last values.";

  std::string name = "gps";
  float noise_std_m = 0.0F;
  float drift_std_m = 0.0F;
  float drift_time_s = 30.0F;
  float velocity_noise_std_mps = 0.0F;
  float vertical_factor = 1.5F;
  float outages_per_s = 0.0F;
  float outage_s = 5.0F;
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = GpsReceiverConfig;
    return field_list(
        field("name", &C::name, {.about = "Name, unique among them.", .form = Form::plain_name}),
        field("noise_std_m", &C::noise_std_m,
              {.about = "Gaussian noise of the position along x and y.", .unit = "m", .limits = between(0, 1000)}),
        field("drift_std_m", &C::drift_std_m,
              {.about = "Its drift along x and y (Gauss-Markov).", .unit = "m", .limits = between(0, 1000)}),
        field("drift_time_s", &C::drift_time_s, kDriftTime),
        field("velocity_noise_std_mps", &C::velocity_noise_std_mps,
              {.about = "Gaussian noise of the velocity along x and y.", .unit = "m/s", .limits = between(0, 1000)}),
        field("vertical_factor", &C::vertical_factor, {.about = "Factor of the errors along z.", .limits = between(0, 100)}),
        field("outages_per_s", &C::outages_per_s,
              {.about = "Mean number of times that the fix is lost.", .unit = "1/s", .limits = between(0, 10)}),
        field("outage_s", &C::outage_s,
              {.about = "Mean time until it returns, exponentially distributed.", .unit = "s", .limits = between(0.01, 1e6)}),
        field("rate_hz", &C::rate_hz, kSensorRate), field("latency_s", &C::latency_s, kSensorLatency),
        field("jitter_s", &C::jitter_s, kSensorJitter), field("loss", &C::loss, kSensorLoss));
  }

  // Returns a receiver; docs/reference/sensors.md lists them. Throws std::invalid_argument that lists the names.
  FLOCKSTEP_API static GpsReceiverConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const GpsReceiverConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
