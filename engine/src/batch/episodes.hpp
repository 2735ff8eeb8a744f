// The episode machine: when episodes begin, what a flown step adds to them, and when they end. The same for every task.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "batch/simulation.hpp"

namespace flockstep {

// Gives a simulation its task.
void begin_task(Simulation& sim, std::unique_ptr<Task> task);

void clear_contact(State& state, DroneIndex drone);
bool touches(const Simulation& sim, std::size_t row);  // a drone of this row touched something in its last motion
// An episode of one row has ended: the others of its env are truncated in the same step.
void end_teammates(Simulation& sim, EnvIndex env);

// --- of one env
std::int64_t next_episode(const Simulation& sim, EnvIndex env);  // the first where none has begun
// Names the episode that begins: the next one, or the first where none has begun. Draws its world, where that is random.
void start_next_episode(Simulation& sim, EnvIndex env, Scratch& scratch);
void open_episode(Simulation& sim, EnvIndex env, Scratch& scratch);  // the one that state.seed and state.episode name
void start_counts(Simulation& sim, EnvIndex env);                    // steps, return and flags of an episode that begins
void forget_readings(Simulation& sim, EnvIndex env);                 // nothing has been sensed in this episode yet
void forget_readings(Simulation& sim, DroneIndex drone);             // the part of one drone, whose env's time goes on

// --- stages of a step, over a block
// Who takes part: an env whose episode has ended begins the next one in this step, or holds still.
void select_envs(Simulation& sim, Block& block);
// Adds up what a flown step earned, and ends the episodes that are over.
void finish_step(Simulation& sim, Block& block);
// The observations of the episodes that have ended are their last.
void keep_final(Simulation& sim, Block& block);
// With same-step autoreset, the envs whose episode has ended begin the next one.
void list_resetting(Simulation& sim, Block& block);
// Opens the next episodes of the envs that are to be reset in this step.
void advance_episodes(Simulation& sim, Block& block, Scratch& scratch);
// The drones of the envs that begin have been placed: their first moment.
void initial_readings(Simulation& sim, Block& block);

}  // namespace flockstep
