#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "base/platform.hpp"
#include "base/pose_access.hpp"
#include "base/require.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/flying.hpp"
#include "batch/simulation.hpp"
#include "batch/task_context.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

int bytes_of_pixel(const CameraOutputs& o) {
  return 3 * o.rgb + 4 * o.depth + 2 * o.semantic + 2 * o.instance + 12 * o.normal + 1 * o.grey + 3 * o.hsv + 2 * o.events;
}
int bytes_of_beam(const LidarOutputs& o) { return 4 + 2 * o.semantic + 2 * o.instance + 4 * o.intensity; }
double bytes_of_scan(const LidarConfig& lidar) {
  return static_cast<double>(bytes_of_beam(lidar.outputs)) * lidar.rows() * lidar.columns();
}
// All written images of a camera, together.
double bytes_of_image(const CameraConfig& camera) {
  return static_cast<double>(bytes_of_pixel(camera.outputs)) * camera.image_width_px() * camera.image_height_px();
}

// Checks that the arrays of the sensors fit into memory, first without the readings that are under way.
void check_memory_of_sensors(const BatchConfig& config) {
  double bytes = 0.0;  // for one drone
  double rays = 0.0;   // in the tables of lenses, for all drones
  for (const LidarConfig& lidar : config.lidars) {
    bytes += bytes_of_scan(lidar);
    if (lidar.errors.divergence_mrad > 0.0F) bytes += 4.0 * lidar.rows() * lidar.columns();  // the rays at the edges
  }
  for (const CameraConfig& camera : config.cameras) {
    const CameraOutputs& o = camera.outputs;
    const int of_pixel = bytes_of_pixel(o);
    bytes += bytes_of_image(camera);
    const int of_rendered_pixel =
        (camera.resize ? of_pixel - 3 * (o.rgb && o.hsv) - 2 * o.events : 3 * (o.hsv && !o.rgb)) + (o.events && !o.grey);
    bytes += static_cast<double>(of_rendered_pixel) * camera.width_px * camera.height_px;
    if (o.events) {
      bytes += sensors::Events::bytes_of_pixel(camera.event_pixels) * camera.image_width_px() * camera.image_height_px();
    }
    if (camera.has_lens()) rays += (1.0 + camera.samples_per_pixel) * camera.width_px * camera.height_px;
  }
  checks::memory(bytes * config.num_drones() + 16.0 * rays);
  for (const LidarConfig& lidar : config.lidars) {
    const std::int64_t period = sensors::period_in_ticks(lidar.rate_hz, config.clock, "lidar.rate_hz");
    const auto scans = static_cast<double>(sensors::ring_size(lidar, period, config.clock));
    bytes += scans * bytes_of_scan(lidar);
    checks::memory(bytes * config.num_drones(), "lidar.latency_s, lidar.jitter_s");
  }
  for (const CameraConfig& camera : config.cameras) {
    bytes += bytes_of_image(camera) * static_cast<double>(sensors::ring_size(camera, 0, config.clock));
    checks::memory(bytes * config.num_drones(), "camera.latency_s, camera.jitter_s");
  }
}

// Sets the default physics_hz of motion by rotors.
void set_default_physics_rate(BatchConfig& config) {
  constexpr float kUsualPhysicsHz = 500.0F;
  ClockConfig& clock = config.clock;
  const float called_hz = clock.controller_hz.value_or(clock.policy_hz);
  if (config.dynamics.is_kinematic() || clock.physics_hz || !(called_hz > 0.0F)) return;
  require(clock.policy_hz >= kUsualPhysicsHz / 1000.0F, "policy_hz",
          "at least 0.5 Hz for motion by rotors, or a physics_hz (500 Hz by default, at most 1000 ticks per step)",
          clock.policy_hz);
  clock.physics_hz = called_hz * std::max(std::ceil(kUsualPhysicsHz / called_hz), 1.0F);
}

BatchConfig validated(BatchConfig config, const Task* task) {
  // Check this before config.validate(), whose message would recommend a control that the task then rejects.
  require(!config.dynamics.is_kinematic() || task == nullptr || task->takes(Control::pose), "motion",
          "\"rotors\", which this task needs", "\"kinematic\"");
  set_default_physics_rate(config);
  config.validate();
  for (const Light& light : config.lights) checks::drawable(config, light);
  require(task == nullptr || config.num_drones() > 0, "num_drones = num_envs x drones_per_env",
          "at least one drone with a task (its arrays cannot grow)", config.num_drones());
  require(task != nullptr || config.observed.is_off(), "observed",
          "its default for a batch without a task, which observes nothing", "another");
  require(task != nullptr || config.privileged.empty(), "privileged", "none for a batch without a task, which observes nothing",
          config.privileged.size());
  check_memory_of_sensors(config);
  return config;
}

Batch::Worlds validated(Batch::Worlds worlds, const BatchConfig& config) {
  require(!worlds.empty(), "worlds", "at least one world", "none");
  for (const auto& world : worlds) {
    require(world != nullptr, "worlds", "worlds", "a null pointer");
    checks::drawable(config, world->light());
    checks::instances_of_world(*world, config);
  }
  return worlds;
}

PoolState validated(WorldPool pool, const BatchConfig& config, bool has_task, bool has_world_index) {
  pool.validate();
  if (!has_task) throw std::invalid_argument("worlds: a WorldPool needs a task, whose resets draw the worlds: give task=...");
  if (has_world_index) throw std::invalid_argument("world_index: not allowed with a WorldPool: each episode draws its world");
  require(config.camera_backend != CameraBackend::gl || config.cameras.empty(), "camera_backend", "raycast with a WorldPool",
          "gl");
  return PoolState(std::move(pool), static_cast<std::size_t>(config.num_envs));
}

// All envs begin in world 0.
Batch::Worlds first_world(const PoolState& pool) {
  Batch::Worlds worlds(pool.slots.size());
  worlds[0] = pool.pool.source->get(0);
  require(worlds[0] != nullptr, "worlds", "worlds", "a null pointer for world 0 of the pool");
  return worlds;
}

std::vector<const World*> pointers(const Batch::Worlds& worlds) {
  std::vector<const World*> result;
  for (const auto& world : worlds) result.push_back(world.get());
  return result;
}

// Slots for bodies in each env.
std::size_t body_slots(const BatchConfig& config, std::span<const World* const> worlds, bool has_pool) {
  std::size_t most = config.bodies.size();
  if (!has_pool) {
    for (const World* const world : worlds) most = std::max(most, world->bodies().size() + config.bodies.size());
  }
  const std::size_t slots =
      config.max_bodies > 0 ? static_cast<std::size_t>(config.max_bodies) : std::min<std::size_t>(most, kMaxBodies);
  constexpr double kBytes = 300.0;  // bytes per slot
  checks::memory(kBytes * static_cast<double>(slots) * config.num_envs);
  return slots;
}

std::optional<dynamics::Fleet> fleet_of(const BatchConfig& config, const DroneModel& drone) {
  if (config.dynamics.is_kinematic()) return std::nullopt;
  require(drone.airframe().has_value(), "drone",
          "one with an airframe, to fly by its rotors (such as a bundled one: DroneModel.names())", "only a hull");
  std::vector<Airframe> airframes;
  for (const std::string& frame : config.airframes) {
    const DroneModel model = DroneModel::load(frame);
    require(model.airframe().has_value(), "airframes", "drones with an airframe", '"' + frame + "\", which has only a hull");
    airframes.push_back(*model.airframe());
  }
  if (airframes.empty()) airframes.push_back(*drone.airframe());
  return dynamics::Fleet(airframes, std::vector<std::int32_t>(static_cast<std::size_t>(config.num_drones())), config.dynamics,
                         config.clock, static_cast<std::size_t>(config.drones_per_env),
                         dynamics::Variations(config.variations, airframes, config.clock));
}

template <class Enum>
std::string quoted(Enum value) {
  return '"' + std::string(EnumNames<Enum>::kNames[static_cast<std::size_t>(value)]) + '"';
}

// The controls that a task takes, as text for a message.
std::string controls_of(const Task& task) {
  std::string list;
  for (std::size_t i = 0; i < EnumNames<Control>::kNames.size(); ++i) {
    const auto control = static_cast<Control>(i);
    if (task.takes(control)) list += (list.empty() ? "" : ", ") + quoted(control);
  }
  return "a control that this task takes (" + list + ")";
}

// Attaches the task to a simulation.
void begin_task(Simulation& sim, std::unique_ptr<Task> task) {
  sim.task_state.emplace(TaskState{.task = std::move(task)});
  TaskState& task_state = *sim.task_state;
  const Control control = sim.config.dynamics.control;
  if (!task_state.task->takes(control)) refuse("control", controls_of(*task_state.task), quoted(control));
  task_state.task->setup(*sim.context);
  if (sim.pool) require_world_of_pool(sim, 0, sim.world_pointers[0]);
  if (!sim.pool) {
    for (const World* const world : sim.world_pointers) task_state.task->require_world(*world, sim.drone_model);
  }
  checks::spec(task_state.task->spec());
  task_state.rows_per_env = task_state.task->spec().row == Row::drone ? sim.drones_per_env() : 1;
  if (!sim.config.observed.is_off() || !sim.config.privileged.empty()) {
    task_state.memory.emplace(sim.config, task_state.task->spec(), sim.num_rows(), sim.context->num_rotors());
    checks::spec(task_state.spec());
  }
  const TaskSpec& spec = task_state.spec();
  require(sim.episodes_mode() == Episodes::team || spec.row == Row::drone, "episodes",
          "\"team\" for a task with a row for each env, whose drones share an episode", quoted(sim.config.episode.episodes));
  double bytes = 0.0;  // bytes of a row: two slots, each with the current and the final observation
  for (const Field& field : spec.observation) bytes += 4.0 * static_cast<double>(field.size() * size_of(field.type));
  const std::size_t n = sim.num_rows();
  checks::memory(bytes * static_cast<double>(n));
  EpisodeState& episodes = sim.episodes;
  const ArraySizes sizes{
      .num_envs = sim.num_envs(), .num_drones = sim.num_drones(), .num_task_rows = n, .num_terms = spec.reward_terms.size()};
  allocate(episodes, sizes);
  if (sim.episodes_mode() != Episodes::team) allocate(sim.state.own, sizes);
  if (sim.episodes_mode() == Episodes::each) sim.begins.resize(n);
  task_state.actions = task_state.actions_before = Buffer(spec.action, n);
  const bool uses_pose_targets = sim.config.dynamics.control == Control::pose;
  if (uses_pose_targets) task_state.setpoints.target.resize(sim.num_drones());
  if (!uses_pose_targets) task_state.setpoints.command.resize(sim.context->command_size() * sim.num_drones());
  if (uses_pose_targets && sim.config.clock.substeps() > 1) task_state.step_start.resize(sim.num_drones());
  if (spec.records_path) {
    const auto ticks = static_cast<std::size_t>(sim.config.clock.substeps());
    checks::memory(12.0 * static_cast<double>(ticks + 1) * static_cast<double>(sim.num_drones()));
    task_state.path.resize(3 * (ticks + 1) * sim.num_drones());
    for (const auto& scratch : sim.scratches) scratch->flight.path.resize(ticks);
  }
  task_state.score.num_terms = spec.reward_terms.size();
  task_state.score.terms.resize(n * task_state.score.num_terms);
  task_state.score.terminated.resize(n);
  task_state.score.truncated.resize(n);
  task_state.score.success.resize(n);
  task_state.score.left_area.resize(n);
  if (sim.config.episode.frame_skip > 1) task_state.earned.resize(n * task_state.score.num_terms);
  task_state.max_episode_steps = sim.config.episode.max_episode_steps.value_or(task_state.task->defaults().max_episode_steps);
  require(!sim.config.episode.stagger_first_episode || task_state.max_episode_steps > 0, "stagger_first_episode",
          "False with max_episode_steps=0 (there is no limit to stagger)", "True");
  sim.outputs.allocate(spec, sizes);
}

}  // namespace

Simulation::Simulation(BatchConfig config_in, Batch::Worlds worlds_in, std::unique_ptr<Task> task, DroneModel drone,
                       std::span<const std::int32_t> world_index, std::optional<WorldPool> pool_in)
    : config(validated(std::move(config_in), task.get())),
      pool(pool_in ? std::optional(validated(std::move(*pool_in), config, task != nullptr, !world_index.empty())) : std::nullopt),
      worlds(pool ? first_world(*pool) : validated(std::move(worlds_in), config)),
      world_pointers(pointers(worlds)),
      drone_model(std::move(drone)),
      hull(drone_model),
      corners(drone_model.hull()),
      fleet(fleet_of(config, drone_model)),
      suite(config),
      lights(worlds, num_envs(), !config.lights.empty()),
      cameras(config.cameras, config.clock, world_pointers, pool ? pool->slots : state.world_index, lights, state,
              drones_per_env(), num_drones(), config.tracer),
      move_lines(state, drones_per_env(), num_drones()),
      workers(thread_count(config.num_threads)),
      schedule(num_envs(), worlds.size(), static_cast<std::size_t>(config.block_size),
               static_cast<std::size_t>(workers.num_threads())) {
  if (std::max(this->config.num_threads, workers.num_threads()) > logical_processors()) {
    warning = "num_threads=" + std::to_string(std::max(this->config.num_threads, workers.num_threads())) +
              ": this process may run on " + std::to_string(logical_processors()) + " processors; " +
              (this->config.num_threads > workers.num_threads()
                   ? std::to_string(workers.num_threads()) + " threads will run, at most four per processor"
                   : "more threads make it slower");
  }
  for (int i = 0; i < workers.num_threads(); ++i) {
    scratches.push_back(std::make_unique<Scratch>(hull, corners));
    scratches.back()->thread = static_cast<std::size_t>(i);
    for (auto* const drones : {&scratches.back()->flying, &scratches.back()->drones}) {
      drones->reserve(schedule.block_size() * drones_per_env());
    }
    scratches.back()->envs.reserve(schedule.block_size());
    if (!drones_touch()) continue;
    scratches.back()->contact_groups = std::make_unique<ContactGroups>();
    if (fleet) scratches.back()->flight.path.resize(static_cast<std::size_t>(this->config.clock.substeps()));
  }
  sorts_by_world = config.tracer == TracerKind::embree;
  // Build these now, so that no thread has to build them during a step.
  for (const World* const world : world_pointers) {
    if (world != nullptr) build_ahead(*world, config);
    scenes.push_back(world != nullptr ? &prepared(*world).scene() : nullptr);
    obstacles.push_back(world != nullptr ? &prepared(*world).obstacles() : nullptr);
    body_models.push_back(world != nullptr ? bodies::models_of(*world) : bodies::Models());
    sorts_by_world |= world != nullptr && scenes.back()->may_need_embree();
  }
  checks::world_index(*this, world_index, num_envs());

  const std::size_t bodies_per_env = body_slots(config, world_pointers, pool.has_value());
  for (const World* const world : world_pointers) {
    if (world != nullptr && !pool) checks::bodies_of_world(*world, config, bodies_per_env, hull.radius());
  }
  for (const BodyConfig& body : config.bodies) checks::body_within_ticks(body, config.clock, hull.radius());
  const ArraySizes sizes{.num_envs = num_envs(),
                         .num_drones = num_drones(),
                         .num_bodies = num_envs() * bodies_per_env,
                         .num_rotors = fleet ? fleet->num_rotors() : 0};
  allocate(state, sizes);
  allocate(state.contact, sizes);
  std::ranges::fill(state.contact.body, -1);
  std::ranges::fill(state.contact.drone, -1);
  if (fleet) allocate(state.flight, sizes);
  if (fleet && fleet->has_parameters()) allocate(state.parameters, sizes);
  if (fleet) lost.resize(num_drones());
  if (drones_touch()) unplaced.resize(num_drones());
  if (fleet && drones_touch()) deviation.resize(num_drones());
  std::fill(state.active.begin(), state.active.end(), std::uint8_t{1});
  std::fill(state.sensed.begin(), state.sensed.end(), std::int64_t{-1});
  std::iota(state.seed.begin(), state.seed.end(), std::uint64_t{0});
  for (std::size_t env = 0; env < num_envs(); ++env) {
    if (!pool) state.world_index[env] = world_index.empty() ? static_cast<std::int32_t>(env % worlds.size()) : world_index[env];
  }
  for (std::size_t i = 0; fleet && i < num_drones(); ++i) fleet->begin_parameters(state, DroneIndex(i));
  for (std::size_t i = 0; i < num_drones(); ++i) place_at_start(*this, DroneIndex(i));
  for (std::size_t env = 0; env < num_envs(); ++env) draw_light(*this, EnvIndex(env));
  suite.pose().assume_truth(state);
  if (bodies_per_env > 0) {
    allocate(state.bodies, sizes);
    bodies.emplace(state, config.bodies, bodies_per_env, config.clock.dt_s(),
                   [this](EnvIndex env) { return body_models[slot_of(env)]; });
    for (std::size_t env = 0; env < num_envs(); ++env) bodies->begin(EnvIndex(env));
    cameras.set_bodies(bodies->visible(), bodies_per_env);
  }
  if (senses(config.interaction)) {
    seen_drones.emplace(state, drone_model, config.drone_mesh, !config.cameras.empty());
    if (!config.cameras.empty()) cameras.set_drones(drones_per_env() > 1 ? seen_drones->visible() : render::VisibleBodies());
  }

  rebuild_schedule();
  listed.reserve(num_envs());
  listed_drones.reserve(num_drones());
  captured.reserve(num_drones());

  context = make_task_context(*this);
  if (task) begin_task(*this, std::move(task));
}

void Simulation::take_over(Simulation& other) noexcept {
  cameras.take_renderer(other.cameras);
  warning = std::move(other.warning);
  lights.take_worlds(other.lights);
  other.scratches.clear();
  other.workers.close();
}

void Simulation::warn_of_lost_drones() {
  const auto count = std::ranges::count(lost, 1);
  if (count == 0) return;
  std::ostringstream text;
  text << "fly(): " << count << (count == 1 ? " drone" : " drones") << " (first: " << std::ranges::find(lost, 1) - lost.begin()
       << ") moved faster than " << dynamics::kMaxSpeed << " m/s or turned faster than " << fleet->physics.max_turn
       << " rad/s, half a turn in a tick, and were stopped at their last valid pose; a higher physics_hz allows faster turns";
  warning = text.str();
}

}  // namespace flockstep
