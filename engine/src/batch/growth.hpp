// Growth: larger batches with the state of a smaller one. All arrays of a batch have fixed sizes, so a batch that needs other
// sizes gets a new Simulation, which then replaces the old one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "batch/call_lock.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

// The slots that a spawn takes, and the size that the batch needs for them.
struct SpawnPlan {
  std::size_t num_envs;
  std::size_t drones_per_env;
  std::vector<std::int64_t> indices;  // drones to spawn, in a batch of that size
};

// Returns the largest number of drones in an env.
std::size_t max_drones_per_env(Interaction interaction);

// Chooses the slots of `count` drones: the given indices, or the lowest inactive slot of each env in `envs`, or the lowest
// inactive slots of all. At most one list is not empty. Throws std::invalid_argument if the batch cannot have such slots.
SpawnPlan plan_spawn(const Simulation& sim, std::span<const std::int64_t> indices, std::span<const std::int64_t> envs,
                     std::size_t count);

// Returns true if a slot is not in use. A finished drone is inactive, but keeps its slot.
inline bool is_removed(const Simulation& sim, DroneIndex drone) {
  const FlagArray& finished = sim.state.own.finished;
  return !sim.state.active[drone] && (finished.empty() || !finished[drone]);
}

// Returns a simulation with another configuration and the state of this one. num_envs and drones_per_env may be larger, and
// LiDARs and cameras may have other resolutions. New slots are inactive, at the start of their env's world. Sensors with
// another resolution have not read yet. `sim` itself does not change.
std::shared_ptr<Simulation> resized(Simulation& sim, BatchConfig config);

namespace checks {

// Throws std::logic_error within another call on the batch, whose arrays must not move.
void can_grow(const CallLock& lock, std::string_view call);
// Refuses a field that changes the shape of arrays, if the batch has a task.
void has_no_task(const Simulation& sim, std::string_view field, int got);
// Refuses a field that all drones have in common, if the mask leaves out one of them.
void concerns_all(const Simulation& sim, DroneMask mask, std::string_view field);

}  // namespace checks
}  // namespace flockstep
