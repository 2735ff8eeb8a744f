// The step of a batch, and the parts of it that other calls share.
#pragma once

#include <cstdint>
#include <span>

#include "batch/simulation.hpp"
#include "sensors/sensor.hpp"

namespace flockstep {

// Flies the actions in sim.task_state->actions, which the pilot writes first if there is one.
void step(Simulation& sim, Pilot* pilot = nullptr);

// Begins the episodes that have been opened in the envs of Block::resetting. place: true if the task places the drones;
// otherwise they start at their current poses.
void begin_episodes(Simulation& sim, bool place);

// Returns the surroundings that sensors measure, with a thread's working memory.
sensors::Surroundings surroundings_of(const Simulation& sim, Scratch& scratch);

// Reads all sensors of the selected drones in the envs of Block::selected. This increments state.sensed of these envs.
void read_sensors(Simulation& sim, DroneMask mask);

}  // namespace flockstep
