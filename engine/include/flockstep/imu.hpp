// ImuConfig: an inertial measurement unit, for drones that fly by their rotors.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "flockstep/fields.hpp"

namespace flockstep {

// An accelerometer and a gyroscope. The noise is that of Kalibr's model: white noise by its density, and a bias that walks.
struct ImuConfig {
  std::string name = "imu";                  // unique among the IMUs: letters, digits, _ and -
  float accelerometer_noise_density = 0.0F;  // m/s^2/sqrt(Hz), >= 0
  float accelerometer_random_walk = 0.0F;    // m/s^3/sqrt(Hz), >= 0: of the bias, which begins an episode at 0
  float accelerometer_bias_time_s = 0.0F;    // in which the bias forgets; 0: never
  float gyroscope_noise_density = 0.0F;      // rad/s/sqrt(Hz), >= 0
  float gyroscope_random_walk = 0.0F;        // rad/s^2/sqrt(Hz), >= 0
  float gyroscope_bias_time_s = 0.0F;
  std::array<float, 3> offset_m{0.0F, 0.0F, 0.0F};         // of the sensor, body frame
  std::array<float, 4> quat_wxyz{1.0F, 0.0F, 0.0F, 0.0F};  // sensor to body
  std::optional<float> rate_hz;                            // readings per second; none: one after every step

  static constexpr auto fields() {
    using C = ImuConfig;
    return field_list(field("name", &C::name), field("accelerometer_noise_density", &C::accelerometer_noise_density),
                      field("accelerometer_random_walk", &C::accelerometer_random_walk),
                      field("accelerometer_bias_time_s", &C::accelerometer_bias_time_s),
                      field("gyroscope_noise_density", &C::gyroscope_noise_density),
                      field("gyroscope_random_walk", &C::gyroscope_random_walk),
                      field("gyroscope_bias_time_s", &C::gyroscope_bias_time_s), field("offset_m", &C::offset_m),
                      field("quat_wxyz", &C::quat_wxyz), field("rate_hz", &C::rate_hz));
  }

  void validate() const;
};

}  // namespace flockstep
