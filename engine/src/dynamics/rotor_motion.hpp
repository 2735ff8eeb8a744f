// Rotor motion: flies rotor-driven drones through their worlds, with contacts.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "collision/hull.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/obstacles.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/downwash.hpp"
#include "dynamics/fleet.hpp"
#include "dynamics/flight.hpp"
#include "dynamics/lane_group.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/aligned.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::dynamics {

// The commands of a group of drones that take effect within a leg, when some are late.
class Arrivals {
 public:
  void clear() { used_ = 0; }

  // Adds the setpoint of a lane that takes effect at this tick of the step. count: its earlier setpoints of the leg; the first
  // one becomes the flock's.
  void add(const Setpoint& setpoint, float tick, std::size_t lane, std::size_t count, Flock& flock) {
    if (count == 0) {
      for (std::size_t k = 0; k < setpoint.size(); ++k) flock.setpoint[k][lane] = setpoint[k];
      return;
    }
    if (count > rows_.size()) rows_.emplace_back();
    if (count > used_) rows_[used_++].tick.fill(std::numeric_limits<float>::infinity());
    Arrival& row = rows_[count - 1];
    row.tick[lane] = tick;
    for (std::size_t k = 0; k < setpoint.size(); ++k) row.setpoint[k][lane] = setpoint[k];
  }

  // All of them, valid until the next clear().
  std::span<Arrival> rows() { return std::span(rows_).first(used_); }

 private:
  std::vector<Arrival> rows_;
  std::size_t used_ = 0;
};

// Working memory of a thread; made once.
struct FlightScratch {
  FlightScratch(const collision::Hull& hull, const collision::Corners& corners) : contacts(hull, corners) {}

  Flock flock;
  LaneNumbers numbers;  // the coefficients of a group whose lanes are not consecutive drones
  Arrivals arrivals;
  int ticks_ahead = 0;           // ticks that a call has flown and State::tick does not count yet
  AlignedVector<Lanes<3>> path;  // the current leg, one entry per tick; empty if neither paths nor deviations are recorded
  collision::NearSolids near;
  ContactResolver contacts;
  GroupMember member;  // a drone that can touch no other one
  Downwash downwash;
};

// The data that flight reads and writes.
struct FlightContext {
  Fleet& fleet;
  State& state;
  const collision::Hull& hull;
  std::span<const std::int32_t> slot;                      // (E,) index of the env's world in the next two arrays
  std::span<const trace::Scene* const> scenes;             // by slot
  std::span<const collision::Obstacles* const> obstacles;  // by slot
  std::span<std::uint8_t> bad;  // (N,) 1 if the drone stays in place because it left the range that can be integrated
  std::span<float> path;        // (N, ticks + 1, 3) m, positions before the step and after each tick; empty: not recorded
  DroneRange own;               // drones that no other thread reads or writes meanwhile
  trace::Tracer& tracer;
  FlightScratch& scratch;
  // The bodies of all envs, env by env, during a call of fly() with one tick. Without bodies the count is 0.
  collision::MovingBodies bodies = {};
  std::size_t bodies_per_env = 0;
  // (N,) m, of each listed drone: its largest distance from a point that moves uniformly from where the drone begins the call to
  // where it ends; empty: not recorded.
  std::span<float> deviation = {};
};

// Drones of one env that may touch each other, for record_motions().
struct MemberTable {
  DroneIndex first;                // drone 0 of the env
  std::span<GroupMember> members;  // (M,)
};

// Sets the accelerations of drones for their current state, assuming constant rotor speeds.
void update_accelerations(const FlightContext& context, std::span<const DroneIndex> drones);

// Flies drones for `ticks` ticks of one step, from the tick with index first_tick on, and checks each tick for contacts. With
// OnContact::terminate, drones that hit something in this step stay in place, unless bodies push them. With bodies, ticks is 1.
void fly(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, int first_tick, int ticks);

// Flies drones of one env for one tick without any contact, and writes the motion, is_open and is_fixed of the members. Those of
// drones that stay in place are not changed.
void record_motions(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, int tick,
                    const MemberTable& table);

// Writes the result of a contact group to a drone that record_motions() has flown, or that stays in place.
void write_result(const FlightContext& context, DroneIndex drone, const GroupMember& member, int tick);

}  // namespace flockstep::dynamics
