// The episode machine: begins episodes, accumulates their rewards and ends them. It is the same for every task.
#pragma once

#include <cstddef>
#include <cstdint>

#include "batch/simulation.hpp"

namespace flockstep {

void clear_contact(State& state, DroneIndex drone);
bool touches(const Simulation& sim, std::size_t row);  // a drone of this row had a contact in its last motion
bool waits(const Simulation& sim, std::size_t row);    // it takes no part in the next step, see Batch::waiting()
// Takes note of the rows of an env that have ended in this step, by their flags. Those of a team end together: it truncates the
// others. With Episodes::last they rest.
void end_rows(Simulation& sim, EnvIndex env);
// With Episodes::last, ends the episode of an env in which no drone flies any more.
void end_rest(Simulation& sim, EnvIndex env);

// --- for one env
std::int64_t next_episode(const Simulation& sim, EnvIndex env);  // number of the next episode
// Opens the next episode of an env, or the first if none has begun. Draws its world if worlds are random.
void start_next_episode(Simulation& sim, EnvIndex env, Scratch& scratch);
void open_episode(Simulation& sim, EnvIndex env, Scratch& scratch);        // opens the episode of state.seed and state.episode
void draw_light(Simulation& sim, EnvIndex env);                            // light of this episode, if BatchConfig has lights
void start_counts(Simulation& sim, EnvIndex env);                          // resets steps, return and flags for a new episode
void start_counts(Simulation& sim, std::size_t first, std::size_t count);  // the same for some rows
void forget_readings(Simulation& sim, EnvIndex env);                       // resets the env's clock and readings
void forget_readings(Simulation& sim, DroneIndex drone);                   // resets the readings of one drone only

void forget_own_episodes(Simulation& sim, EnvIndex env);  // the episodes of its drones get the number of its own

// --- for one drone, with Episodes::each
void start_next_episode(Simulation& sim, DroneIndex drone);

// --- stages of a step, for a block
// Selects the envs that fly. An env whose episode has ended begins the next one in this step, or holds still.
void select_envs(Simulation& sim, Block& block);
// Adds the rewards of a flown step, and ends the episodes that are over.
void finish_step(Simulation& sim, Block& block);
// Keeps the observations of ended episodes as their final ones.
void keep_final(Simulation& sim, Block& block);
// With same-step autoreset, lists the envs whose episode has ended as resetting.
void list_resetting(Simulation& sim, Block& block);
// Opens the next episodes of the envs that reset in this step.
void advance_episodes(Simulation& sim, Block& block, Scratch& scratch);
// Prepares the first readings of a new episode, after its drones have been placed.
void initial_readings(Simulation& sim, Block& block, Scratch& scratch);
// With Episodes::last and same-step autoreset, shows the observation of an absent drone in the rows that have begun to rest.
void show_finished(Simulation& sim, Block& block);

}  // namespace flockstep
