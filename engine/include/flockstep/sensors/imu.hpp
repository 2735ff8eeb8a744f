// ImuConfig: an inertial measurement unit, and its readings.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
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
    return field_list(array("accelerometer", &C::accelerometer,
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
                      array("imu_age_s", &C::age_s, {.unit = "s", .writer = "IMU", .about = "age of the reading"}));
  }
};

// An accelerometer and a gyroscope. The noise follows Kalibr's model: white noise, given by its density, and a drifting bias.
struct ImuConfig {
  using Readings = ImuReadings;  // what it publishes
  // The docstring.
  static constexpr const char* kAbout =
      "An inertial measurement unit.\n\n"
      "The accelerometer measures all acceleration except gravity: +9.81 m/s^2 along the body's z at rest and in hover, 0\n"
      "in free fall. It does not measure impacts. In a tick with a contact it reads only gravity and, if it is mounted off\n"
      "the centre, the centripetal acceleration. With kinematic motion it differentiates the poses of its readings, as if\n"
      "the drone were at rest before. The noise follows Kalibr's model: white noise, given by its density, and a bias that\n"
      "drifts.";

  std::string name = "imu";
  float accelerometer_noise_density = 0.0F;
  float accelerometer_random_walk = 0.0F;
  float accelerometer_bias_time_s = 0.0F;
  float accelerometer_bias_std_mps2 = 0.0F;
  float gyroscope_noise_density = 0.0F;
  float gyroscope_random_walk = 0.0F;
  float gyroscope_bias_time_s = 0.0F;
  float gyroscope_bias_std_radps = 0.0F;
  float scale_std = 0.0F;
  float misalignment_std_deg = 0.0F;
  float accelerometer_vibration_mps2 = 0.0F;
  float gyroscope_vibration_radps = 0.0F;
  std::optional<float> accelerometer_range_mps2;
  std::optional<float> gyroscope_range_radps;
  std::array<float, 3> offset_m{0.0F, 0.0F, 0.0F};
  std::array<float, 4> quat_wxyz{1.0F, 0.0F, 0.0F, 0.0F};
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = ImuConfig;
    constexpr FieldInfo kBiasTime{.about = "Correlation time of the bias. 0: a random walk.", .unit = "s", .limits = at_least(0)};
    constexpr auto bias_std = [](const char* unit) {
      return FieldInfo{.about = "Its standard deviation when an episode begins.", .unit = unit, .limits = between(0, 1000)};
    };
    constexpr auto vibration = [](const char* unit) {
      return FieldInfo{.about = "Amplitude by each rotor at 1000 rad/s, which grows with the speed's square.",
                       .unit = unit,
                       .limits = between(0, 1000)};
    };
    constexpr auto range = [](const char* unit) {
      return FieldInfo{.about = "Greatest reading of an axis. None: no limit.", .unit = unit, .limits = above(0)};
    };
    return field_list(
        field("name", &C::name, {.about = "Name, unique among the IMUs.", .form = Form::plain_name}),
        field("accelerometer_noise_density", &C::accelerometer_noise_density,
              {.about = "Density of the accelerometer's white noise.", .unit = "m/s^2/sqrt(Hz)", .limits = at_least(0)}),
        field("accelerometer_random_walk", &C::accelerometer_random_walk,
              {.about = "Density of the noise that moves the accelerometer's bias.",
               .unit = "m/s^3/sqrt(Hz)",
               .limits = at_least(0)}),
        field("accelerometer_bias_time_s", &C::accelerometer_bias_time_s, kBiasTime),
        field("accelerometer_bias_std_mps2", &C::accelerometer_bias_std_mps2, bias_std("m/s^2")),
        field("gyroscope_noise_density", &C::gyroscope_noise_density,
              {.about = "Density of the gyroscope's white noise.", .unit = "rad/s/sqrt(Hz)", .limits = at_least(0)}),
        field("gyroscope_random_walk", &C::gyroscope_random_walk,
              {.about = "Density of the noise that moves the gyroscope's bias.",
               .unit = "rad/s^2/sqrt(Hz)",
               .limits = at_least(0)}),
        field("gyroscope_bias_time_s", &C::gyroscope_bias_time_s, kBiasTime),
        field("gyroscope_bias_std_radps", &C::gyroscope_bias_std_radps, bias_std("rad/s")),
        field("scale_std", &C::scale_std,
              {.about = "Relative error of each axis's scale, drawn for each episode.", .limits = between(0, 1)}),
        field("misalignment_std_deg", &C::misalignment_std_deg,
              {.about = "Angles between measured and nominal axes, drawn for each episode.",
               .unit = "deg",
               .limits = between(0, 45)}),
        field("accelerometer_vibration_mps2", &C::accelerometer_vibration_mps2, vibration("m/s^2")),
        field("gyroscope_vibration_radps", &C::gyroscope_vibration_radps, vibration("rad/s")),
        field("accelerometer_range_mps2", &C::accelerometer_range_mps2, range("m/s^2")),
        field("gyroscope_range_radps", &C::gyroscope_range_radps, range("rad/s")), field("offset_m", &C::offset_m, kMountOffset),
        field("quat_wxyz", &C::quat_wxyz, kMountRotation), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  // Returns the IMU of a part, such as "bmi088", with its noise; docs/reference/sensors.md lists them. Throws
  // std::invalid_argument that lists the names.
  FLOCKSTEP_API static ImuConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API void check_motion(const DynamicsConfig& dynamics) const;  // refuses vibration of kinematic motion
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
