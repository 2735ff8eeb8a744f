// Setpoint: a drone's command in the form that the controller takes.
#pragma once

#include <array>
#include <span>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// The commands of a batch.
struct Commands {
  std::span<const float> command;    // (N, 4) numbers as Control describes them; unused with Control::pose
  std::span<const Pose> target;      // (N,) poses at the end of the step; used with Control::pose only
  std::span<const Pose> step_start;  // (N,) poses at the begin of the step; used with Control::pose only
};

// The command of one drone.
struct SetpointInput {
  Pose now;                        // the present pose; used with Control::position only
  float step_s = 0.0F;             // duration of a step
  std::array<float, 4> command{};  // as in Commands
  Pose from, target;               // Commands::step_start and target
};

// The numbers that Stage describes. Rotor speeds are clamped to the rotors' limits; positions become relative to the present one.
std::array<float, 7> setpoint_of(const DynamicsConfig& config, const Airframe& frame, const SetpointInput& input);

// The heading of the body's x axis: 0 along the world's x axis, rad.
float yaw_of(const Quat& rotation);

}  // namespace flockstep::dynamics
