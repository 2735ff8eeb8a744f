// Flying: how drones come from where they are to where they are told, hitting what is in the way.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "batch/simulation.hpp"

namespace flockstep {

// A velocity that a drone may begin with: finite, and not so fast that float32 loses it.
inline bool is_speed(const Vec3& velocity) {
  return velocity.allFinite() && velocity.cwiseAbs().maxCoeff() <= dynamics::kMaxSpeed;
}

// A drone that flies by its rotors begins anew: at this velocity, its rotors as in hovering. With kinematic motion, nothing.
void start_flight(Simulation& sim, std::size_t drone, const Velocity& velocity);

// Flies one drone to a pose, or as far as nothing is in the way.
void sweep_to(Simulation& sim, std::size_t drone, const Pose& target);

// What tells drones that fly by their rotors where to go: a row for each of them.
struct Told {
  std::span<const float> command;    // (N, 4), as Control says
  std::span<const Pose> target;      // (N,), for Control::pose
  std::span<const Pose> step_start;  // (N,) likewise: where the step began
};

// Draws the gusts that an episode begins with.
void begin_gusts(Simulation& sim, std::size_t drone);
// Advances the gusts by a step. The step begins ticks_ahead after the envs' present ticks.
void update_wind(Simulation& sim, std::span<const std::uint32_t> drones, int ticks_ahead = 0);

// Drones that follow each other; none where count is 0.
struct Row {
  std::size_t first = 0, count = 0;
};
// The drones of a block, where they follow each other.
Row row_of(const Simulation& sim, const Block& block);

// What accelerates drones where they are, if their rotors keep their speed: an episode begins with it.
// own: drones that no other thread reads or writes meanwhile, these among them.
void feel(Simulation& sim, std::span<const std::uint32_t> drones, Row own, Scratch& scratch);

// Flies drones by their rotors for some ticks, the first of which is the first_tick-th of their step. What is in the
// way is met in each tick. Those that have hit something in this step stay there where contacts end the episode.
void fly_by_rotors(Simulation& sim, std::span<const std::uint32_t> drones, Row own, const Told& told, int first_tick, int ticks,
                   Scratch& scratch);

// Flies envs for some ticks outside of a task's step. Gusts and the controller follow each env's own clock, so that many calls of
// one tick do what one call of many ticks does.
void fly_ticks(Simulation& sim, std::span<const std::uint32_t> envs, Row own, const Told& told, int ticks, Scratch& scratch);

}  // namespace flockstep
