// Setpoint: converts a drone's command to the controller's input.
#pragma once

#include <array>
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

// The command of one drone.
struct SetpointInput {
  Pose now;                                 // current pose; used with Control::position only
  float step_s = 0.0F;                      // s, duration of a step
  std::array<float, kMaxRotors> command{};  // see Commands
  Pose from, target;                        // Commands::step_start and target
};

// Returns the setpoint that Stage describes. Rotor speeds are clamped to the rotors' limits, and 0 for rotors that the airframe
// does not have. Positions become relative to the current position.
Setpoint setpoint_of(Control control, const Airframe& frame, const SetpointInput& input);

// The heading of the body's x axis, rad: 0 along the world's x axis.
float yaw_of(const Quat& rotation);

// Kinematic motion, as in the thesis: within one flown step a drone moves straight to its setpoint and turns at a constant
// rate. // Pose after `substep` of `substeps` equal parts of the motion from `from` to `target`.
inline Pose integrate_kinematic(const Pose& from, const Pose& target, int substep, int substeps) {
  if (substep == substeps) return target;
  return collision::interpolate(from, target, static_cast<float>(substep) / static_cast<float>(substeps));
}

}  // namespace flockstep::dynamics
