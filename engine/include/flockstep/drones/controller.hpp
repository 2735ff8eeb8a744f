// ControllerConfig: the gains, the limits and the lag of the flight controller.
#pragma once

#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// The controller is a cascade: position to velocity, velocity to acceleration, attitude to body rates, body rates to torques, and
// a mixer. A gain is a rate: the inner loops multiply an error by it, 1/s. Without a value, a gain follows from the lag of the
// rotors, so that each loop is well damped and three times as slow as the one inside it; docs/concepts/flight-model.md has the
// formulas.
struct ControllerConfig {
  std::optional<float> rate_gain_per_s;
  std::optional<float> yaw_rate_gain_per_s;
  std::optional<float> attitude_gain_per_s;
  std::optional<float> yaw_gain_per_s;
  std::optional<float> velocity_gain_per_s;
  std::optional<float> velocity_integral_per_s2;
  std::optional<float> position_gain_per_s;
  std::optional<float> lead;
  float command_lag_s = 0.0F;
  float min_throttle = 0.0F;
  float max_throttle = 1.0F;

  static constexpr auto fields() {
    using C = ControllerConfig;
    constexpr Limits kGain = between(0.01, 1000);
    return field_list(
        field("rate_gain_per_s", &C::rate_gain_per_s,
              {.about = "Angular acceleration per error of the body rates about x and y. None: by the rotors' lag.",
               .unit = "1/s",
               .limits = kGain}),
        field("yaw_rate_gain_per_s", &C::yaw_rate_gain_per_s,
              {.about = "Angular acceleration per error of the rate about z. None: a third of ``rate_gain_per_s``.",
               .unit = "1/s",
               .limits = kGain}),
        field(
            "attitude_gain_per_s", &C::attitude_gain_per_s,
            {.about = "Body rate per error of the tilt. None: a third of ``rate_gain_per_s``.", .unit = "1/s", .limits = kGain}),
        field("yaw_gain_per_s", &C::yaw_gain_per_s,
              {.about = "Yaw rate per error of the heading. None: a third of ``attitude_gain_per_s``.",
               .unit = "1/s",
               .limits = kGain}),
        field("velocity_gain_per_s", &C::velocity_gain_per_s,
              {.about = "Acceleration per error of the velocity. None: a third of ``attitude_gain_per_s``.",
               .unit = "1/s",
               .limits = kGain}),
        field("velocity_integral_per_s2", &C::velocity_integral_per_s2,
              {.about = "Acceleration per integral of that error. None: a tenth of the square of ``velocity_gain_per_s``.",
               .unit = "1/s^2",
               .limits = between(1e-4, 1e4)}),
        field("position_gain_per_s", &C::position_gain_per_s,
              {.about = "Velocity per error of the position. None: half of ``velocity_gain_per_s``.",
               .unit = "1/s",
               .limits = kGain}),
        field("lead", &C::lead,
              {.about = "Factor of a commanded change of rotor speed, which makes slow rotors quicker. None: their lag "
                        "divided by 35 ms, clipped to 1 to 4.",
               .limits = between(1, 10)}),
        field("command_lag_s", &C::command_lag_s,
              {.about = "Time constant of a low-pass filter between controller and rotors. 0: none.",
               .unit = "s",
               .limits = between(0, 1)}),
        field(
            "min_throttle", &C::min_throttle,
            {.about = "Least thrust that the mixer commands of a rotor, as a share of its greatest.", .limits = between(0, 0.5)}),
        field("max_throttle", &C::max_throttle,
              {.about = "Greatest thrust that the mixer commands of a rotor, as a share of its greatest.",
               .limits = between(0.5, 1)}));
  }

  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
