// Setpoint: what a drone is told, in the form in which the controller takes it.
#pragma once

#include <array>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

struct Wish {
  Pose now;                        // for Control::position: where the drone is
  float step_s = 0.0F;             // how long a step is
  std::array<float, 4> command{};  // as Control says
  Pose from, target;               // instead of it, for Control::pose: where the step began, and where it is to end
};

// The numbers that Stage describes. Rotor speeds are kept within the rotors' limits; positions are relative to where the drone
// is.
std::array<float, 7> setpoint_of(const DynamicsConfig& config, const Airframe& frame, const Wish& wish);

// The heading of the body's x axis: 0 along the world's x axis, rad.
float yaw_of(const Quat& rotation);

}  // namespace flockstep::dynamics
