// The drones and envs that a call's mask selects.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "base/indices.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

inline bool is_selected(const Simulation& sim, DroneMask mask, DroneIndex drone) {
  return sim.state.active[drone] && mask.selects(drone);
}

// Returns the pose that a row of arrays gives. What they do not give is that of `pose`; quaternions are normalised.
inline Pose given_pose(Pose pose, std::size_t row, std::span<const float> position, std::span<const float> quat_wxyz) {
  if (!position.empty()) pose.position = Vec3::Map(position.data() + 3 * row);
  if (!quat_wxyz.empty()) {
    const float* const q = quat_wxyz.data() + 4 * row;
    pose.rotation = Quat(q[0], q[1], q[2], q[3]).normalized();
  }
  return pose;
}

// Calls f(drone) for each selected active drone, on the calling thread.
template <class F>
void for_each_selected(const Simulation& sim, DroneMask mask, const F& f) {
  for (std::size_t i = 0; i < sim.num_drones(); ++i) {
    if (const DroneIndex drone(i); is_selected(sim, mask, drone)) f(drone);
  }
}

// Calls f(env, drones of it) for each env of a list of drones that is sorted by env.
template <class F>
void for_each_env(const Simulation& sim, std::span<const DroneIndex> drones, const F& f) {
  while (!drones.empty()) {
    const EnvIndex env = sim.env_of(drones.front());
    std::size_t count = 1;
    while (count < drones.size() && sim.env_of(drones[count]) == env) ++count;
    f(env, drones.first(count));
    drones = drones.subspan(count);
  }
}

// An env is active if one of its drones is.
inline bool is_active(const Simulation& sim, EnvIndex env) {
  return is_any(sim.state.active.data() + sim.drone_of(env, 0), sim.drones_per_env());
}

// Calls f(env) for each selected active env, on the calling thread.
template <class F>
void for_each_selected(const Simulation& sim, EnvMask mask, const F& f) {
  for (std::size_t i = 0; i < sim.num_envs(); ++i) {
    if (const EnvIndex env(i); mask.selects(env) && is_active(sim, env)) f(env);
  }
}

// Fills a list of each block with the envs that are selected or have a selected drone.
inline void list_selected(Simulation& sim, EnvMask mask, EnvList Block::* list) {
  for (Block& block : sim.schedule.blocks()) {
    (block.*list).assign(block.envs);
    if (!mask.empty()) (block.*list).filter([&](EnvIndex env) { return mask.selects(env); });
  }
}

inline void list_selected(Simulation& sim, DroneMask mask, EnvList Block::* list) {
  for (Block& block : sim.schedule.blocks()) {
    (block.*list).assign(block.envs);
    if (mask.empty()) continue;
    (block.*list).filter([&](EnvIndex env) {
      bool any = false;
      for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
        any |= is_selected(sim, mask, sim.drone_of(env, member));
      }
      return any;
    });
  }
}

// The selected drones of some envs that take part, env by env; valid until the next call with this scratch.
inline std::span<const DroneIndex> selected_drones(const Simulation& sim, std::span<const EnvIndex> envs, Part part,
                                                   DroneMask mask, Scratch& scratch) {
  sim.drones_of(envs, part, scratch.drones);
  if (!mask.empty()) std::erase_if(scratch.drones, [&](DroneIndex drone) { return !mask.selects(drone); });
  return scratch.drones;
}

}  // namespace flockstep
