// Bad states: poses, rewards or observations that are not finite. A bad state ends the episode of its env, which is flagged,
// counted and reset like any other. The bad value does not propagate.
#pragma once

#include <cmath>
#include <cstddef>

#include "batch/schedule.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

// True if the position is within the limits of a world and the quaternion is unit.
inline bool is_valid(const Pose& pose) {
  constexpr float kTolerance = 0.02F;  // largest error of the squared norm
  return is_in_world(pose.position) && std::abs(pose.rotation.squaredNorm() - 1.0F) < kTolerance;  // also false for NaN
}

// Marks a row with a bad number: its episode ends in the current step, or in the next one if no step is running.
void mark_bad(Simulation& sim, std::size_t row);

// Checks the setpoints of the flying envs. A drone with an invalid setpoint stays in place, and its row is marked.
void check_setpoints(Simulation& sim, Block& block);

// True if a number of an observation is neither finite nor an infinity within the bounds of its field.
bool is_bad(const Field& field, std::size_t column, double value);

// True if a reward term of one flown step is small enough that sums of many steps stay finite in float32.
inline bool is_reward(double term) { return std::abs(term) <= 1e30; }  // also false for NaN
// Sets bad terms of consecutive rows to 0 and marks those rows.
void drop_bad_terms(Simulation& sim, std::size_t first_row, std::size_t count);

// Checks the new observations of some envs and sets bad values (see is_bad) to 0. With `flown`, the episode of such a row ends
// here; otherwise the episode has just begun and ends in its first step.
void check_observations(Simulation& sim, const EnvList& envs, bool flown);

}  // namespace flockstep
