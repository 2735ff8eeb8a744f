// Flying: moves the drones of a batch to their setpoints, with contacts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "batch/simulation.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/index.hpp"

namespace flockstep {

// True if a drone may start with this velocity: finite, and slow enough for float32.
inline bool is_speed(const Vec3& velocity) {
  return velocity.allFinite() && velocity.cwiseAbs().maxCoeff() <= dynamics::kMaxSpeed;
}

// Starts the flight of a drone at this velocity, with its rotors at hover speed. Does nothing with kinematic motion.
void start_flight(Simulation& sim, DroneIndex drone, const Velocity& velocity);

// Puts a drone at rest at the start marker of its world, or at the centre of its bounds if it has none.
void place_at_start(Simulation& sim, DroneIndex drone);

// The data that the flight of a block reads and writes.
dynamics::FlightContext flight_context(Simulation& sim, const Block& block, Scratch& scratch);

// Moves a drone by a tick, or lets bodies push it if it has a contact.
void move_tick(Simulation& sim, const MoveRequest& move, Scratch& scratch);
// Moves drones of one env, sorted, by a tick; the others stand. Drones may touch each other if BatchConfig::interaction says so,
// and bodies may push them.
void move_tick(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch);

// Draws the initial gusts of an episode.
void begin_gusts(Simulation& sim, DroneIndex drone);

// Moves one drone kinematically to a pose, or to the first contact on the way. Bodies move at the same time, as in their last
// tick, and may push the drone. Returns its largest distance from the beginning.
float sweep_to(Simulation& sim, DroneIndex drone, const Pose& target, Scratch& scratch);

// Lets bodies push a drone that stands still during their last tick. If the drone has a contact already, it keeps that one.
// Returns its largest distance from the beginning.
float give_way(Simulation& sim, DroneIndex drone, Scratch& scratch);

// Writes the pose and contact of a drone that moved kinematically, or that stands.
void write_moved(Simulation& sim, DroneIndex drone, const dynamics::GroupMember& member);

// The next three functions are for rotor-driven drones of one block.

// Sets the initial accelerations of an episode: those of the current state with constant rotor speeds.
void update_accelerations(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, Scratch& scratch);

// Flies drones for `ticks` ticks of a task's step, from the tick with index first_tick on.
void fly_by_rotors(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                   int first_tick, int ticks, Scratch& scratch);

// Flies the selected drones of some envs of a block outside of a task's step; other drones hold still. Gusts and the controller
// follow each env's own clock: many calls of one tick give the same result as one call of many ticks, except for downwash, which
// is that of the beginning of a call or step.
void fly_ticks(Simulation& sim, const Block& block, std::span<const EnvIndex> envs, DroneMask mask,
               const dynamics::Commands& commands, int ticks, Scratch& scratch);

}  // namespace flockstep
