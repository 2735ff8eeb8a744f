// Setpoint: converts a drone's command to the controller's input.
#pragma once

#include <optional>
#include <span>

#include "collision/sweep.hpp"
#include "dynamics/flight.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// The commands of a batch.
struct Commands {
  std::span<const float> command;    // (N, C) numbers, see Control; unused with Control::pose
  std::span<const Pose> target;      // (N,) poses at the end of the step; used with Control::pose only
  std::span<const Pose> step_start;  // (N,) poses at the start of the step; used with Control::pose only
  std::optional<Control> control{};  // meaning of the commands; by default DynamicsConfig::control
};

// Returns the setpoint that Stage describes, for the command of a drone at a position. Rotor speeds are clamped to the rotors'
// limits, and 0 for rotors that the airframe does not have. Positions become relative to the given one.
Setpoint setpoint_of(Control control, const Airframe& frame, const float* command, const float* position);
// The same for Control::pose: moves from one pose to the other within this time.
Setpoint setpoint_of(const Pose& from, const Pose& target, float step_s);

// The heading of the body's x axis, rad: 0 along the world's x axis.
float yaw_of(const Quat& rotation);

// Kinematic motion, as in the thesis: within one flown step a drone moves straight to its setpoint and turns at a constant
// rate.
//
// Pose after `substep` of `substeps` equal parts of the motion from `from` to `target`.
inline Pose integrate_kinematic(const Pose& from, const Pose& target, int substep, int substeps) {
  if (substep == substeps) return target;
  return collision::interpolate(from, target, static_cast<float>(substep) / static_cast<float>(substeps));
}

}  // namespace flockstep::dynamics
