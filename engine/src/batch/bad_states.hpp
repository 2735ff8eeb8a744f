// Bad states: a pose, a reward or an observation that is no finite number. It ends the episode of its env, which is flagged,
// counted and reset like any other, and goes no further.
#pragma once

#include <cmath>
#include <cstddef>

#include "batch/schedule.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

// In the world, and turned by a unit quaternion.
inline bool is_valid(const Pose& pose) {
  constexpr float kTolerance = 0.02F;                                                              // of a squared norm
  return is_in_world(pose.position) && std::abs(pose.rotation.squaredNorm() - 1.0F) < kTolerance;  // false for NaN, too
}

// A number of this row is not finite: its episode ends in the present step, or in the next if none is under way.
void mark_bad(Simulation& sim, std::size_t row);

// Setpoints of the envs that fly. A drone whose setpoint is no pose in the world stays where it is.
void check_setpoints(Simulation& sim, Block& block);

// Whether a number of an observation is none: neither finite nor an infinity that the bounds of its field contain.
bool is_bad(const Field& field, std::size_t column, double value);

// Bounds a reward term of one flown step, so that sums of many are finite in float32.
inline bool is_reward(double term) { return std::abs(term) <= 1e30; }  // false for NaN, too
// Sets bad terms of consecutive rows to 0 and marks those rows.
void drop_bad_terms(Simulation& sim, std::size_t first_row, std::size_t count);

// Observations of some envs, as just written: a value that is neither finite nor within infinite bounds of its field becomes 0.
// An episode that has been flown ends here, as one that has just begun does in its first step.
void check_observations(Simulation& sim, const EnvList& envs, bool flown);

}  // namespace flockstep
