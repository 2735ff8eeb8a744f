#include "batch/selected.hpp"

#include "base/indices.hpp"

namespace flockstep {

bool is_active(const Simulation& sim, EnvIndex env) {
  return is_any(sim.state.active.data() + sim.drone_of(env, 0), sim.drones_per_env());
}

void list_selected(Simulation& sim, EnvMask mask, EnvList Block::* list) {
  for (Block& block : sim.schedule.blocks()) {
    (block.*list).assign(block.envs);
    if (!mask.empty()) (block.*list).filter([&](EnvIndex env) { return mask.selects(env); });
  }
}

void list_selected(Simulation& sim, DroneMask mask, EnvList Block::* list) {
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

std::span<const DroneIndex> selected_drones(const Simulation& sim, std::span<const EnvIndex> envs, Part part, DroneMask mask,
                                            Scratch& scratch) {
  sim.drones_of(envs, part, scratch.drones);
  if (!mask.empty()) std::erase_if(scratch.drones, [&](DroneIndex drone) { return !mask.selects(drone); });
  return scratch.drones;
}

}  // namespace flockstep
