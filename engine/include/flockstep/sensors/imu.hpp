// ImuConfig: an inertial measurement unit, and its readings. It requires rotor motion.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "flockstep/arrays.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// Readings of one IMU.
struct ImuReadings {
  std::vector<float> accelerometer;
  std::vector<float> gyroscope;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = ImuReadings;
    return field_list(
        array("accelerometer", &C::accelerometer,
              {.columns = 3,
               .unit = "m/s^2",
               .frame = Frame::sensor,
               .writer = "IMU",
               .about = "latest reading of the specific force"}),
        array("gyroscope", &C::gyroscope,
              {.columns = 3,
               .unit = "rad/s",
               .frame = Frame::sensor,
               .writer = "IMU",
               .about = "latest reading of the angular velocity"}),
        array("imu_age_s", &C::age_s, {.unit = "s", .writer = "IMU", .about = "age of the newest reading that has arrived"}));
  }
};

// An accelerometer and a gyroscope. The noise follows Kalibr's model: white noise, given by its density, and a drifting bias.
struct ImuConfig {
  using Readings = ImuReadings;  // what it publishes

  std::string name = "imu";
  float accelerometer_noise_density = 0.0F;
  float accelerometer_random_walk = 0.0F;
  float accelerometer_bias_time_s = 0.0F;
  float gyroscope_noise_density = 0.0F;
  float gyroscope_random_walk = 0.0F;
  float gyroscope_bias_time_s = 0.0F;
  std::array<float, 3> offset_m{0.0F, 0.0F, 0.0F};
  std::array<float, 4> quat_wxyz{1.0F, 0.0F, 0.0F, 0.0F};
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = ImuConfig;
    constexpr FieldInfo kBiasTime{.about = "Correlation time of the bias. 0: a random walk.", .unit = "s", .limits = at_least(0)};
    return field_list(
        field("name", &C::name, {.about = "Name, unique among the IMUs.", .form = Form::plain_name}),
        field("accelerometer_noise_density", &C::accelerometer_noise_density,
              {.about = "Density of the accelerometer's white noise.", .unit = "m/s^2/sqrt(Hz)", .limits = at_least(0)}),
        field("accelerometer_random_walk", &C::accelerometer_random_walk,
              {.about = "Density of the noise that moves the accelerometer's bias, 0 at an episode's beginning.",
               .unit = "m/s^3/sqrt(Hz)",
               .limits = at_least(0)}),
        field("accelerometer_bias_time_s", &C::accelerometer_bias_time_s, kBiasTime),
        field("gyroscope_noise_density", &C::gyroscope_noise_density,
              {.about = "Density of the gyroscope's white noise.", .unit = "rad/s/sqrt(Hz)", .limits = at_least(0)}),
        field("gyroscope_random_walk", &C::gyroscope_random_walk,
              {.about = "Density of the noise that moves the gyroscope's bias.",
               .unit = "rad/s^2/sqrt(Hz)",
               .limits = at_least(0)}),
        field("gyroscope_bias_time_s", &C::gyroscope_bias_time_s, kBiasTime), field("offset_m", &C::offset_m, kMountOffset),
        field("quat_wxyz", &C::quat_wxyz, kMountRotation), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API void check_motion(const DynamicsConfig& dynamics) const;  // refuses kinematic motion
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
