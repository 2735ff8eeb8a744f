// DynamicsConfig: the motion model of the drones, and the meaning of their commands.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/airframe.hpp"
#include "flockstep/drones/controller.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/wind.hpp"

namespace flockstep {

// How drones move: straight to the setpoint, or under simulated forces.
enum class Motion : std::uint8_t { kinematic, rotors };
template <>
struct EnumNames<Motion> {
  static constexpr std::array kNames{"kinematic", "rotors"};
};

// Meaning of the numbers that command a drone in rotor motion: one for each rotor, or else four. Thrust is the total thrust of
// all rotors divided by the mass. Yaw is the heading of the body's x axis: 0 along the world's x axis, counter-clockwise
// positive.
enum class Control : std::uint8_t {
  pose,              // pose at the end of the step, as in kinematic motion; flown as a velocity and a yaw rate
  rotor_speeds,      // rad/s, each rotor
  rotor_thrusts,     // N, each rotor, in still air
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

// True if commands are for single rotors, without the controller.
constexpr bool tells_rotors(Control control) { return control == Control::rotor_speeds || control == Control::rotor_thrusts; }

// Method for the equations of motion.
enum class Integrator : std::uint8_t { automatic, midpoint, rk4 };
template <>
struct EnumNames<Integrator> {
  static constexpr std::array kNames{"automatic", "midpoint", "rk4"};
};

// Effect of a contact.
enum class OnContact : std::uint8_t { terminate, stop, bounce };
template <>
struct EnumNames<OnContact> {
  static constexpr std::array kNames{"terminate", "stop", "bounce"};
};

struct DynamicsConfig {
  Motion motion = Motion::kinematic;
  Control control = Control::pose;
  Integrator integrator = Integrator::automatic;
  OnContact on_contact = OnContact::terminate;
  float restitution = 0.3F;
  float friction = 0.5F;
  bool rotor_lag = true;
  bool rotor_drag = true;
  bool body_drag = true;
  bool gyroscopic = true;
  bool ground_effect = false;
  bool downwash = false;
  ControllerConfig controller;
  WindConfig wind;
  float max_speed_mps = 5.0F;
  float max_acceleration_mps2 = 8.0F;
  float max_tilt_deg = 45.0F;
  float max_rate_dps = 600.0F;
  float max_yaw_rate_dps = 200.0F;

  // A term of the equations of motion is off if the airframe defines no coefficient for it, even if its switch is on. The max_
  // fields are the limits of the controller; an action of 1 commands the limit.
  static constexpr auto fields() {
    using C = DynamicsConfig;
    return field_list(
        field("motion", &C::motion,
              {.about = "``\"kinematic\"``: straight to the setpoint. ``\"rotors\"``: by simulated forces, with an airframe."}),
        field("control", &C::control, {.about = "Meaning of commands. Kinematic motion supports only ``\"pose\"``."}),
        field("integrator", &C::integrator,
              {.about = "``\"midpoint\"``: second order, with rotor speeds and attitude in closed form. ``\"rk4\"``: fourth "
                        "order. ``\"automatic\"``: rk4 if ``control`` is rotor speeds or thrusts and a tick is at most twice the "
                        "rotors' lag, otherwise midpoint."}),
        field("on_contact", &C::on_contact,
              {.about = "``\"terminate\"``: the drone stays where it hit, and its episode ends with the step. ``\"stop\"``: the "
                        "points of contact come to rest, and it flies on. ``\"bounce\"``: it bounces back."}),
        field("restitution", &C::restitution,
              {.about = "Speed away from the surface divided by the speed towards it, in a bounce.", .limits = between(0, 1)}),
        field("friction", &C::friction, {.about = "Coulomb's coefficient of friction, in a bounce.", .limits = between(0, 10)}),
        field("rotor_lag", &C::rotor_lag, {.about = "Rotors take time to change their speed."}),
        field("rotor_drag", &C::rotor_drag, {.about = "Drag and lift of rotors that move through the air."}),
        field("body_drag", &C::body_drag, {.about = "Drag of the body."}),
        field("gyroscopic", &C::gyroscopic, {.about = "Gyroscopic torques of the rotors on a turning body."}),
        field("ground_effect", &C::ground_effect, {.about = "More thrust near surfaces below."}),
        field("downwash", &C::downwash,
              {.about = "Less thrust in the wash of other drones of the env, for any ``interaction``."}),
        field("controller", &C::controller, {.about = "Gains, limits and lag of the flight controller."}),
        field("wind", &C::wind, {.about = "Wind, by default none."}),
        field("max_speed_mps", &C::max_speed_mps, {.about = "Speed limit of the controller.", .unit = "m/s", .limits = above(0)}),
        field("max_acceleration_mps2", &C::max_acceleration_mps2,
              {.about = "Acceleration limit of the controller.", .unit = "m/s^2", .limits = above(0)}),
        field("max_tilt_deg", &C::max_tilt_deg,
              {.about = "Tilt limit of the controller.", .unit = "deg", .limits = above_up_to(0, 89)}),
        field("max_rate_dps", &C::max_rate_dps,
              {.about = "Limit of the controller's rates about x and y.", .unit = "deg/s", .limits = above(0)}),
        field("max_yaw_rate_dps", &C::max_yaw_rate_dps,
              {.about = "Limit of the controller's rate about z.", .unit = "deg/s", .limits = above(0)}));
  }

  FLOCKSTEP_API void validate() const;

  bool is_kinematic() const { return motion == Motion::kinematic; }  // true if drones move straight to their setpoints
  bool tells_rotors() const {
    return flockstep::tells_rotors(control);
  }  // true if commands are for single rotors, without the controller
};

}  // namespace flockstep
