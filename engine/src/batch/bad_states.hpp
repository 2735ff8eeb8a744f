// Bad states: a pose, a reward or an observation that is no finite number. It ends the episode of its env, which is flagged,
// counted and reset like any other, and goes no further.
#pragma once

#include "batch/schedule.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

// In the world, and turned by a unit quaternion.
bool is_valid(const Pose& pose);

// Something about this env is bad: its episode ends in the present step, or in the next if none is under way.
void mark_bad(Simulation& sim, std::size_t env);

// Setpoints of the envs that fly. A drone whose setpoint is no pose in the world stays where it is.
void check_setpoints(Simulation& sim, Block& block);

// What an env has earned in a flown step. What is not finite, or beyond 1e30, becomes 0.
void check_terms(Simulation& sim, std::size_t env);

// Observations of some envs, as just written: a value that is neither finite nor within infinite bounds of its field becomes 0.
// An episode that has been flown ends here, as one that has just begun does in its first step.
void check_observations(Simulation& sim, const EnvList& envs, bool flown);

}  // namespace flockstep
