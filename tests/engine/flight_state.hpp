// A State for drones with simulated rotors without a batch, access to its arrays by name, and commands and airframes.
#pragma once

#include <type_traits>

#include "dynamics/wind.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/state.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep::testing {

// Returns a state with all drones at the origin, upright and at rest, in world 0. Env i has seed i.
inline State flight_state(std::size_t num_envs, std::size_t drones_per_env) {
  const std::size_t n = num_envs * drones_per_env;
  State state;
  for (auto* const array :
       {&state.position, &state.contact.point, &state.contact.normal, &state.contact.surface_velocity, &state.flight.velocity,
        &state.flight.angular_velocity, &state.flight.acceleration, &state.flight.angular_acceleration,
        &state.flight.error_integral, &state.flight.remainder, &state.flight.wind}) {
    array->resize(3 * n);
  }
  for (auto* const array : {&state.quat_wxyz, &state.flight.rotor_speed, &state.flight.rotor_command}) array->resize(4 * n);
  for (std::size_t drone = 0; drone < n; ++drone) state.quat_wxyz[4 * drone] = 1.0F;
  state.flight.gust.resize(dynamics::kGustStates * n);
  state.contact.fraction.resize(n);
  for (auto* const others : {&state.contact.body, &state.contact.drone}) others->assign(n, -1);
  for (auto* const flags : {&state.contact.hit, &state.contact.inside, &state.active}) flags->resize(n);
  std::fill(state.active.begin(), state.active.end(), 1);
  state.world_index.resize(num_envs);
  for (std::size_t env = 0; env < num_envs; ++env) state.seed.push_back(env);
  for (auto* const numbers : {&state.episode, &state.tick, &state.sensed}) numbers->resize(num_envs);
  return state;
}

// Calls f(name, array) for every float array of a State, which may be const.
template <class T, class F>
void for_each_float_array(T& arrays, const F& f) {
  for_each_field(arrays, [&](const auto& field, auto& value) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (HasFields<Value>) {
      for_each_float_array(value, f);
    } else if constexpr (std::is_same_v<Value, std::vector<float>>) {
      f(std::string(field.name), value);
    }
  });
}

// Calls f(name, values, others) for every float array of two states.
template <class F>
void for_each_float_array(const State& a, const State& b, const F& f) {
  for_each_float_array(a, [&](const std::string& name, const std::vector<float>& values) {
    for_each_float_array(b, [&](const std::string& other, const std::vector<float>& others) {
      if (name == other) f(name, values, others);
    });
  });
}

inline bool is_written_by_flight(std::string_view name) {
  constexpr std::string_view kNames[]{"position",       "quat_wxyz",     "velocity",    "angular_velocity",
                                      "acceleration",   "rotor_command", "rotor_speed", "angular_acceleration",
                                      "error_integral", "remainder"};
  return std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
}

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

// Returns quadrotors that differ in every number and in the terms they have.
inline std::vector<Airframe> different_airframes() {
  std::vector<Airframe> frames;
  for (const std::string& name : DroneModel::names()) {
    const Airframe frame = *DroneModel::load(name).airframe();
    if (frame.num_rotors() == kMinRotors) frames.push_back(frame);
  }
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
