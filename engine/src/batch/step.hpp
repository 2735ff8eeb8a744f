// The step of a batch, as a table of contents, and the pieces that other calls share with it.
#pragma once

#include <cstdint>
#include <span>

#include "batch/simulation.hpp"

namespace flockstep {

// Flies the actions in sim.task_state->actions.
void step(Simulation& sim);

// Begins the episodes that have been opened, in the envs that Block::resetting lists. place: where the task puts the drones,
// instead of where they are.
void begin_episodes(Simulation& sim, bool place);

// Reads all sensors of the selected drones of the envs that Block::selected lists, at a new moment of their episodes.
void read_sensors(Simulation& sim, DroneMask mask);

}  // namespace flockstep
