// Flying: moves the drones of a batch to their setpoints, with contacts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "batch/simulation.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/index.hpp"

namespace flockstep {

// A velocity that a drone may start with: finite, and slow enough for float32.
inline bool is_speed(const Vec3& velocity) {
  return velocity.allFinite() && velocity.cwiseAbs().maxCoeff() <= dynamics::kMaxSpeed;
}

// Starts the flight of a drone at this velocity, with its rotors at hover speed. Does nothing with kinematic motion.
void start_flight(Simulation& sim, DroneIndex drone, const Velocity& velocity);

// Draws the gusts that an episode begins with.
void begin_gusts(Simulation& sim, DroneIndex drone);

// Moves one drone kinematically to a pose, or to where it hits something.
void sweep_to(Simulation& sim, DroneIndex drone, const Pose& target);

// The next three are for drones that fly by their rotors, some of those of a block.

// Sets the accelerations that an episode begins with: those at the present state if the rotors keep their speed.
void update_accelerations(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, Scratch& scratch);

// Flies drones for some ticks of a task's step, the first of which has the index first_tick in the step.
void fly_by_rotors(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                   int first_tick, int ticks, Scratch& scratch);

// Flies the selected drones of some envs of a block for some ticks outside of a task's step; other drones hold still. Gusts and
// the controller follow each env's own clock, so that many calls of one tick do the same as one call of many ticks.
void fly_ticks(Simulation& sim, const Block& block, std::span<const EnvIndex> envs, DroneMask mask,
               const dynamics::Commands& commands, int ticks, Scratch& scratch);

}  // namespace flockstep
