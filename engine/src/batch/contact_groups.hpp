// Contact groups: the drones of an env that may touch each other, if BatchConfig::interaction says so, and their motion.
//
// Drones move as if the others were not there, and their paths show which of them may have touched, and in which tick. From this
// tick on, these drones move as a contact group, tick by tick. A drone that one of them may touch in a tick joins them in this
// tick. Most envs need no group.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dynamics/contact.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "trace/near_balls.hpp"

namespace flockstep {

struct Simulation;
struct Scratch;
struct Block;

// A copy of the arrays of State that motion changes, of the drones of some envs.
class SavedDrones {
 public:
  void clear() { count_ = 0; }
  // Copies consecutive drones, with their flags FlightContext::bad if these are given. Returns the number of the first copy.
  std::size_t save(const State& state, DroneIndex first, std::size_t count, std::span<std::uint8_t> bad = {});
  void restore(State& state, DroneIndex drone, std::size_t copy) const;
  Vec3 position(std::size_t copy) const;

 private:
  std::vector<std::vector<std::byte>> arrays_;  // positions first
  std::span<std::uint8_t> bad_;                 // (N,) the flags that restore() writes; empty: none
  std::vector<std::uint8_t> saved_bad_;
  std::size_t count_ = 0;
};

// The positions of a drone during some ticks: at each share s of their time it is within `deviation` of from + s way.
struct LinearPath {
  Vec3 from = Vec3::Zero(), way = Vec3::Zero();  // m
  float deviation = 0.0F;                        // m
};

// Working memory of a thread.
struct ContactGroups {
  SavedDrones saved;
  std::vector<dynamics::GroupMember> members;  // (M,)
  std::vector<dynamics::GroupMember*> group;   // the members that move together
  std::vector<EnvIndex> envs;                  // whose drones fly together
  std::vector<DroneIndex> movers;              // drones of the group
  std::vector<std::uint8_t> is_in_group;       // (M,)
  std::vector<std::uint32_t> joining;          // the drones that join the group in a tick
  std::vector<LinearPath> paths;               // (M,)
  std::vector<int> first_near;                 // (M,) tick of the leg in which the drone may first touch another one
  // Balls that contain the drones on their paths.
  std::vector<float> centers, radii;  // (M, 3), (M,) m; a negative radius if the drone is not active
  trace::BallSlices balls;
  std::vector<std::uint32_t> found;  // (M,), padded
};

// A kinematic motion of one tick.
struct MoveRequest {
  DroneIndex drone;
  Pose target;
  bool has_contact;  // had a contact in an earlier tick: the drone stays in place
};

// Moves drones of one env, sorted, by a tick; the other ones stand. Bodies of the env have moved already, and may push them.
void move_in_groups(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch);

// Flies rotor-driven drones of some envs, env by env, for `ticks` ticks from the tick with index first_tick on; the other drones
// of these envs stand. With bodies, ticks is 1.
void fly_in_groups(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                   int first_tick, int ticks, Scratch& scratch);

}  // namespace flockstep
