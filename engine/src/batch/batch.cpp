#include "flockstep/batch.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/simulation.hpp"
#include "batch/snapshot.hpp"
#include "batch/step.hpp"

namespace flockstep {
namespace {

bool chosen(const Simulation& sim, Batch::Mask mask, std::size_t drone) {
  return sim.state.active[drone] && (mask.empty() || mask[drone]);
}

// f(drone), on the calling thread.
template <class F>
void for_each_chosen(const Simulation& sim, Batch::Mask mask, const F& f) {
  for (std::size_t drone = 0; drone < sim.num_drones(); ++drone) {
    if (chosen(sim, mask, drone)) f(static_cast<std::uint32_t>(drone));
  }
}

// Fills a list of each block with its envs that are chosen; an env is where its first drone is.
void list_chosen(Simulation& sim, Batch::Mask mask, EnvList Block::*list) {
  for (Block& block : sim.schedule.blocks()) {
    (block.*list).clear();
    for (const std::uint32_t env : block.envs) {
      if (chosen(sim, mask, env * sim.drones_per_env())) (block.*list).push(env);
    }
  }
}

// The pose a row asks for: what is missing stays, quaternions are normalised.
Pose requested_pose(const Simulation& sim, std::size_t drone, std::size_t row, std::span<const float> position,
                    std::span<const float> quat_wxyz) {
  Pose pose = pose_of(sim.state, drone);
  if (!position.empty()) pose.position = Vec3(position[3 * row], position[3 * row + 1], position[3 * row + 2]);
  if (!quat_wxyz.empty()) {
    const float* const q = quat_wxyz.data() + 4 * row;
    pose.rotation = Quat(q[0], q[1], q[2], q[3]).normalized();
  }
  return pose;
}

// A removed slot reads as absent from now on.
void mark_absent(Simulation& sim, std::size_t drone) {
  sim.state.active[drone] = 0;
  clear_contact(sim.state, drone);
  if (sim.lidar) sim.lidar->clear(drone);
  sim.cameras.clear(drone);
  if (sim.run) sim.outputs.mark_absent(sim.run->spec(), sim.env_of(drone));
}

void take_frames(Simulation& sim) {
  sim.cameras.start();
  sim.cameras.finish(sim.workers);
}

}  // namespace

Batch::Batch(BatchConfig config, Worlds worlds, std::unique_ptr<Task> task, DroneModel drone,
             std::span<const std::int32_t> world_index)
    : sim_(std::make_unique<Simulation>(std::move(config), std::move(worlds), std::move(task), std::move(drone), world_index)) {}

Batch::~Batch() = default;

const BatchConfig& Batch::config() const { return sim_->config; }
const Batch::Worlds& Batch::worlds() const { return sim_->worlds; }
const DroneModel& Batch::drone() const { return sim_->drone_model; }
int Batch::num_threads() const { return sim_->workers.num_threads(); }
const State& Batch::state() const { return sim_->state; }

// ------------------------------------------------------------------------------------------------------ motion and sensing

void Batch::set_pose(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  checks::poses(position, quat_wxyz, sim_->num_drones());
  for_each_chosen(*sim_, mask, [&](std::uint32_t drone) {
    set_pose_of(sim_->state, drone, requested_pose(*sim_, drone, drone, position, quat_wxyz));
    clear_contact(sim_->state, drone);
  });
}

void Batch::move(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  checks::poses(position, quat_wxyz, sim_->num_drones());
  sim_->for_each_block([&](Block& block, Scratch& scratch, std::size_t) {
    for (const std::uint32_t drone : sim_->drones_of(block.envs, scratch)) {
      if (!chosen(*sim_, mask, drone)) continue;
      sweep_to(*sim_, drone, requested_pose(*sim_, drone, drone, position, quat_wxyz));
      if (drone % sim_->drones_per_env() == 0) sim_->state.tick[sim_->env_of(drone)] += sim_->config.clock.substeps;
    }
  });
}

void Batch::sense(Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  list_chosen(*sim_, mask, &Block::chosen);
  read_sensors(*sim_);
}

// ------------------------------------------------------------------------------------------------------------------- slots

void Batch::spawn(std::span<const std::int64_t> indices, std::span<const float> position, std::span<const float> quat_wxyz,
                  std::span<const std::int32_t> world_index) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "spawn");
  checks::indices(*sim_, indices);
  checks::poses(position, quat_wxyz, indices.size());
  checks::world_index(*sim_, world_index, indices.size());
  State& state = sim_->state;
  std::vector<std::uint8_t> spawned(sim_->num_drones());
  for (std::size_t row = 0; row < indices.size(); ++row) {
    const auto drone = static_cast<std::size_t>(indices[row]);
    const std::size_t env = sim_->env_of(drone);
    if (!world_index.empty()) state.world_index[env] = world_index[row];
    state.active[drone] = spawned[drone] = 1;
    forget_readings(*sim_, env);
    set_pose_of(state, drone, requested_pose(*sim_, drone, row, position, quat_wxyz));
    clear_contact(state, drone);
    if (!sim_->run) continue;
    start_counts(*sim_, env);
    sim_->outputs.clear(env);
  }
  sim_->rebuild_schedule();
  if (sim_->run) {
    list_chosen(*sim_, spawned, &Block::opening);
    begin_episodes_here(*sim_);
  } else {
    list_chosen(*sim_, spawned, &Block::chosen);
    read_sensors(*sim_);
  }
}

void Batch::remove(std::span<const std::int64_t> indices) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "remove");
  checks::indices(*sim_, indices);
  for (const std::int64_t index : indices) mark_absent(*sim_, static_cast<std::size_t>(index));
  sim_->rebuild_schedule();
}

void Batch::set_world(std::span<const std::int32_t> world_index, Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  checks::size(world_index.size(), sim_->num_envs(), "world_index");
  checks::world_index(*sim_, world_index, sim_->num_envs());
  for (std::size_t env = 0; env < sim_->num_envs(); ++env) {
    if (mask.empty() || mask[env * sim_->drones_per_env()]) sim_->state.world_index[env] = world_index[env];
  }
  if (sim_->is_stepping) {
    sim_->scratches[0]->moved_world = true;  // the blocks follow when the step is over
  } else {
    sim_->rebuild_schedule();
  }
}

// ----------------------------------------------------------------------------------------------------------------- sensors

const std::vector<float>& Batch::sensed_position() const { return sim_->pose_sensor.position(); }
const std::vector<float>& Batch::sensed_quat_wxyz() const { return sim_->pose_sensor.quat_wxyz(); }

void Batch::require_lidar(std::string_view name) const {
  checks::has_lidar(*sim_);
  require(name.empty() || name == sim_->config.lidar->name, "lidar", '"' + sim_->config.lidar->name + '"',
          '"' + std::string(name) + '"');
}

void Batch::set_lidar(const LidarChange& change, Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  checks::has_lidar(*sim_);
  std::vector<std::uint32_t> drones;
  for_each_chosen(*sim_, mask, [&](std::uint32_t drone) { drones.push_back(drone); });
  sim_->lidar->change(change, drones);
}

const std::vector<float>& Batch::lidar_ranges() const {
  static const std::vector<float> none;
  return sim_->lidar ? sim_->lidar->ranges() : none;
}

std::span<const float> Batch::lidar_max_range_m() const {
  checks::has_lidar(*sim_);
  return sim_->lidar->max_range();
}

LidarConfig Batch::lidar_config(std::int64_t index) const {
  checks::has_lidar(*sim_);
  checks::index(*sim_, index);
  return sim_->lidar->config_of(static_cast<std::size_t>(index));
}

void Batch::lidar_directions(std::span<float> out) const {
  checks::has_lidar(*sim_);
  checks::size(out.size(), 3 * sim_->num_drones() * sim_->lidar->rays_per_drone(), "out");
  sim_->lidar->write_directions(out);
}

void Batch::lidar_points(std::span<float> out) const {
  checks::has_lidar(*sim_);
  checks::size(out.size(), 3 * sim_->num_drones() * sim_->lidar->rays_per_drone(), "out");
  sim_->lidar->write_points(sim_->state, out);
}

std::size_t Batch::camera_index(std::string_view name) const {
  const auto& cameras = sim_->config.cameras;
  if (name.empty() && cameras.size() == 1) return 0;
  const auto found =
      std::find_if(cameras.begin(), cameras.end(), [&](const CameraConfig& camera) { return camera.name == name; });
  if (found == cameras.end()) {
    std::string names;
    for (const CameraConfig& camera : cameras) names += (names.empty() ? "\"" : ", \"") + camera.name + '"';
    refuse("camera", cameras.empty() ? "a Batch with cameras (cameras=[...])" : "one of " + names,
           name.empty() ? "no name" : '"' + std::string(name) + '"');
  }
  return static_cast<std::size_t>(found - cameras.begin());
}

const CameraConfig& Batch::camera_config(std::size_t camera) const {
  checks::has_camera(*sim_, camera);
  return sim_->cameras[camera].config();
}

const CameraImages& Batch::images(std::size_t camera) const {
  checks::has_camera(*sim_, camera);
  return sim_->cameras[camera].images();
}

CameraConfig Batch::camera_config(std::size_t camera, std::int64_t index) const {
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras[camera].config_of(static_cast<std::size_t>(index));
}

void Batch::capture(std::size_t camera, Mask mask) {
  checks::own_process(*sim_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  std::vector<std::uint32_t> drones;  // in the order of the blocks: those of one world follow each other
  for (const Block& block : sim_->schedule.blocks()) {
    for (const std::uint32_t drone : sim_->drones_of(block.envs, *sim_->scratches[0])) {
      if (chosen(*sim_, mask, drone)) drones.push_back(drone);
    }
  }
  sim_->cameras.ask_now(camera, drones);
  take_frames(*sim_);
}

void Batch::set_capture_mode(std::size_t camera, CaptureMode mode) {
  checks::own_process(*sim_);
  checks::has_camera(*sim_, camera);
  checks::capture_mode(*sim_, camera, mode);
  sim_->cameras[camera].set_capture_mode(mode);
}

void Batch::set_camera(std::size_t camera, const CameraChange& change, Mask mask) {
  checks::own_process(*sim_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  std::vector<std::uint32_t> drones;
  for_each_chosen(*sim_, mask, [&](std::uint32_t drone) { drones.push_back(drone); });
  sim_->cameras[camera].change(change, drones);
}

const std::string& Batch::camera_backend_report() const { return sim_->cameras.report(); }

std::string Batch::take_warning() { return sim_->cameras.take_warning(); }

std::string Batch::jpeg(std::size_t camera, std::int64_t index, int quality) const {
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras.jpeg(camera, static_cast<std::size_t>(index), quality);
}

// ---------------------------------------------------------------------------------------------------------- random numbers

void Batch::seed(std::span<const std::uint64_t> seeds, Mask mask) {
  checks::own_process(*sim_);
  checks::mask(*sim_, mask);
  checks::size(seeds.size(), sim_->num_envs(), "seeds");
  for_each_chosen(*sim_, mask, [&](std::uint32_t drone) {
    const std::size_t env = sim_->env_of(drone);
    sim_->state.seed[env] = seeds[env];
    sim_->state.episode[env] = 0;
    forget_readings(*sim_, env);
  });
}

void Batch::begin_episode(Mask mask) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "begin_episode");
  checks::mask(*sim_, mask);
  for_each_chosen(*sim_, mask, [&](std::uint32_t drone) {
    if (drone % sim_->drones_per_env() == 0) ++sim_->state.episode[sim_->env_of(drone)];
    forget_readings(*sim_, sim_->env_of(drone));
  });
}

void Batch::random(std::uint32_t stream, int count, std::span<float> out) const {
  require(stream < 0x80000000U, "stream", "an integer in [0, 2147483648)", stream);
  require(count >= 0, "count", "an integer >= 0", count);
  const auto columns = static_cast<std::size_t>(count);
  checks::size(out.size(), sim_->num_envs() * columns, "out");
  for (std::size_t env = 0; env < sim_->num_envs(); ++env) {
    for (std::size_t k = 0; k < columns; ++k) {
      out[env * columns + k] = draw_uniform(sim_->state, env, stream, static_cast<std::uint32_t>(k));
    }
  }
}

// -------------------------------------------------------------------------------------------------------------------- task

const Task* Batch::task() const { return sim_->run ? sim_->run->task.get() : nullptr; }

void Batch::reset(std::span<const std::uint64_t> seeds, Mask mask) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "reset");
  checks::has_task(*sim_);
  checks::mask(*sim_, mask);
  if (!seeds.empty()) checks::size(seeds.size(), sim_->num_envs(), "seeds");
  sim_->outputs.turn_and_copy();
  list_chosen(*sim_, mask, &Block::opening);
  for (const Block& block : sim_->schedule.blocks()) {
    for (const std::uint32_t env : block.opening) {
      if (seeds.empty()) {
        open_next_episode(*sim_, env, *sim_->scratches[0]);
      } else {
        sim_->state.seed[env] = seeds[env];
        sim_->state.episode[env] = 0;
        open_episode(*sim_, env, *sim_->scratches[0]);
      }
      sim_->outputs.clear(env);
    }
  }
  begin_episodes(*sim_);
}

void Batch::step(std::span<const std::int64_t> actions) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "step");
  checks::has_task(*sim_);
  checks::actions(*sim_, actions);
  checks::begun(*sim_);
  if (sim_->run->actions.type() == DType::int64) {
    std::copy(actions.begin(), actions.end(), sim_->run->actions.row<std::int64_t>(0).data());
  } else {
    std::transform(actions.begin(), actions.end(), sim_->run->actions.row<std::int32_t>(0).data(),
                   [](std::int64_t action) { return static_cast<std::int32_t>(action); });
  }
  flockstep::step(*sim_);
}

void Batch::step(std::span<const float> actions) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "step");
  checks::has_task(*sim_);
  checks::actions(*sim_, actions);
  checks::begun(*sim_);
  std::copy(actions.begin(), actions.end(), sim_->run->actions.row<float>(0).data());
  flockstep::step(*sim_);
}

const EpisodeState& Batch::episodes() const {
  checks::has_task(*sim_);
  return sim_->episodes;
}

const Outputs& Batch::outputs() const { return sim_->outputs.now(); }
Outputs& Batch::outputs() { return sim_->outputs.now(); }

void Batch::visit_task(ArrayVisitor& visitor) const {
  checks::has_task(*sim_);
  sim_->run->task->visit(visitor);
}

// --------------------------------------------------------------------------------------------------------------- snapshots

std::string Batch::snapshot() const {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "snapshot");
  return make_snapshot(*sim_);
}

void Batch::restore(const std::string& blob) {
  checks::own_process(*sim_);
  checks::not_stepping(*sim_, "restore");
  restore_snapshot(*sim_, blob);
  for (std::size_t drone = 0; drone < sim_->num_drones(); ++drone) {
    if (!sim_->state.active[drone]) mark_absent(*sim_, drone);  // in the other slot too, where it may have been alive
  }
  sim_->rebuild_schedule();
  sim_->cameras.ask_again();
  take_frames(*sim_);
}

}  // namespace flockstep
