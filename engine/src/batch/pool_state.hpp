// PoolState: the pool of a batch and the current worlds of its envs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "flockstep/index.hpp"
#include "flockstep/world_pool.hpp"

namespace flockstep {

struct Simulation;

// A move of an env to the world with this number. `world` is null until it has been fetched.
struct Move {
  EnvIndex env;
  std::int32_t number;
  std::shared_ptr<const World> world;
};

// Each current world has one slot in the tables of the simulation, shared by all envs in it. state.world_index holds the
// numbers of the worlds. Results do not depend on the slot of a world.
struct PoolState {
  PoolState(WorldPool pool, std::size_t num_envs);  // puts every env into world 0

  WorldPool pool;
  std::vector<std::int32_t> slots;                         // (E,) slot of each env's world
  std::vector<std::uint32_t> users;                        // (E,) number of envs in the world of each slot
  std::vector<std::int32_t> free_slots;                    // slots without a world
  std::unordered_map<std::int32_t, std::int32_t> slot_of;  // slot by world number
  std::vector<std::uint64_t> contents;                     // (E,) content_hash() of each env's world, for snapshots
  // used during a call
  std::vector<Move> moves;           // one per env; (E,) capacity: moves to worlds already present allocate nothing
  std::vector<std::int32_t> wanted;  // (E,) capacity
};

// --- called on the caller's thread, while no other thread steps
// Fetches the worlds of sim.pool->moves, and waits for those that are not ready. If it throws, for example because the wait was
// interrupted, all envs and worlds are unchanged.
void fetch_worlds(Simulation& sim);
void move_envs(Simulation& sim);   // moves the envs to the fetched worlds and clears the moves
void look_ahead(Simulation& sim);  // requests the worlds of the episodes after those of Block::resetting
// Moves the envs that begin an episode in this step to the worlds that they draw.
void change_worlds(Simulation& sim);

// Throws std::invalid_argument with the number of the world if the task or the cameras cannot use it.
void require_world_of_pool(const Simulation& sim, std::int32_t number, const World* world);

}  // namespace flockstep
