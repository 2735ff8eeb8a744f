#include "batch/pool_state.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/random.hpp"
#include "base/require.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/simulation.hpp"
#include "prepared/prepared_world.hpp"
#include "sensors/beams.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep {
namespace {

constexpr std::int32_t kMaxWorlds = 1 << 24;  // resolution of uniform01()

// Writes a world, or null, to a slot of the simulation's tables.
void set_slot(Simulation& sim, std::int32_t slot, std::shared_ptr<const World> world) {
  const auto at = static_cast<std::size_t>(slot);
  sim.world_pointers[at] = world.get();
  sim.scenes[at] = world ? &prepared(*world).scene() : nullptr;
  sim.obstacles[at] = world ? &prepared(*world).obstacles() : nullptr;
  sim.body_models[at] = world ? bodies::models_of(*world) : bodies::Models();
  sim.sorts_by_world |= world && sim.scenes[at]->may_need_embree();
  sim.worlds[at] = std::move(world);
}

void leave(Simulation& sim, EnvIndex env) {
  PoolState& state = *sim.pool;
  const std::int32_t slot = state.slots[env];
  if (--state.users[static_cast<std::size_t>(slot)] > 0) return;
  state.slot_of.erase(sim.state.world_index[env]);
  state.free_slots.push_back(slot);
  set_slot(sim, slot, nullptr);
}

// Returns true if a sensor traces triangles through the tree for tiles and slices.
bool needs_tiles(const BatchConfig& config, std::size_t triangles) {
  const auto in_tiles = [&](const auto& rows, const auto& columns) {
    const std::size_t rays = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    return triangles <= trace::trace_policy_of(config.tracer, rays).tile_triangle_limit;
  };
  return std::ranges::any_of(config.lidars,
                             [&](const LidarConfig& lidar) {
                               return in_tiles(lidar.rows(), lidar.columns()) || sensors::has_fans(lidar, config.tracer);
                             }) ||
         std::ranges::any_of(config.cameras,
                             [&](const CameraConfig& camera) { return in_tiles(camera.height_px, camera.width_px); });
}

}  // namespace

void WorldPool::validate() const {
  require(source != nullptr, "worlds", "a pool with a source", "none");
  require(size >= 1 && size <= kMaxWorlds, "size", "an integer in [1, 16777216]", size);
  require(fresh >= 0.0 && fresh <= kMaxWorlds, "fresh", "a number in [0, 16777216]", fresh);
}

std::int32_t WorldPool::number_of(std::uint64_t seed, std::int64_t episode) const {
  const double u = uniform01(draw(seed, episode, static_cast<std::uint32_t>(Stream::world), 0)[0]);
  const double most = std::numeric_limits<std::int32_t>::max() - (size - 1);
  const double first = std::min(std::floor(static_cast<double>(episode) * fresh), most);
  return static_cast<std::int32_t>(first) + static_cast<std::int32_t>(u * size);
}

void build_ahead(const World& world, const BatchConfig& config) {
  const trace::Scene& scene = prepared(world).scene();
  if (const auto triangles = scene.num_triangles(); triangles > 0 && needs_tiles(config, triangles)) {
    scene.prepare_tiles(world.triangles());
  }
  if (config.tracer == TracerKind::embree) scene.prepare_embree();
  if (std::ranges::any_of(config.lidars, &LidarConfig::needs_hits)) scene.prepare_echoes();
  prepared(world).obstacles();
  bodies::models_of(world);
  for (const CameraConfig& camera : config.cameras) prepared(world).shading(camera.shadows);
}

PoolState::PoolState(WorldPool pool_in, std::size_t num_envs)
    : pool(std::move(pool_in)), slots(num_envs), users(num_envs), free_slots(num_envs - 1), contents(num_envs) {
  users[0] = static_cast<std::uint32_t>(num_envs);
  slot_of.emplace(0, 0);
  std::iota(free_slots.rbegin(), free_slots.rend(), 1);
  free_slots.reserve(num_envs);
  moves.reserve(num_envs);
  wanted.reserve(num_envs);
}

void require_world_of_pool(const Simulation& sim, std::int32_t number, const World* world) {
  try {
    if (world == nullptr) refuse("worlds", "worlds", "a null pointer");
    checks::bodies_of_world(*world, sim.config, sim.bodies ? sim.bodies->per_env() : 0, sim.hull.radius());
    checks::instances_of_world(*world, sim.config);
    if (sim.task_state) sim.task_state->task->require_world(*world, sim.drone_model);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument("world " + std::to_string(number) + " of the pool: " + error.what());
  }
}

void fetch_worlds(Simulation& sim) {
  PoolState& state = *sim.pool;
  const auto by_number = [](const Move& a, const Move& b) { return std::pair(a.number, a.env) < std::pair(b.number, b.env); };
  std::sort(state.moves.begin(), state.moves.end(), by_number);
  state.wanted.clear();
  for (Move& move : state.moves) {
    if (const auto found = state.slot_of.find(move.number); found != state.slot_of.end()) {
      move.world = sim.worlds[static_cast<std::size_t>(found->second)];
    } else if (state.wanted.empty() || state.wanted.back() != move.number) {
      state.wanted.push_back(move.number);
    }
  }
  if (state.wanted.empty()) return;
  state.pool.source->want(state.wanted);
  for (std::size_t i = 0; i < state.moves.size(); ++i) {
    Move& move = state.moves[i];
    if (move.world) continue;
    if (i > 0 && state.moves[i - 1].number == move.number) {
      move.world = state.moves[i - 1].world;
      continue;
    }
    move.world = state.pool.source->get(move.number);
    require_world_of_pool(sim, move.number, move.world.get());
    build_ahead(*move.world, sim.config);  // in case the source has not
  }
}

void move_envs(Simulation& sim) {
  PoolState& state = *sim.pool;
  for (Move& move : state.moves) {
    const auto [known, is_new] = state.slot_of.try_emplace(move.number, -1);  // first, since it may throw
    if (!is_new && known->second == state.slots[move.env]) continue;
    leave(sim, move.env);
    if (is_new) {
      known->second = state.free_slots.back();
      state.free_slots.pop_back();
      set_slot(sim, known->second, std::move(move.world));
    }
    state.slots[move.env] = known->second;
    ++state.users[static_cast<std::size_t>(known->second)];
    sim.state.world_index[move.env] = move.number;
    sim.scratches[0]->moved_world = true;
  }
  state.moves.clear();
}

void look_ahead(Simulation& sim) {
  PoolState& state = *sim.pool;
  state.wanted.clear();
  for (const Block& block : sim.schedule.blocks()) {
    for (const EnvIndex env : block.resetting) {
      state.wanted.push_back(state.pool.number_of(sim.state.seed[env], sim.state.episode[env] + 1));
    }
  }
  if (!state.wanted.empty()) state.pool.source->want(state.wanted);
}

void change_worlds(Simulation& sim) {
  PoolState& state = *sim.pool;
  state.moves.clear();
  for (const Block& block : sim.schedule.blocks()) {
    for (const EnvIndex env : block.resetting) {
      state.moves.push_back({env, state.pool.number_of(sim.state.seed[env], next_episode(sim, env)), nullptr});
    }
  }
  if (state.moves.empty()) return;
  fetch_worlds(sim);
  move_envs(sim);
}

}  // namespace flockstep
