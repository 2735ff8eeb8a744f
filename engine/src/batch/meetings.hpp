// Meetings: motion of drones that touch each other, if BatchConfig::meet says so.
//
// The drones of an env first move as if the others were not there. If two of them may have touched, both are put back and move
// as a Crowd, tick by tick, until no drone outside the crowd can have touched one of it. Most envs need no crowd.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dynamics/crowd.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

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

// Working memory of a thread.
struct Meetings {
  Meetings(const collision::Hull& hull, const collision::Corners& corners) : crowd(hull, corners) {}

  dynamics::Crowd crowd;
  SavedDrones saved;
  std::vector<dynamics::Neighbor> neighbors;      // (M,)
  std::vector<dynamics::Neighbor*> crowd_of_env;  // those of the crowd
  std::vector<EnvIndex> envs;                     // whose drones fly together
  std::vector<DroneIndex> movers;                 // of the crowd
  std::vector<std::uint8_t> is_in_crowd;          // (M,)
  // Balls that contain the drones during their motions, sorted by x.
  struct Ball {
    float x, radius;  // m
    std::uint32_t member;
  };
  std::vector<Ball> sorted;
  std::vector<float> center, radius;  // (M, 3), (M,) m, of these
  std::vector<float> reach;           // (M,) m, largest distance of kinematic drones from the beginning
  std::vector<std::uint32_t> found;   // (M,)
  std::vector<Vec3> way;              // (M,) m, requested kinematic motions
};

// A kinematic motion of one tick.
struct MoveRequest {
  DroneIndex drone;
  Pose target;
  bool has_contact;  // of an earlier tick: the drone stays in place
};

// Moves drones of one env, sorted, by a tick; the other ones stand. Bodies of the env have moved already, and may push them.
void move_meeting(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch);

// Flies rotor-driven drones of some envs, env by env, for `ticks` ticks from the tick with index first_tick on; the other drones
// of these envs stand. With bodies, ticks is 1.
void fly_meeting(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                 int first_tick, int ticks, Scratch& scratch);

}  // namespace flockstep
