// PoolState: the worlds of a pool that the envs of a batch are in.
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

// An env goes to a world: by its number, and as it is once it has been fetched.
struct Move {
  EnvIndex env;
  std::int32_t number;
  std::shared_ptr<const World> world;
};

// The worlds that envs are in now have slots in the tables of the simulation, each as many envs as are in it. state.world_index
// has their numbers. No result depends on which slot a world has.
struct PoolState {
  PoolState(WorldPool pool, std::size_t num_envs);  // every env is in world 0

  WorldPool pool;
  std::vector<std::int32_t> slots;                         // (E,) of each env's world
  std::vector<std::uint32_t> users;                        // (E,) how many envs are in the world of each slot
  std::vector<std::int32_t> free_slots;                    // whose worlds nobody is in
  std::unordered_map<std::int32_t, std::int32_t> slot_of;  // by the world's number
  std::vector<std::uint64_t> contents;                     // (E,) content_hash() of each env's world, in a snapshot
  // of the call under way
  std::vector<Move> moves;  // of different envs; (E,) capacity, so that an episode in a world that is there costs no memory
  std::vector<std::int32_t> wanted;  // (E,) capacity
};

// --- on the thread of the caller, while no other one steps
// Fetches the worlds of sim.pool->moves, and waits where one is not there yet. What this throws, as an interrupted wait does,
// leaves all as it was.
void fetch_worlds(Simulation& sim);
void move_envs(Simulation& sim);   // once they are fetched; no moves are left then
void look_ahead(Simulation& sim);  // wants the worlds of the episodes after those that Block::resetting lists
// Of a step: its envs that begin an episode go to the worlds that they draw.
void change_worlds(Simulation& sim);

// Throws std::invalid_argument, naming the number of the world, unless the task and the cameras can do with it.
void require_world_of_pool(const Simulation& sim, std::int32_t number, const World* world);

}  // namespace flockstep
