// Rotor motion: flies drones by their rotors through their worlds, with contacts.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "collision/hull.hpp"
#include "collision/obstacles.hpp"
#include "dynamics/fleet.hpp"
#include "dynamics/flight.hpp"
#include "dynamics/lane_group.hpp"
#include "dynamics/setpoint.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::dynamics {

// Drones whose state left the range that can be integrated.
struct LostDrones {
  std::size_t count = 0;
  std::uint32_t first = ~std::uint32_t{0};  // the lowest index

  void add(DroneIndex drone) {
    ++count;
    first = std::min(first, static_cast<std::uint32_t>(drone));
  }
};

// The working memory of a thread; made once.
struct FlightScratch {
  Flock flock;
  // In a fleet of several airframes: the numbers of the last group's lanes, and the rows of their airframes; -1: no group yet.
  LaneNumbers numbers;
  std::array<std::int32_t, kLanes> airframes{-1};
  LostDrones lost;  // in the present call, of a batch without a task
};

// What flight reads and writes.
struct FlightContext {
  Fleet& fleet;
  State& state;
  const collision::Hull& hull;
  std::span<const std::int32_t> slot;                      // (E,) index of the env's world in the next two
  std::span<const trace::Scene* const> scenes;             // by slot
  std::span<const collision::Obstacles* const> obstacles;  // by slot
  std::span<std::uint8_t> bad;                             // (R,) the row's episode ends as a bad state; empty without a task
  std::size_t drones_per_row;                              // of bad
  DroneRange own;                                          // drones that no other thread reads or writes meanwhile
  trace::Tracer& tracer;
  FlightScratch& scratch;
};

// Sets the accelerations of drones to those at their present state if the rotors keep their speed.
void update_accelerations(const FlightContext& context, std::span<const DroneIndex> drones);

// Flies drones for some ticks of one step, the first of which has the index first_tick in it, and checks each tick for contacts.
// With OnContact::terminate, drones that hit something in this step stay where they are.
void fly(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, int first_tick, int ticks);

}  // namespace flockstep::dynamics
