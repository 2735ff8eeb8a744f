// DynamicsConfig: how drones move, and what a task or a caller tells them.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/airframe.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/wind.hpp"

namespace flockstep {

enum class Motion : std::uint8_t {
  kinematic,  // straight to the setpoint, whatever it takes
  rotors,     // by forces, as the drone's airframe has them
};
template <>
struct EnumNames<Motion> {
  static constexpr std::array kNames{"kinematic", "rotors"};
};

// What four numbers tell a drone that flies by its rotors. Thrust is that of all rotors over the mass; yaw is the heading of the
// body's x axis, 0 along the world's x axis, counter-clockwise.
enum class Control : std::uint8_t {
  pose,              // a pose to be at by the end of the step, as for kinematic motion: flown as a velocity and a yaw rate
  rotor_speeds,      // rad/s, of each rotor
  rotor_thrusts,     // N, of each rotor at rest
  body_rates,        // thrust m/s^2, body rates about x, y, z rad/s
  attitude,          // thrust m/s^2, roll, pitch, yaw rad
  acceleration,      // m/s^2, world frame; yaw rad
  velocity,          // m/s, world frame; yaw rate rad/s
  heading_velocity,  // m/s, forward, left, up; yaw rate rad/s
  position,          // m, world frame; yaw rad
};
template <>
struct EnumNames<Control> {
  static constexpr std::array kNames{"pose",         "rotor_speeds", "rotor_thrusts",    "body_rates", "attitude",
                                     "acceleration", "velocity",     "heading_velocity", "position"};
};

// How the equations of motion are solved in each tick.
enum class Integrator : std::uint8_t {
  automatic,  // rk4 for rotor speeds and thrusts, where ticks are not longer than twice the lag; else midpoint
  midpoint,   // second order; rotor speeds and attitude by their closed forms
  rk4,        // fourth order
};
template <>
struct EnumNames<Integrator> {
  static constexpr std::array kNames{"automatic", "midpoint", "rk4"};
};

// What happens to a drone that flies by its rotors and hits something.
enum class OnContact : std::uint8_t {
  terminate,  // it stays where it hit, and its episode ends with the step
  stop,       // the point that touches stops, and the drone flies on
  bounce,     // it is thrown back, by restitution and friction, and flies on
};
template <>
struct EnumNames<OnContact> {
  static constexpr std::array kNames{"terminate", "stop", "bounce"};
};

struct DynamicsConfig {
  Motion motion = Motion::kinematic;
  Control control = Control::pose;  // kinematic motion knows poses alone
  Integrator integrator = Integrator::automatic;
  OnContact on_contact = OnContact::terminate;
  float restitution = 0.3F;  // of a bounce: speed away from the surface over speed towards it, in [0, 1]
  float friction = 0.5F;     // of a bounce: Coulomb's coefficient, in [0, 10]
  // What the equations of motion have beside gravity, thrust and inertia, where the airframe has numbers for it.
  bool rotor_lag = true;   // rotors take time to change their speed
  bool rotor_drag = true;  // and lift, of rotors that move through the air
  bool body_drag = true;
  bool gyroscopic = true;      // what turning rotors do to a turning body
  bool ground_effect = false;  // more thrust near what is below
  WindConfig wind;
  // What the controller keeps to, and what an action of 1 means.
  float max_speed_mps = 5.0F;
  float max_acceleration_mps2 = 8.0F;
  float max_tilt_deg = 45.0F;   // in (0, 89]
  float max_rate_dps = 600.0F;  // about x and y
  float max_yaw_rate_dps = 200.0F;

  static constexpr auto fields() {
    using C = DynamicsConfig;
    return field_list(field("motion", &C::motion), field("control", &C::control), field("integrator", &C::integrator),
                      field("on_contact", &C::on_contact), field("restitution", &C::restitution), field("friction", &C::friction),
                      field("rotor_lag", &C::rotor_lag), field("rotor_drag", &C::rotor_drag), field("body_drag", &C::body_drag),
                      field("gyroscopic", &C::gyroscopic), field("ground_effect", &C::ground_effect), field("wind", &C::wind),
                      field("max_speed_mps", &C::max_speed_mps), field("max_acceleration_mps2", &C::max_acceleration_mps2),
                      field("max_tilt_deg", &C::max_tilt_deg), field("max_rate_dps", &C::max_rate_dps),
                      field("max_yaw_rate_dps", &C::max_yaw_rate_dps));
  }

  void validate() const;

  bool is_kinematic() const { return motion == Motion::kinematic; }
  bool tells_rotors() const { return control == Control::rotor_speeds || control == Control::rotor_thrusts; }
};

}  // namespace flockstep
