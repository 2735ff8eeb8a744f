// What Hover scores and observes, of sixteen drones side by side. Every operation rounds correctly, so that all SIMD targets
// agree, and what comes out for a drone depends on that drone alone.
#pragma once

#include <array>
#include <cstddef>

#include "dynamics/flight.hpp"

namespace flockstep::task {

inline constexpr std::size_t kHoverNumbers = 16;  // of an observation

// Rows of arrays, kLanes of each.
struct HoverRows {
  const float* target;            // (kLanes, 3) m: the points to hold
  const float* position;          // (kLanes, 3) m
  const float* quat_wxyz;         // (kLanes, 4); of observations alone
  const float* velocity;          // (kLanes, 3) m/s
  const float* angular_velocity;  // (kLanes, 3) rad/s
  const float* rotor_speed;       // (kLanes, 4) rad/s; of observations alone
  const float* action;            // (kLanes, 4); of scores alone, like what follows
  const float* action_before;     // (kLanes, 4)
};

struct alignas(64) HoverScores {
  std::array<double, dynamics::kLanes> distance;  // m, from the point to hold
  std::array<double, dynamics::kLanes> holding;   // 1 / (1 + (distance / reach)^2)
  dynamics::Lane closeness;                       // e^(-2 distance / m)
  dynamics::Lane speed;                           // m/s
  dynamics::Lane spin;                            // rad/s
  dynamics::Lane change;                          // mean square of what the action changed by
};
void score_hover(const HoverRows& rows, double reach_m, HoverScores& scores);

// How speeds of rotors are observed: 0 in hovering, -1 and 1 at the slowest and the fastest.
struct RotorUnits {
  float hovering = 0.0F, inverse_below = 1.0F, inverse_above = 1.0F;  // rad/s, s/rad
};
// Rows (kLanes, kHoverNumbers): way to the point, velocity, up, angular velocity in units of spin_unit, rotor speeds; all but the
// last in the frame of the body.
void observe_hover(const HoverRows& rows, const RotorUnits& rotors, float spin_unit, float* out);

}  // namespace flockstep::task
