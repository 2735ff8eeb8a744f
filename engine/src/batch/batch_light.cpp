// The members of Batch that change the light of worlds and envs.
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/require.hpp"
#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "flockstep/batch.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

void Batch::set_light(std::int64_t world_index, const Lighting& lighting) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "set_light");
  if (sim_->pool) {
    throw std::invalid_argument(
        "set_light: not allowed with a WorldPool: each episode draws its world, with its own light (let the pool's function make "
        "worlds in other lights)");
  }
  const std::size_t count = sim_->worlds.size();
  require(world_index >= 0 && static_cast<std::size_t>(world_index) < count, "world_index",
          "an integer in [0, " + std::to_string(count) + ")", world_index);
  const auto index = static_cast<std::size_t>(world_index);
  auto relit = std::make_shared<const World>(sim_->worlds[index], lighting);
  checks::drawable(sim_->config, relit->light());
  build_ahead(*relit, sim_->config);
  // The copy has the scene and the obstacles of the world that it replaces, so those tables stay.
  sim_->world_pointers[index] = relit.get();
  sim_->worlds[index] = std::move(relit);
  sim_->cameras.mark_world_stale(static_cast<std::int32_t>(world_index));
  sim_->config_parts.clear();
}

void Batch::set_light(std::span<const Light> lights, EnvMask mask) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "set_light");
  checks::mask(*sim_, mask);
  const std::size_t count = sim_->num_envs();
  require(lights.size() == 1 || lights.size() == count, "lights", "one, or " + std::to_string(count) + " for the envs",
          lights.size());
  std::vector<Light> checked(lights.begin(), lights.end());
  for (Light& light : checked) {
    check_light(light);
    checks::drawable(sim_->config, light);
  }
  for_each_selected(*sim_, mask, [&](EnvIndex env) {
    sim_->lights.set(env, checked[checked.size() == 1 ? 0 : std::size_t{env}]);
    sim_->cameras.mark_stale(env);
  });
  sim_->lights.free_unused();
}

void Batch::use_world_light(EnvMask mask) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "use_world_light");
  checks::mask(*sim_, mask);
  if (sim_->lights.empty()) return;
  for_each_selected(*sim_, mask, [&](EnvIndex env) {
    sim_->lights.clear(env);
    sim_->cameras.mark_stale(env);
  });
  sim_->lights.free_unused();
}

}  // namespace flockstep
