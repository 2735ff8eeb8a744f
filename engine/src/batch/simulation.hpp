// Simulation: the complete state of a batch, accessible to the stages of its step. Each stage is a free function over a block
// of envs.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/near_memory.hpp"
#include "base/random.hpp"
#include "base/workers.hpp"
#include "batch/contact_groups.hpp"
#include "batch/move_lines.hpp"
#include "batch/observation_memory.hpp"
#include "batch/outputs.hpp"
#include "batch/pool_state.hpp"
#include "batch/schedule.hpp"
#include "bodies/body_table.hpp"
#include "bodies/seen_drones.hpp"
#include "collision/hull.hpp"
#include "collision/obstacles.hpp"
#include "dynamics/fleet.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flockstep/batch.hpp"
#include "sensors/camera_rig.hpp"
#include "sensors/env_lights.hpp"
#include "sensors/sensor_suite.hpp"

namespace flockstep {

// Working memory of a thread that steps a block; made once.
struct Scratch {
  Scratch(const collision::Hull& hull, const collision::Corners& corners) : flight(hull, corners) {}

  trace::Tracer tracer;
  trace::BallSlices slices;  // drones of one env
  std::size_t thread = 0;    // its number
  dynamics::FlightScratch flight;
  std::vector<DroneIndex> flying;                 // drones of Block::flying during a step
  std::vector<DroneIndex> drones;                 // drones of some envs
  std::vector<EnvIndex> envs;                     // envs of a block
  std::vector<Pose> poses;                        // start and target of some drones
  bool moved_world = false;                       // an env has moved to another world
  std::unique_ptr<ContactGroups> contact_groups;  // null unless drones touch each other
  std::vector<MoveRequest> moves;                 // one env's
};

// The task of a batch, and the data that it exchanges with the episode machine.
struct TaskState {
  std::unique_ptr<Task> task;
  Buffer actions;                // (R, ...) actions of the current or last step
  Buffer actions_before;         // actions of the previous step
  Setpoints setpoints;           // written by task.command
  std::vector<Pose> step_start;  // (N,) poses before the flown step; for Control::pose with several ticks
  std::vector<float> path;       // (N, ticks + 1, 3) m, see TaskContext::path_of(); empty if the task does not record it
  Score score;                   // score of the last flown step; written by task.score
  std::vector<double> earned;    // (R, terms) sum over the flown steps of this step(); empty without frame_skip
  int max_episode_steps = 0;     // 0: no limit
  std::size_t rows_per_env = 1;  // drones_per_env if each drone has a row

  std::optional<ObservationMemory> memory;  // nothing if agents observe what the task observes

  // The task as agents see it.
  const TaskSpec& spec() const { return memory ? memory->spec() : task->spec(); }
  // Returns the buffer for the actions of a new step; those of the last step become the previous ones.
  template <class T>
  T* next_actions() {
    std::swap(actions, actions_before);
    return actions.row<T>(0).data();
  }
};

// A part of a batch's configuration: its name and the hash of its value.
struct ConfigPart {
  std::string name;
  std::uint64_t hash;
};

struct Simulation {
  Simulation(BatchConfig config, Batch::Worlds worlds, std::unique_ptr<Task> task, DroneModel drone,
             std::span<const std::int32_t> world_index, std::optional<WorldPool> pool = std::nullopt);

  std::size_t num_envs() const { return static_cast<std::size_t>(config.num_envs); }
  // Within a step; threads may call it for different drones at the same time. Other calls rebuild the schedule.
  void set_active(DroneIndex drone, bool is_active) {
    state.active[drone] = is_active;
    if (seen_drones) seen_drones->update(drone);
  }
  bool drones_touch() const { return collides(config.interaction) && config.drones_per_env > 1; }
  std::size_t drones_per_env() const { return static_cast<std::size_t>(config.drones_per_env); }
  std::size_t num_drones() const { return static_cast<std::size_t>(config.num_drones()); }
  EnvIndex env_of(DroneIndex drone) const {  // no division for single drones
    return EnvIndex(config.drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env());
  }
  DroneIndex drone_of(EnvIndex env, std::size_t member) const { return DroneIndex(env * drones_per_env() + member); }
  RandomKey random_key(DroneIndex drone) const { return RandomKey::of(drone, drones_per_env()); }
  // Rows of actions, observations, rewards and the other outputs: R in total. The rows of an env are consecutive.
  std::size_t rows_per_env() const { return task_state->rows_per_env; }
  std::size_t num_rows() const { return num_envs() * rows_per_env(); }
  std::size_t row_of(DroneIndex drone) const {
    return rows_per_env() == drones_per_env() ? std::size_t{drone} : std::size_t{env_of(drone)};
  }
  // How the episodes of the drones of an env belong together; a single drone is a team.
  Episodes episodes_mode() const { return drones_per_env() == 1 || !task_state ? Episodes::team : config.episode.episodes; }
  // Returns true if a drone of an env in such a list is one of those that the list concerns.
  bool takes_part(DroneIndex drone, Part part) const {
    const Episodes mode = episodes_mode();
    if (mode == Episodes::team || part == Part::active) return state.active[drone];
    if (part == Part::flown) return episodes.flying[drone];  // it may rest since then
    if (mode == Episodes::last) return state.active[drone];
    if (part == Part::flying) return state.active[drone] && episodes.flying[drone] && !episodes.done[drone];
    return state.active[drone] && begins[drone];
  }
  // The buffers that the task observes into: the outputs, unless agents observe something else.
  std::span<Buffer> observed() { return task_state->memory ? task_state->memory->newest() : outputs.now().observation; }
  // The slot of each env's world in the tables below.
  const std::vector<std::int32_t>& slots() const { return pool ? pool->slots : state.world_index; }
  std::size_t slot_of(EnvIndex env) const { return static_cast<std::size_t>(slots()[env]); }
  // The drones of some envs that take part, env by env; valid until the next call with this scratch.
  std::span<const DroneIndex> drones_of(const EnvList& envs, Scratch& scratch) const { return drones_of(envs, scratch.drones); }
  std::span<const DroneIndex> drones_of(const EnvList& envs, std::vector<DroneIndex>& list) const {
    return drones_of(envs, envs.part(), list);
  }
  std::span<const DroneIndex> drones_of(std::span<const EnvIndex> envs, Part part, std::vector<DroneIndex>& list) const;

  // Calls f(block, scratch, thread) for every block, on the worker threads.
  template <class F>
  void for_each_block(const F& f) {
    workers.run(schedule.blocks().size(),
                [&](std::size_t block, std::size_t thread) { f(schedule.blocks()[block], *scratches[thread], thread); });
  }
  // Prefetches the worlds of the drones that follow in a list, if they are in other worlds. If each drone has a separate world,
  // that world is rarely in the cache.
  void fetch_ahead(std::span<const DroneIndex> drones, std::size_t i) const {
    constexpr std::size_t kParts = 4, kWhole = 8;  // drones ahead
    if (i + kWhole < drones.size()) {
      const std::size_t world = slot_of(env_of(drones[i + kWhole]));
      if (world == slot_of(env_of(drones[i]))) return;
      prefetch(obstacles[world], sizeof(*obstacles[world]));
      prefetch(scenes[world], sizeof(*scenes[world]));
    }
    if (i + kParts < drones.size()) obstacles[slot_of(env_of(drones[i + kParts]))]->prefetch_parts();
  }
  trace::EmbreeUse embree_use_of_lidars() const {
    trace::EmbreeUse use = embree_use_before;
    for (const auto& scratch : scratches) use += scratch->tracer.embree_use();
    return use;
  }
  trace::EmbreeUse embree_use() const {
    trace::EmbreeUse use = embree_use_of_lidars();
    use += cameras.embree_use();
    return use;
  }
  // Empty if there is no such sensor.
  const LidarReadings& lidar_readings(std::size_t lidar) const {
    static const LidarReadings none;
    return lidar < suite.lidars().size() ? suite.lidars()[lidar]->readings() : none;
  }
  void warn_of_lost_drones();
  // Takes the renderer and the pending warnings of a simulation that this one replaces, and leaves it only the memory that
  // views need.
  void take_over(Simulation& other) noexcept;
  // The drones of all envs as their LiDARs see each other; none if they do not.
  trace::Bodies hulls() const { return seen_drones && drones_per_env() > 1 ? seen_drones->hulls() : trace::Bodies(); }
  // Call it after State::active has changed.
  void rebuild_schedule() {
    schedule.rebuild(sorts_by_world ? std::span<const std::int32_t>(slots()) : std::span<const std::int32_t>(), state.active);
    if (seen_drones) seen_drones->update();
  }

  BatchConfig config;             // only set_variations() changes it
  std::optional<PoolState> pool;  // if the worlds are drawn from a pool
  // Tables by slot: the world, its scene for rays, its obstacles for drones and its bodies. They are constant without a pool.
  // With a pool, free slots are null.
  Batch::Worlds worlds;
  std::vector<const World*> world_pointers;
  std::vector<const trace::Scene*> scenes;
  std::vector<const collision::Obstacles*> obstacles;
  std::vector<bodies::Models> body_models;  // one for each of World::bodies()
  const DroneModel drone_model;
  const collision::Hull hull;
  const collision::Corners corners;      // corners of the hull
  std::optional<dynamics::Fleet> fleet;  // only for rotor-driven drones
  FlagArray lost;  // (N,) of a fleet: FlightContext::bad of the last Batch::fly(), unless each drone has a row of a task

  State state;
  std::optional<bodies::BodyTable> bodies;  // nothing if the envs have no slots for bodies
  FlagArray unplaced;            // (N,) the drone begins an episode and has no place yet; empty unless drones touch each other
  std::vector<float> deviation;  // (N,) see FlightContext::deviation; empty unless rotor-driven drones touch each other
  std::optional<bodies::SeenDrones> seen_drones;  // nothing if drones do not see each other
  sensors::SensorSuite suite;
  sensors::EnvLights lights;
  sensors::CameraRig cameras;
  MoveLines move_lines;

  EpisodeState episodes;                // empty without a task
  FlagArray begins;                     // (N,) drones of Block::resetting that begin an episode; only with Episodes::each
  std::optional<TaskState> task_state;  // null without a task
  Batch::Controller controller;         // empty: the built-in one
  std::unique_ptr<TaskContext> context;
  OutputSlots outputs;

  Workers workers;
  // True if the schedule sorts envs by world, because the tracer is Embree or some world so far may need it: rays in one world
  // then share its packets and trees. Otherwise envs stay in index order, which keeps contiguous pieces of arrays long.
  bool sorts_by_world = false;
  Schedule schedule;
  std::vector<std::unique_ptr<Scratch>> scratches;  // one for each worker thread
  std::vector<EnvIndex> listed;                     // (E,) capacity; envs of all blocks, for a task that takes all at once
  std::vector<DroneIndex> listed_drones;            // (N,) capacity; drones of `listed`
  std::vector<DroneIndex> captured;                 // (N,) capacity; drones of all blocks, for capture()
  bool is_stepping = false;                         // during a step; the blocks must not change
  bool is_cut_short = false;                        // an exception cut a step or reset short
  std::string warning;                              // not reported yet
  bool has_far_yaw = false;                         // fly() has warned of one
  trace::EmbreeUse embree_use_before;               // by the LiDARs of the simulations that this one has replaced
  std::vector<ConfigPart> config_parts;             // empty until a snapshot needs them
};

}  // namespace flockstep
