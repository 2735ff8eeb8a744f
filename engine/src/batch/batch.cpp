#include "flockstep/batch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <numeric>
#include <utility>

#include "base/platform.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "base/workers.hpp"
#include "batch/arrays.hpp"
#include "batch/schedule.hpp"
#include "batch/snapshot.hpp"
#include "collision/sweep.hpp"
#include "compiled/compiled_world.hpp"
#include "render/jpeg.hpp"
#include "render/renderer.hpp"
#include "sensors/camera.hpp"
#include "sensors/lidar.hpp"
#include "sensors/pose_sensor.hpp"
#include "task/green_blob.hpp"
#include "task/navigation.hpp"

namespace flockstep {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Per camera, to time backends by: so many requests, or fewer of many pixels.
constexpr std::size_t kTypicalRequests = 64;
constexpr std::size_t kTypicalPixels = 16 * 640 * 480;
constexpr std::uint64_t kSnapshotMagic = 0x3130534b434f4c46ULL;  // "FLOCKS01"

// The run-time setting of one drone's LiDAR, as it stands in a snapshot.
struct LidarSetting {
  float hfov_deg, vfov_deg, max_range_m;
  std::array<float, 3> offset_m;
  std::array<float, 4> quat_wxyz;
};

// The same of a camera; a field of view that is not given is 0.
struct CameraSetting {
  float hfov_deg, vfov_deg;
  std::array<float, 3> offset_m;
  std::array<float, 4> quat_wxyz;
};

// Instance ids are 16 bits wide.
void require_instances(const World& world) {
  const auto& objects = world.triangles().objects;
  const std::size_t meshes = objects.empty() ? 0 : std::size_t{1} + *std::max_element(objects.begin(), objects.end());
  const Markers& markers = world.markers();
  const std::size_t places = markers.waypoints.size() + (markers.start ? 1 : 0) + (markers.goal ? 1 : 0);
  const std::size_t instances = world.primitives().size() + meshes + places;
  require(instances <= 65535, "camera.outputs.instance", "worlds of at most 65535 primitives, meshes and markers",
          std::to_string(instances) + " in " + world.name());
}

std::string row_of(std::string_view field, std::size_t row) { return std::string(field) + " (row " + std::to_string(row) + ")"; }

void require_size(std::size_t size, std::size_t expected, const char* field) {
  require(size == expected, field, std::to_string(expected) + " numbers", size);
}

BatchConfig validated(BatchConfig config) {
  config.validate();
  return config;
}

Batch::Worlds validated(Batch::Worlds worlds) {
  require(!worlds.empty(), "worlds", "at least one world", "none");
  for (const auto& world : worlds) require(world != nullptr, "worlds", "worlds", "a null pointer");
  return worlds;
}

// What one thread needs while it steps a block; made once.
struct Scratch {
  trace::Tracer tracer;
  task::GreenBlobScratch green;
  std::vector<std::uint32_t> drones;  // those of the block that a stage is about
  bool changed_world = false;         // a reset moved a drone to another world

  explicit Scratch(std::size_t block_size) { drones.reserve(block_size); }
};

}  // namespace

struct Batch::Impl {
  Impl(BatchConfig config_in, Worlds worlds_in, DroneModel drone_in, std::span<const std::int32_t> world_index);
  void add_cameras();
  void add_typical_requests();

  // What a drone does in the call under way.
  enum class Role : std::uint8_t {
    rests,   // nothing
    flies,   // takes the step's action; sensed and evaluated
    landed,  // its episode ended before it had flown the action as often as it is to be
    begins,  // begins an episode, or is sensed alone
    ended,   // its episode ended in this step, and it begins the next one
  };

  // --- one step, as a table of contents
  void step();
  void fly(std::span<const std::uint32_t> drones, Scratch& scratch);
  void sense(std::span<const std::uint32_t> drones, Scratch& scratch);
  void evaluate(std::span<const std::uint32_t> drones, Scratch& scratch);
  void observe(std::span<const std::uint32_t> drones, Scratch& scratch);

  // --- its pieces
  Role wait_or_fly(std::uint32_t drone, Scratch& scratch);
  void observe_ranges(std::uint32_t drone);
  void reward(std::uint32_t drone, bool first);
  void observe_head(std::uint32_t drone, Scratch& scratch);
  void keep_final(std::uint32_t drone);
  std::span<const std::uint32_t> with_role(std::span<const std::uint32_t> drones, std::initializer_list<Role> roles,
                                           Scratch& scratch) const;
  void sense_all(std::initializer_list<Role> roles);
  void start_frames(std::initializer_list<Role> roles);
  void start_requests();
  void finish_requests();
  void retake_frames();

  // --- pieces shared with the other calls
  Outputs& out() { return slots[current]; }
  const Outputs& last() const { return slots[1 - current]; }
  std::size_t size() const { return state.active.size(); }
  std::uint64_t hash();
  bool chosen(Mask mask, std::size_t drone) const { return state.active[drone] && (mask.empty() || mask[drone]); }
  std::span<const float> ranges_of(std::size_t drone) const { return std::span(state.lidar_ranges).subspan(drone * rays, rays); }
  const World& world_of(std::size_t drone) const { return *worlds[static_cast<std::size_t>(state.world_index[drone])]; }
  void begin_scans(std::size_t drone);
  void sweep_to(std::size_t drone, const Pose& target);
  void clear_contact(std::size_t drone);
  void begin_next_episode(std::uint32_t drone, Scratch& scratch);
  void clear_outputs(Outputs& outputs, std::size_t drone);
  void mark_absent(std::size_t drone);
  void reschedule_if_moved();
  void choose(Mask mask);  // gives the chosen drones the role `begins`, the others `rests`
  template <class F>
  void for_each_chosen(Mask mask, const F& f);  // f(drone), on the calling thread
  template <class F>
  void run_blocks(const F& f);  // f(drones, scratch), on the workers

  // --- refusing bad input
  void require_own_process() const;
  void require_lidar() const;
  void require_camera(std::size_t camera) const;
  void require_mode(std::size_t camera, CaptureMode mode) const;
  void require_index(std::int64_t index) const;
  void require_task() const;
  void require_begun() const;
  void require_mask(Mask mask) const;
  void require_poses(std::span<const float> position, std::span<const float> quat_wxyz, std::size_t rows) const;
  void require_world_index(std::span<const std::int32_t> world_index, std::size_t rows) const;
  void require_indices(std::span<const std::int64_t> indices) const;
  // The pose a row asks for: what is missing stays, quaternions are normalised.
  Pose requested_pose(std::size_t drone, std::size_t row, std::span<const float> position,
                      std::span<const float> quat_wxyz) const;

  BatchConfig config;
  Worlds worlds;
  std::vector<const World*> world_pointers;
  std::vector<const collision::Obstacles*> obstacles;  // of each world
  DroneModel drone_model;
  collision::Hull hull;
  std::size_t rays = 0;
  std::size_t observation_size = 0;
  std::size_t image_size = 0;  // of the observation
  State state;
  std::optional<sensors::Lidar> lidar;
  std::optional<task::Navigation> navigation;
  std::vector<sensors::Camera> cameras;
  std::optional<render::Renderer> renderer;     // where there are cameras
  std::vector<render::RenderRequest> requests;  // being rendered
  std::vector<Role> role;                       // (N,)
  std::vector<float> actions;                   // (N, action size) of this step
  std::array<Outputs, 2> slots;
  std::size_t current = 0;  // the slot of the last step or reset
  Schedule schedule;
  Workers workers;
  std::vector<std::unique_ptr<Scratch>> scratches;  // of each of their threads
  std::optional<std::uint64_t> known_hash;
  long owner;  // the process that made this batch
};

Batch::Impl::Impl(BatchConfig config_in, Worlds worlds_in, DroneModel drone_in, std::span<const std::int32_t> world_index)
    : config(validated(std::move(config_in))),
      worlds(validated(std::move(worlds_in))),
      drone_model(std::move(drone_in)),
      hull(drone_model),
      schedule(static_cast<std::size_t>(config.num_drones), worlds.size(), static_cast<std::size_t>(config.block_size)),
      workers(config.num_threads > 0 ? config.num_threads : physical_cores()),
      owner(process_id()) {
  const auto n = static_cast<std::size_t>(config.num_drones);
  for (int i = 0; i < workers.num_threads(); ++i) {
    scratches.push_back(std::make_unique<Scratch>(static_cast<std::size_t>(config.block_size)));
  }
  for (const auto& world : worlds) {
    world_pointers.push_back(world.get());
    // Built here, not by whichever thread first needs them in the middle of a step.
    obstacles.push_back(&compiled(*world).obstacles());
  }
  require_world_index(world_index, n);
  if (config.has_lidar) {
    lidar.emplace(config.lidar, config.num_drones);
    rays = lidar->rays_per_drone();
  }
  for_each_array(state, rays, [n](auto& array, std::size_t columns) { array.resize(n * columns); });
  std::fill(state.active.begin(), state.active.end(), std::uint8_t{1});
  std::fill(state.lidar_ranges.begin(), state.lidar_ranges.end(), kInfinity);
  std::iota(state.seed.begin(), state.seed.end(), std::uint64_t{0});
  for (std::size_t i = 0; i < n; ++i) {
    state.world_index[i] = world_index.empty() ? static_cast<std::int32_t>(i % worlds.size()) : world_index[i];
    const World& world = *worlds[static_cast<std::size_t>(state.world_index[i])];
    set_pose_of(state, i, {world.markers().start.value_or((world.bounds().min + world.bounds().max) / 2), Quat::Identity()});
    clear_contact(i);
  }
  state.sensed_position = state.position;
  state.sensed_quat_wxyz = state.quat_wxyz;
  if (config.task == TaskKind::navigation) {
    navigation.emplace(config.navigation, world_pointers, drone_model, n);
    observation_size = navigation->observation_size(rays);
    if (config.navigation.observation == ObservationKind::pixels) {
      image_size =
          3 * static_cast<std::size_t>(config.cameras[0].width_px) * static_cast<std::size_t>(config.cameras[0].height_px);
    }
    actions.resize(n * navigation->action_size());
    for (Outputs& slot : slots) {
      for_each_output(observation_size, image_size,
                      [&](auto member, std::size_t columns) { (slot.*member).resize(n * columns); });
    }
  }
  schedule.rebuild(state);
  role.resize(n, Role::rests);
  add_cameras();
}

void Batch::Impl::add_cameras() {
  for (const CameraConfig& camera : config.cameras) {
    if (camera.outputs.instance) {
      for (const auto& world : worlds) require_instances(*world);
    }
    try {
      cameras.emplace_back(camera, size());
    } catch (const std::bad_alloc&) {
      refuse("num_drones x camera pixels", "frames that fit in memory",
             std::to_string(size()) + " of " + std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px) +
                 " pixels");
    }
  }
  if (cameras.empty()) return;
  for (const World* const world : world_pointers) compiled(*world).shading();  // as above: built here
  requests.reserve(size() * cameras.size());
  if (config.camera_backend == CameraBackend::automatic) add_typical_requests();
  renderer.emplace(config.camera_backend, requests, workers);
}

// Of drones spread over the batch as it is scheduled, world by world.
void Batch::Impl::add_typical_requests() {
  std::vector<std::uint32_t> drones;
  for (std::size_t block = 0; block < schedule.num_blocks(); ++block) {
    const auto its = schedule.drones(block);
    drones.insert(drones.end(), its.begin(), its.end());
  }
  for (sensors::Camera& camera : cameras) {
    const auto pixels = static_cast<std::size_t>(camera.config().width_px) * static_cast<std::size_t>(camera.config().height_px);
    const std::size_t count = std::min({drones.size(), kTypicalRequests, std::max<std::size_t>(kTypicalPixels / pixels, 1)});
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t drone = drones[i * drones.size() / count];
      requests.push_back(camera.take(drone, world_of(drone), 0, state));
      camera.mark_stale(drone);
    }
  }
}

// ---------------------------------------------------------------------------------------------------------------- one step

void Batch::Impl::step() {
  current = 1 - current;
  run_blocks([this](std::span<const std::uint32_t> drones, Scratch& scratch) {
    fly(drones, scratch);
    if (!cameras.empty()) return;  // frames are taken of all drones at once
    sense(with_role(drones, {Role::flies, Role::begins}, scratch), scratch);
    evaluate(drones, scratch);
    sense(with_role(drones, {Role::ended}, scratch), scratch);
    observe(with_role(drones, {Role::ended}, scratch), scratch);
  });
  if (!cameras.empty()) {
    sense_all({Role::flies, Role::landed, Role::begins});
    run_blocks([this](std::span<const std::uint32_t> drones, Scratch& scratch) { evaluate(drones, scratch); });
    sense_all({Role::ended});
    run_blocks([this](std::span<const std::uint32_t> drones, Scratch& scratch) {
      observe(with_role(drones, {Role::ended}, scratch), scratch);
    });
  }
  reschedule_if_moved();
}

// Takes the actions; a drone whose episode has ended does not fly: it begins the next one or holds still.
void Batch::Impl::fly(std::span<const std::uint32_t> drones, Scratch& scratch) {
  for (const std::uint32_t drone : drones) role[drone] = wait_or_fly(drone, scratch);
  for (int flown = 1;; ++flown) {
    for (const std::uint32_t drone : with_role(drones, {Role::flies}, scratch)) {
      sweep_to(drone, navigation->target(pose_of(state, drone), actions.data() + drone * navigation->action_size()));
    }
    if (flown == config.navigation.frame_skip) return;  // the last one is sensed with what begins, and by the cameras too
    sense(with_role(drones, {Role::flies}, scratch), scratch);
    for (const std::uint32_t drone : with_role(drones, {Role::flies}, scratch)) {
      observe_ranges(drone);
      reward(drone, flown == 1);
      if (navigation->state().done[drone]) role[drone] = Role::landed;
    }
  }
}

// All sensors but the cameras.
void Batch::Impl::sense(std::span<const std::uint32_t> drones, Scratch& scratch) {
  if (drones.empty()) return;
  if (lidar) lidar->scan(drones, world_pointers, state, scratch.tracer);
  sensors::sense_pose(drones, config.pose_sensor, state);
  for (const std::uint32_t drone : drones) ++state.scans[drone];
}

// Observations, rewards and ends of what was flown and sensed; the last observation of an episode is kept, and the next begins.
void Batch::Impl::evaluate(std::span<const std::uint32_t> drones, Scratch& scratch) {
  for (const std::uint32_t drone : with_role(drones, {Role::flies, Role::begins}, scratch)) observe_ranges(drone);
  for (const std::uint32_t drone : with_role(drones, {Role::flies}, scratch)) {
    reward(drone, config.navigation.frame_skip == 1);
  }
  for (const std::uint32_t drone : with_role(drones, {Role::flies, Role::landed, Role::begins}, scratch)) {
    observe_head(drone, scratch);
  }
  for (const std::uint32_t drone : with_role(drones, {Role::flies, Role::landed}, scratch)) {
    if (!navigation->state().done[drone]) continue;
    keep_final(drone);
    if (config.autoreset_mode != AutoresetMode::same_step) continue;
    begin_next_episode(drone, scratch);
    role[drone] = Role::ended;
  }
}

void Batch::Impl::observe(std::span<const std::uint32_t> drones, Scratch& scratch) {
  for (const std::uint32_t drone : drones) observe_ranges(drone);
  for (const std::uint32_t drone : drones) observe_head(drone, scratch);
}

Batch::Impl::Role Batch::Impl::wait_or_fly(std::uint32_t drone, Scratch& scratch) {
  if (!navigation->state().done[drone]) return Role::flies;
  if (config.autoreset_mode == AutoresetMode::next_step) {
    begin_next_episode(drone, scratch);
    clear_outputs(out(), drone);
    return Role::begins;
  }
  // disabled: everything as the last step left it, but the reward
  for_each_output(observation_size, image_size, [&](auto member, std::size_t columns) {
    const auto row = static_cast<std::ptrdiff_t>(drone * columns);
    std::copy_n((last().*member).begin() + row, columns, (out().*member).begin() + row);
  });
  out().reward[drone] = 0.0F;
  std::fill_n(out().reward_terms.begin() + static_cast<std::ptrdiff_t>(drone) * kNumRewardTerms, kNumRewardTerms, 0.0F);
  return Role::rests;
}

void Batch::Impl::observe_ranges(std::uint32_t drone) {
  navigation->observe_ranges(drone, ranges_of(drone), lidar->max_range()[drone],
                             out().observation.data() + drone * observation_size);
}

void Batch::Impl::reward(std::uint32_t drone, bool first) {
  navigation->evaluate(drone, actions.data() + drone * navigation->action_size(), rays, state, first, out());
}

// What is observed beside the ranges.
void Batch::Impl::observe_head(std::uint32_t drone, Scratch& scratch) {
  float* const head = out().observation.data() + drone * observation_size;
  if (config.navigation.observation == ObservationKind::goal) {
    navigation->observe_goal(drone, state, head);
    return;
  }
  const CameraConfig& camera = config.cameras[0];
  const auto size = 3 * static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px);
  const std::span image = std::span(cameras[0].images().rgb).subspan(drone * size, size);
  if (config.navigation.observation == ObservationKind::blob) {
    navigation->observe_blob(task::find_green(image, camera.width_px, camera.height_px, camera.layout, scratch.green), head);
  } else {
    // A copy: the camera's own image is written again in the next step, when this one may still be in use.
    std::copy(image.begin(), image.end(), out().image.begin() + static_cast<std::ptrdiff_t>(drone * size));
  }
}

void Batch::Impl::keep_final(std::uint32_t drone) {
  const auto row = static_cast<std::ptrdiff_t>(drone * observation_size);
  std::copy_n(out().observation.begin() + row, observation_size, out().final_observation.begin() + row);
  const auto image = static_cast<std::ptrdiff_t>(drone * image_size);
  std::copy_n(out().image.begin() + image, image_size, out().final_image.begin() + image);
}

// Those of the drones that have one of the roles; holds until the next call with this scratch.
std::span<const std::uint32_t> Batch::Impl::with_role(std::span<const std::uint32_t> drones, std::initializer_list<Role> roles,
                                                      Scratch& scratch) const {
  scratch.drones.clear();
  for (const std::uint32_t drone : drones) {
    if (std::find(roles.begin(), roles.end(), role[drone]) != roles.end()) scratch.drones.push_back(drone);
  }
  return scratch.drones;
}

// All sensors, of every drone that has one of the roles. Cameras that render on a thread of their own do so meanwhile.
void Batch::Impl::sense_all(std::initializer_list<Role> roles) {
  start_frames(roles);
  run_blocks([&](std::span<const std::uint32_t> drones, Scratch& scratch) {
    with_role(drones, roles, scratch);
    std::erase_if(scratch.drones, [this](std::uint32_t drone) { return role[drone] == Role::landed; });  // sensed when it did
    sense(scratch.drones, scratch);
  });
  finish_requests();
}

void Batch::Impl::start_frames(std::initializer_list<Role> roles) {
  requests.clear();
  for (sensors::Camera& camera : cameras) {
    for (std::size_t block = 0; block < schedule.num_blocks(); ++block) {
      for (const std::uint32_t drone : schedule.drones(block)) {
        if (std::find(roles.begin(), roles.end(), role[drone]) == roles.end() || !camera.is_due(drone, state)) continue;
        const std::int64_t step = state.scans[drone] - (role[drone] == Role::landed ? 1 : 0);
        requests.push_back(camera.take(drone, world_of(drone), step, state));
      }
    }
  }
  start_requests();
}

void Batch::Impl::start_requests() {
  if (!requests.empty()) renderer->start(requests);
}

void Batch::Impl::finish_requests() {
  if (!requests.empty()) renderer->finish(requests, workers);
}

// After a restore: all frames but stale ones, as they were.
void Batch::Impl::retake_frames() {
  requests.clear();
  for (sensors::Camera& camera : cameras) {
    for (std::uint32_t drone = 0; drone < size(); ++drone) {
      if (!state.active[drone] || camera.images().frame_step[drone] < 0) continue;
      requests.push_back(camera.retake(drone, *worlds[static_cast<std::size_t>(camera.taken().world[drone])]));
    }
  }
  start_requests();
  finish_requests();
}

// ---------------------------------------------------------------------------------------------------------- shared pieces

void Batch::Impl::sweep_to(std::size_t drone, const Pose& target) {
  const Pose from = pose_of(state, drone);
  const collision::Obstacles& its_obstacles = *obstacles[static_cast<std::size_t>(state.world_index[drone])];
  const collision::Contact contact = collision::sweep(its_obstacles, hull, from, target);
  set_pose_of(state, drone, contact.hit ? collision::interpolate(from, target, contact.fraction) : target);
  state.contact.hit[drone] = contact.hit;
  state.contact.inside[drone] = contact.inside;
  state.contact.fraction[drone] = contact.fraction;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    state.contact.point[3 * drone + axis] = contact.point[static_cast<Eigen::Index>(axis)];
    state.contact.normal[3 * drone + axis] = contact.normal[static_cast<Eigen::Index>(axis)];
  }
}

void Batch::Impl::clear_contact(std::size_t drone) {
  state.contact.hit[drone] = state.contact.inside[drone] = 0;
  state.contact.fraction[drone] = 1.0F;
  std::fill_n(state.contact.point.begin() + static_cast<std::ptrdiff_t>(3 * drone), 3, 0.0F);
  std::fill_n(state.contact.normal.begin() + static_cast<std::ptrdiff_t>(3 * drone), 3, 0.0F);
}

// Nothing has been sensed of the drone's episode yet.
void Batch::Impl::begin_scans(std::size_t drone) {
  state.scans[drone] = 0;
  for (sensors::Camera& camera : cameras) camera.mark_stale(drone);
}

void Batch::Impl::begin_next_episode(std::uint32_t drone, Scratch& scratch) {
  ++state.episode[drone];
  begin_scans(drone);
  const std::int32_t world = state.world_index[drone];
  navigation->place(drone, state);
  navigation->begin(drone, state);
  clear_contact(drone);
  scratch.changed_world |= world != state.world_index[drone];
}

// Of all that a snapshot must have in common with the batch that restores it. Worlds can be large: it is made when first needed.
std::uint64_t Batch::Impl::hash() {
  if (!known_hash) known_hash = config_hash(config, worlds, drone_model);
  return *known_hash;
}

void Batch::Impl::clear_outputs(Outputs& outputs, std::size_t drone) {
  outputs.reward[drone] = 0.0F;
  std::fill_n(outputs.reward_terms.begin() + static_cast<std::ptrdiff_t>(drone) * kNumRewardTerms, kNumRewardTerms, 0.0F);
  outputs.terminated[drone] = outputs.truncated[drone] = outputs.success[drone] = outputs.crashed[drone] = 0;
  outputs.episode_return[drone] = 0.0;
  outputs.episode_length[drone] = 0;
}

// A removed slot reads as absent from now on, in both output slots: no step touches it.
void Batch::Impl::mark_absent(std::size_t drone) {
  state.active[drone] = 0;
  std::fill_n(state.lidar_ranges.begin() + static_cast<std::ptrdiff_t>(drone * rays), rays, kInfinity);
  clear_contact(drone);
  for (sensors::Camera& camera : cameras) camera.clear(drone);
  if (!navigation) return;
  for (Outputs& slot : slots) {
    clear_outputs(slot, drone);
    float* const observation = slot.observation.data() + drone * observation_size;
    std::fill_n(observation, navigation->head_size(), 0.0F);
    std::fill_n(observation + navigation->head_size(), rays, 1.0F);
    std::fill_n(slot.image.begin() + static_cast<std::ptrdiff_t>(drone * image_size), image_size, std::uint8_t{0});
  }
}

void Batch::Impl::reschedule_if_moved() {
  bool moved = false;
  for (const auto& scratch : scratches) moved |= std::exchange(scratch->changed_world, false);
  if (moved) schedule.rebuild(state);
}

void Batch::Impl::choose(Mask mask) {
  for (std::size_t drone = 0; drone < size(); ++drone) role[drone] = chosen(mask, drone) ? Role::begins : Role::rests;
}

template <class F>
void Batch::Impl::for_each_chosen(Mask mask, const F& f) {
  for (std::size_t drone = 0; drone < size(); ++drone) {
    if (chosen(mask, drone)) f(static_cast<std::uint32_t>(drone));
  }
}

template <class F>
void Batch::Impl::run_blocks(const F& f) {
  workers.run(schedule.num_blocks(),
              [&](std::size_t block, std::size_t thread) { f(schedule.drones(block), *scratches[thread]); });
}

// ------------------------------------------------------------------------------------------------------ refusing bad input

void Batch::Impl::require_own_process() const {
  if (process_id() != owner) {
    throw std::runtime_error("this Batch was made in process " + std::to_string(owner) + " and used in its child " +
                             std::to_string(process_id()) + ": a batch does not survive fork(), make one in the child");
  }
}

void Batch::Impl::require_lidar() const {
  if (!lidar) throw std::logic_error("this Batch has no LiDAR: give it one (lidar=...) to change it or read its range");
}

void Batch::Impl::require_camera(std::size_t camera) const {
  if (camera >= cameras.size()) refuse("camera", "an index below " + std::to_string(cameras.size()), camera);
}

void Batch::Impl::require_mode(std::size_t camera, CaptureMode mode) const {
  const bool observed = camera == 0 && navigation && config.navigation.observation != ObservationKind::goal;
  require(!observed || mode != CaptureMode::on_demand, "capture_mode",
          "every_step or on_movement (the task observes this camera)", "on_demand");
}

void Batch::Impl::require_index(std::int64_t index) const {
  if (index < 0 || static_cast<std::size_t>(index) >= size()) {
    refuse("index", "an integer in [0, " + std::to_string(size()) + ")", index);
  }
}

void Batch::Impl::require_task() const {
  if (!navigation) throw std::logic_error("this Batch has no built-in task: give it one (task=...) to reset and step it");
}

void Batch::Impl::require_begun() const {
  const task::NavigationState& task = navigation->state();
  for (std::size_t drone = 0; drone < size(); ++drone) {
    if (state.active[drone] && !task.begun[drone]) throw std::logic_error("reset() must come before the first step()");
  }
}

void Batch::Impl::require_mask(Mask mask) const {
  if (!mask.empty()) require(mask.size() == size(), "mask", std::to_string(size()) + " flags", mask.size());
}

void Batch::Impl::require_poses(std::span<const float> position, std::span<const float> quat_wxyz, std::size_t rows) const {
  if (!position.empty()) require_size(position.size(), 3 * rows, "position");
  if (!quat_wxyz.empty()) require_size(quat_wxyz.size(), 4 * rows, "quat_wxyz");
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (!std::isfinite(position[i])) refuse(row_of("position", i / 3), "finite numbers in float32's range", position[i]);
  }
  for (std::size_t row = 0; row < quat_wxyz.size() / 4; ++row) {
    const float* const q = quat_wxyz.data() + 4 * row;
    const double norm = std::hypot(std::hypot(static_cast<double>(q[0]), q[1]), std::hypot(static_cast<double>(q[2]), q[3]));
    if (!(std::abs(norm - 1.0) < 1e-2)) {
      refuse(row_of("quat_wxyz", row), "a unit quaternion (w, x, y, z)", "one of norm " + std::to_string(norm));
    }
  }
}

void Batch::Impl::require_world_index(std::span<const std::int32_t> world_index, std::size_t rows) const {
  if (world_index.empty()) return;
  require_size(world_index.size(), rows, "world_index");
  for (std::size_t row = 0; row < rows; ++row) {
    if (world_index[row] < 0 || static_cast<std::size_t>(world_index[row]) >= worlds.size()) {
      refuse(row_of("world_index", row), "an integer in [0, " + std::to_string(worlds.size()) + ")", world_index[row]);
    }
  }
}

void Batch::Impl::require_indices(std::span<const std::int64_t> indices) const {
  for (std::size_t row = 0; row < indices.size(); ++row) {
    if (indices[row] < 0 || static_cast<std::size_t>(indices[row]) >= size()) {
      refuse(row_of("indices", row), "an integer in [0, " + std::to_string(size()) + ")", indices[row]);
    }
  }
}

Pose Batch::Impl::requested_pose(std::size_t drone, std::size_t row, std::span<const float> position,
                                 std::span<const float> quat_wxyz) const {
  Pose pose = pose_of(state, drone);
  if (!position.empty()) pose.position = Vec3(position[3 * row], position[3 * row + 1], position[3 * row + 2]);
  if (!quat_wxyz.empty()) {
    const float* const q = quat_wxyz.data() + 4 * row;
    pose.rotation = Quat(q[0], q[1], q[2], q[3]).normalized();
  }
  return pose;
}

// ------------------------------------------------------------------------------------------------------------- public face

Batch::Batch(BatchConfig config, Worlds worlds, DroneModel drone, std::span<const std::int32_t> world_index)
    : impl_(std::make_unique<Impl>(std::move(config), std::move(worlds), std::move(drone), world_index)) {}

Batch::~Batch() = default;

const BatchConfig& Batch::config() const { return impl_->config; }
const Batch::Worlds& Batch::worlds() const { return impl_->worlds; }
const DroneModel& Batch::drone() const { return impl_->drone_model; }
int Batch::num_threads() const { return impl_->workers.num_threads(); }
const State& Batch::state() const { return impl_->state; }

void Batch::set_pose(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  impl_->require_poses(position, quat_wxyz, impl_->size());
  impl_->for_each_chosen(mask, [&](std::uint32_t drone) {
    set_pose_of(impl_->state, drone, impl_->requested_pose(drone, drone, position, quat_wxyz));
    impl_->clear_contact(drone);
  });
}

void Batch::move(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  impl_->require_poses(position, quat_wxyz, impl_->size());
  impl_->run_blocks([&](std::span<const std::uint32_t> drones, Scratch&) {
    for (const std::uint32_t drone : drones) {
      if (impl_->chosen(mask, drone)) impl_->sweep_to(drone, impl_->requested_pose(drone, drone, position, quat_wxyz));
    }
  });
}

void Batch::sense(Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  impl_->choose(mask);
  impl_->sense_all({Impl::Role::begins});
}

void Batch::spawn(std::span<const std::int64_t> indices, std::span<const float> position, std::span<const float> quat_wxyz,
                  std::span<const std::int32_t> world_index) {
  impl_->require_own_process();
  impl_->require_indices(indices);
  impl_->require_poses(position, quat_wxyz, indices.size());
  impl_->require_world_index(world_index, indices.size());
  State& state = impl_->state;
  std::fill(impl_->role.begin(), impl_->role.end(), Impl::Role::rests);
  for (std::size_t row = 0; row < indices.size(); ++row) {
    const auto drone = static_cast<std::uint32_t>(indices[row]);
    if (!world_index.empty()) state.world_index[drone] = world_index[row];
    state.active[drone] = 1;
    impl_->begin_scans(drone);
    set_pose_of(state, drone, impl_->requested_pose(drone, row, position, quat_wxyz));
    impl_->clear_contact(drone);
    impl_->role[drone] = Impl::Role::begins;
  }
  impl_->schedule.rebuild(state);
  impl_->sense_all({Impl::Role::begins});
  if (!impl_->navigation) return;
  for (const std::int64_t index : indices) {
    const auto drone = static_cast<std::uint32_t>(index);
    impl_->navigation->begin(drone, state);
    impl_->clear_outputs(impl_->out(), drone);
    impl_->observe({&drone, 1}, *impl_->scratches[0]);
  }
}

void Batch::remove(std::span<const std::int64_t> indices) {
  impl_->require_own_process();
  impl_->require_indices(indices);
  for (const std::int64_t index : indices) impl_->mark_absent(static_cast<std::size_t>(index));
  impl_->schedule.rebuild(impl_->state);
}

void Batch::set_world(std::span<const std::int32_t> world_index, Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  require_size(world_index.size(), impl_->size(), "world_index");
  impl_->require_world_index(world_index, impl_->size());
  for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
    if (mask.empty() || mask[drone]) impl_->state.world_index[drone] = world_index[drone];
  }
  impl_->schedule.rebuild(impl_->state);
}

void Batch::set_lidar(const LidarChange& change, Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  impl_->require_lidar();
  const bool beams_move = change.hfov_deg || change.vfov_deg;
  require(!(beams_move && impl_->config.lidar.has_pattern()), "hfov_deg", "no field of view for a LiDAR made from a beam pattern",
          change.hfov_deg.value_or(change.vfov_deg.value_or(0.0F)));
  const auto changed = [&](LidarConfig config) {
    config.max_range_m = change.max_range_m.value_or(config.max_range_m);
    config.hfov_deg = change.hfov_deg.value_or(config.hfov_deg);
    config.vfov_deg = change.vfov_deg.value_or(config.vfov_deg);
    config.offset_m = change.offset_m.value_or(config.offset_m);
    config.quat_wxyz = change.quat_wxyz.value_or(config.quat_wxyz);
    return config;
  };
  // Each field is valid or not by itself, whatever a drone's others are; so this refuses even where no drone is chosen.
  changed(impl_->config.lidar).validate();
  impl_->for_each_chosen(mask,
                         [&](std::uint32_t drone) { impl_->lidar->set_config(drone, changed(impl_->lidar->config_of(drone))); });
}

std::span<const float> Batch::lidar_max_range_m() const {
  impl_->require_lidar();
  return impl_->lidar->max_range();
}

LidarConfig Batch::lidar_config(std::int64_t index) const {
  impl_->require_lidar();
  impl_->require_index(index);
  return impl_->lidar->config_of(static_cast<std::size_t>(index));
}

void Batch::lidar_directions(std::span<float> out) const {
  require_size(out.size(), 3 * impl_->size() * impl_->rays, "out");
  if (!impl_->lidar) return;
  for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
    sensors::write_directions(impl_->lidar->pattern_of(drone), out.data() + 3 * drone * impl_->rays);
  }
}

void Batch::lidar_points(std::span<float> out) const {
  lidar_directions(out);
  for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
    const Pose pose = pose_of(impl_->state, drone);
    const auto& offset = impl_->lidar ? impl_->lidar->config_of(drone).offset_m : std::array<float, 3>{};
    const Vec3 origin = pose.position + pose.rotation * Vec3(offset[0], offset[1], offset[2]);
    for (std::size_t ray = 0; ray < impl_->rays; ++ray) {
      float* const row = out.data() + 3 * (drone * impl_->rays + ray);
      const float range = impl_->ranges_of(drone)[ray];
      const Vec3 point = std::isfinite(range) ? Vec3(origin + range * (pose.rotation * Vec3(row[0], row[1], row[2])))
                                              : Vec3::Constant(kInfinity);
      for (int axis = 0; axis < 3; ++axis) row[axis] = point[axis];
    }
  }
}

std::size_t Batch::camera_index(std::string_view name) const {
  const auto& cameras = impl_->config.cameras;
  const auto found =
      std::find_if(cameras.begin(), cameras.end(), [&](const CameraConfig& camera) { return camera.name == name; });
  if (found == cameras.end()) {
    std::string names;
    for (const CameraConfig& camera : cameras) names += (names.empty() ? "\"" : ", \"") + camera.name + '"';
    refuse("camera", cameras.empty() ? "a Batch with cameras (cameras=[...])" : "one of " + names, '"' + std::string(name) + '"');
  }
  return static_cast<std::size_t>(found - cameras.begin());
}

const CameraImages& Batch::images(std::size_t camera) const {
  impl_->require_camera(camera);
  return impl_->cameras[camera].images();
}

CameraConfig Batch::camera_config(std::size_t camera, std::int64_t index) const {
  impl_->require_camera(camera);
  impl_->require_index(index);
  return impl_->cameras[camera].config_of(static_cast<std::size_t>(index));
}

void Batch::capture(std::size_t camera, Mask mask) {
  impl_->require_own_process();
  impl_->require_camera(camera);
  impl_->require_mask(mask);
  impl_->requests.clear();
  for (std::size_t block = 0; block < impl_->schedule.num_blocks(); ++block) {
    for (const std::uint32_t drone : impl_->schedule.drones(block)) {
      if (!impl_->chosen(mask, drone)) continue;
      const std::int64_t step = std::max<std::int64_t>(impl_->state.scans[drone] - 1, 0);
      impl_->requests.push_back(impl_->cameras[camera].take(drone, impl_->world_of(drone), step, impl_->state));
    }
  }
  impl_->start_requests();
  impl_->finish_requests();
}

void Batch::set_capture_mode(std::size_t camera, CaptureMode mode) {
  impl_->require_own_process();
  impl_->require_camera(camera);
  impl_->require_mode(camera, mode);
  impl_->config.cameras[camera].capture_mode = mode;
}

void Batch::set_camera(std::size_t camera, const CameraChange& change, Mask mask) {
  impl_->require_own_process();
  impl_->require_camera(camera);
  impl_->require_mask(mask);
  sensors::Camera& its = impl_->cameras[camera];
  const auto changed = [&](CameraConfig config) {
    if (change.hfov_deg || change.vfov_deg) {
      config.hfov_deg = change.hfov_deg;
      config.vfov_deg = change.vfov_deg;
    }
    config.offset_m = change.offset_m.value_or(config.offset_m);
    config.quat_wxyz = change.quat_wxyz.value_or(config.quat_wxyz);
    return config;
  };
  changed(its.config()).validate();  // as with LiDARs: also where no drone is chosen
  if (!change.any()) return;
  impl_->for_each_chosen(mask, [&](std::uint32_t drone) { its.set_config(drone, changed(its.config_of(drone))); });
}

const std::string& Batch::camera_backend_report() const {
  static const std::string none = "this Batch has no cameras";
  return impl_->renderer ? impl_->renderer->report() : none;
}

std::string Batch::take_warning() { return impl_->renderer ? impl_->renderer->take_warning() : std::string(); }

std::string Batch::jpeg(std::size_t camera, std::int64_t index, int quality) const {
  impl_->require_camera(camera);
  impl_->require_index(index);
  require(quality >= 1 && quality <= 100, "quality", "an integer in [1, 100]", quality);
  const CameraConfig& config = impl_->config.cameras[camera];
  require(config.outputs.any_color(), "camera", "one that writes rgb or grey", '"' + config.name + '"');
  const CameraImages& images = impl_->cameras[camera].images();
  const std::size_t pixels = static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px);
  const auto row = static_cast<std::size_t>(index);
  require(images.frame_step[row] >= 0, "index", "a drone whose frame is not stale (call sense or capture first)", index);
  return config.outputs.rgb ? render::compress_rgb(images.rgb.data() + 3 * row * pixels, config, quality)
                            : render::compress_grey(images.grey.data() + row * pixels, config, quality);
}

void Batch::seed(std::span<const std::uint64_t> seeds, Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  require_size(seeds.size(), impl_->size(), "seeds");
  impl_->for_each_chosen(mask, [&](std::uint32_t drone) {
    impl_->state.seed[drone] = seeds[drone];
    impl_->state.episode[drone] = 0;
    impl_->begin_scans(drone);
  });
}

void Batch::begin_episode(Mask mask) {
  impl_->require_own_process();
  impl_->require_mask(mask);
  impl_->for_each_chosen(mask, [&](std::uint32_t drone) {
    ++impl_->state.episode[drone];
    impl_->begin_scans(drone);
  });
}

void Batch::random(std::uint32_t stream, int count, std::span<float> out) const {
  require(stream < 0x80000000U, "stream", "an integer in [0, 2147483648)", stream);
  require(count >= 0, "count", "an integer >= 0", count);
  const auto columns = static_cast<std::size_t>(count);
  require_size(out.size(), impl_->size() * columns, "out");
  for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
    for (std::size_t k = 0; k < columns; ++k) {
      const auto bits = draw(impl_->state.seed[drone], impl_->state.episode[drone], stream, static_cast<std::uint32_t>(k / 4));
      out[drone * columns + k] = uniform01(bits[k % 4]);
    }
  }
}

int Batch::observation_size() const { return static_cast<int>(impl_->observation_size); }
int Batch::image_size() const { return static_cast<int>(impl_->image_size); }

void Batch::reset(std::span<const std::uint64_t> seeds, Mask mask) {
  impl_->require_own_process();
  impl_->require_task();
  impl_->require_mask(mask);
  if (!seeds.empty()) require_size(seeds.size(), impl_->size(), "seeds");
  State& state = impl_->state;
  task::NavigationState& navigation = impl_->navigation->state();
  const std::size_t before = impl_->current;
  impl_->current = 1 - before;
  impl_->slots[impl_->current] = impl_->slots[before];  // what is not reset stays as it was
  impl_->for_each_chosen(mask, [&](std::uint32_t drone) {
    if (!seeds.empty()) {
      state.seed[drone] = seeds[drone];
      state.episode[drone] = 0;
    } else if (navigation.begun[drone]) {
      ++state.episode[drone];
    }
    impl_->begin_scans(drone);
    impl_->navigation->place(drone, state);
    impl_->navigation->begin(drone, state);
    impl_->clear_contact(drone);
    impl_->clear_outputs(impl_->out(), drone);
  });
  impl_->schedule.rebuild(state);
  impl_->choose(mask);
  impl_->sense_all({Impl::Role::begins});
  impl_->run_blocks([&](std::span<const std::uint32_t> drones, Scratch& scratch) {
    impl_->observe(impl_->with_role(drones, {Impl::Role::begins}, scratch), scratch);
  });
}

void Batch::step(std::span<const std::int64_t> actions) {
  impl_->require_own_process();
  impl_->require_task();
  require(is_discrete(impl_->config.navigation.action), "actions",
          "floating-point numbers (the task's actions are displacements)", "integers");
  require_size(actions.size(), impl_->size(), "actions");
  const int choices = impl_->config.navigation.action == ActionKind::discrete ? 6 : 3;
  for (std::size_t drone = 0; drone < actions.size(); ++drone) {
    if (actions[drone] < 0 || actions[drone] >= choices) {
      refuse(row_of("actions", drone), "an integer in [0, " + std::to_string(choices) + ")", actions[drone]);
    }
  }
  impl_->require_begun();
  std::transform(actions.begin(), actions.end(), impl_->actions.begin(),
                 [](std::int64_t action) { return static_cast<float>(action); });
  impl_->step();
}

void Batch::step(std::span<const float> actions) {
  impl_->require_own_process();
  impl_->require_task();
  require(!is_discrete(impl_->config.navigation.action), "actions", "integers (the task's actions are discrete)",
          "floating-point numbers");
  require_size(actions.size(), impl_->actions.size(), "actions");
  for (std::size_t i = 0; i < actions.size(); ++i) {
    if (!std::isfinite(actions[i])) refuse(row_of("actions", i / impl_->navigation->action_size()), "finite numbers", actions[i]);
  }
  impl_->require_begun();
  std::copy(actions.begin(), actions.end(), impl_->actions.begin());
  impl_->step();
}

const Outputs& Batch::outputs() const { return impl_->slots[impl_->current]; }
Outputs& Batch::outputs() { return impl_->slots[impl_->current]; }

std::span<const std::int32_t> Batch::goal_index() const {
  impl_->require_task();
  return impl_->navigation->state().goal_index;
}

std::string Batch::snapshot() const {
  impl_->require_own_process();
  SnapshotWriter writer;
  writer.value(kSnapshotMagic);
  writer.value(impl_->hash());
  const auto write = [&](const auto& array, std::size_t) { writer.array(array); };
  for_each_array(impl_->state, impl_->rays, write);
  for (std::size_t drone = 0; impl_->lidar && drone < impl_->size(); ++drone) {
    const LidarConfig config = impl_->lidar->config_of(drone);
    writer.value(LidarSetting{config.hfov_deg, config.vfov_deg, config.max_range_m, config.offset_m, config.quat_wxyz});
  }
  for (const sensors::Camera& camera : impl_->cameras) {
    writer.value(camera.config().capture_mode);
    for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
      const CameraConfig config = camera.config_of(drone);
      writer.value(
          CameraSetting{config.hfov_deg.value_or(0.0F), config.vfov_deg.value_or(0.0F), config.offset_m, config.quat_wxyz});
    }
    // Frames are not kept but taken again.
    writer.array(camera.taken().position);
    writer.array(camera.taken().quat_wxyz);
    writer.array(camera.taken().world);
    writer.array(camera.images().frame_step);
  }
  if (impl_->navigation) {
    for_each_navigation_array(impl_->navigation->state(), write);
    for_each_output(impl_->observation_size, impl_->image_size,
                    [&](auto member, std::size_t) { writer.array(impl_->out().*member); });
  }
  return writer.take();
}

void Batch::restore(const std::string& blob) {
  impl_->require_own_process();
  SnapshotReader reader(blob);
  require(reader.value<std::uint64_t>() == kSnapshotMagic, "snapshot", "the bytes of Batch.snapshot()", "something else");
  require(reader.value<std::uint64_t>() == impl_->hash(), "snapshot", "one of a batch with this configuration and these worlds",
          "one of another");
  // Everything is read before anything changes.
  std::vector<std::function<void()>> changes;
  std::vector<std::int32_t> world_index;  // of drones and of frames
  const auto is_world_index = [this](const std::vector<std::int32_t>& array) {
    const auto shows = [&](const sensors::Camera& camera) { return &array == &camera.taken().world; };
    return &array == &impl_->state.world_index || std::any_of(impl_->cameras.begin(), impl_->cameras.end(), shows);
  };
  const auto read = [&](auto& array, std::size_t) {
    auto values = reader.array(array);
    if constexpr (std::is_same_v<decltype(values), std::vector<std::int32_t>>) {
      if (is_world_index(array)) world_index.insert(world_index.end(), values.begin(), values.end());
    }
    changes.emplace_back([&array, values = std::move(values)] { std::copy(values.begin(), values.end(), array.begin()); });
  };
  for_each_array(impl_->state, impl_->rays, read);
  for (std::size_t drone = 0; impl_->lidar && drone < impl_->size(); ++drone) {
    const auto setting = reader.value<LidarSetting>();
    LidarConfig config = impl_->config.lidar;
    config.hfov_deg = setting.hfov_deg;
    config.vfov_deg = setting.vfov_deg;
    config.max_range_m = setting.max_range_m;
    config.offset_m = setting.offset_m;
    config.quat_wxyz = setting.quat_wxyz;
    config.validate();
    changes.emplace_back([this, drone, config] { impl_->lidar->set_config(drone, config); });
  }
  for (std::size_t index = 0; index < impl_->cameras.size(); ++index) {
    sensors::Camera& camera = impl_->cameras[index];
    const auto mode = reader.value<CaptureMode>();
    require(mode <= CaptureMode::on_demand, "snapshot", "a capture mode below 3", static_cast<int>(mode));
    impl_->require_mode(index, mode);
    changes.emplace_back([this, index, mode] { impl_->config.cameras[index].capture_mode = mode; });
    for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
      const auto setting = reader.value<CameraSetting>();
      CameraConfig config = camera.config();
      config.hfov_deg = setting.hfov_deg > 0.0F ? std::optional(setting.hfov_deg) : std::nullopt;
      config.vfov_deg = setting.vfov_deg > 0.0F ? std::optional(setting.vfov_deg) : std::nullopt;
      config.offset_m = setting.offset_m;
      config.quat_wxyz = setting.quat_wxyz;
      config.validate();
      changes.emplace_back([&camera, drone, config] { camera.set_config(drone, config); });
    }
    read(camera.taken().position, 3U);
    read(camera.taken().quat_wxyz, 4U);
    read(camera.taken().world, 1U);
    read(camera.frame_step(), 1U);
  }
  if (impl_->navigation) {
    for_each_navigation_array(impl_->navigation->state(), read);
    // Into the slot whose turn it is, as by a step: what the last call returned stays whole.
    Outputs& next = impl_->slots[1 - impl_->current];
    for_each_output(impl_->observation_size, impl_->image_size,
                    [&](auto member, std::size_t columns) { read(next.*member, columns); });
    changes.emplace_back([this] { impl_->current = 1 - impl_->current; });
  }
  reader.require_end();
  const auto moved = std::find_if(world_index.begin(), world_index.end(), [this](std::int32_t world) {
    return world < 0 || static_cast<std::size_t>(world) >= impl_->worlds.size();
  });
  if (moved != world_index.end()) refuse("snapshot", "world indices below " + std::to_string(impl_->worlds.size()), *moved);
  for (const auto& change : changes) change();
  for (std::size_t drone = 0; drone < impl_->size(); ++drone) {
    if (!impl_->state.active[drone]) impl_->mark_absent(drone);  // in the other slot too, where it may have been alive
  }
  impl_->schedule.rebuild(impl_->state);
  impl_->retake_frames();
}

}  // namespace flockstep
