// Scores and observations of Hover for sixteen drones side by side. Every operation rounds correctly, so all SIMD targets
// agree. The results of a drone depend only on that drone.
#pragma once

#include <array>
#include <cstddef>

#include "dynamics/flight.hpp"

namespace flockstep::task {

inline constexpr std::size_t kHoverNumbers = 16;  // size of an observation, without the rotors from the fifth on

// The inputs: kLanes rows of each array.
struct HoverRows {
  const float* target;            // (kLanes, 3) m, points to hold
  const float* position;          // (kLanes, 3) m
  const float* quat_wxyz;         // (kLanes, 4); observations only
  const float* velocity;          // (kLanes, 3) m/s
  const float* angular_velocity;  // (kLanes, 3) rad/s
  const float* rotor_speed;       // (kLanes, 4) rad/s; observations only
  const float* action;            // (kLanes, 4), or null for a change of 0; scores only
  const float* action_before;     // (kLanes, 4), or null; scores only
};

struct alignas(64) HoverScores {
  std::array<double, dynamics::kLanes> distance;  // m, to the point to hold
  std::array<double, dynamics::kLanes> holding;   // 1 / (1 + (distance / reach)^2)
  dynamics::Lane closeness;                       // e^(-2 distance / m)
  dynamics::Lane speed;                           // m/s
  dynamics::Lane spin;                            // rad/s
  dynamics::Lane change;                          // mean squared change of the action
};
void score_hover(const HoverRows& rows, double reach_m, HoverScores& scores);

// Scale of observed rotor speeds, of each drone: 0 at hover speed, -1 and 1 at the slowest and fastest speed.
struct alignas(64) RotorUnits {
  dynamics::Lane hovering, inverse_below, inverse_above;  // rad/s, s/rad
};
// Writes rows (kLanes, kHoverNumbers): vector to the point, velocity, up and angular velocity in units of spin_unit, all in the
// body frame, then the rotor speeds.
void observe_hover(const HoverRows& rows, const RotorUnits& rotors, float spin_unit, float* out);

}  // namespace flockstep::task
