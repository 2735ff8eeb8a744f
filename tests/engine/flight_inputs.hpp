// Control modes, commands and airframes for tests of flight.
#pragma once

#include "flockstep/drone_model.hpp"
#include "flockstep/dynamics.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep::testing {

inline constexpr std::array kFlightControls{Control::rotor_speeds,     Control::rotor_thrusts, Control::body_rates,
                                            Control::attitude,         Control::acceleration,  Control::velocity,
                                            Control::heading_velocity, Control::position};

// Returns random commands for a control mode, one row per airframe.
inline std::vector<float> flight_commands(Random& random, Control control, std::span<const Airframe> airframes) {
  std::vector<float> rows;
  for (const Airframe& frame : airframes) {
    for (int k = 0; k < 4; ++k) {
      const float x = random.within(-1.0F, 1.0F);
      switch (control) {
        case Control::rotor_speeds:
          rows.push_back(static_cast<float>(frame.hover_speed()) * (1.0F + 0.1F * x));
          break;
        case Control::rotor_thrusts:
          rows.push_back(static_cast<float>(frame.mass_kg * kGravity / 4.0) * (1.0F + 0.2F * x));
          break;
        case Control::body_rates:
        case Control::attitude:
          rows.push_back(k == 0 ? 9.81F + 3.0F * x : x);
          break;
        default:
          rows.push_back(3.0F * x);
      }
    }
  }
  return rows;
}

// Returns airframes that differ in every number and in the terms they have.
inline std::vector<Airframe> different_airframes() {
  std::vector<Airframe> frames;
  for (const std::string& name : DroneModel::names()) frames.push_back(*DroneModel::load(name).airframe());
  Airframe lifted = frames[0];
  lifted.rotor_lift = 1e-3;
  lifted.linear_drag = {0.1, 0.2, 0.3};
  Airframe instant = frames[1];
  instant.lag_up_s = instant.lag_down_s = 0.0;
  instant.rotor_drag = {};
  instant.rotor_inertia_kgm2 = 0.0;
  Airframe linear = frames[2];
  linear.thrust_n = {0.0, linear.max_thrust() / linear.max_speed_radps, 0.0};
  linear.radius_m = 0.0;
  linear.quadratic_drag = {0.01, 0.02, 0.03};
  frames.insert(frames.end(), {lifted, instant, linear});
  return frames;
}

}  // namespace flockstep::testing
