// Batch: E envs over W worlds, stepped together.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/task.hpp"
#include "flockstep/world.hpp"
#include "flockstep/world_pool.hpp"

namespace flockstep {

// What a step or reset returns, each array aligned to a cache line. R rows are N or E, as TaskSpec::row says. Two of these
// rotate, so that what one returned stays intact during the next.
struct Outputs {
  std::vector<Buffer> observation;        // (R, ...) one for each field of TaskSpec::observation
  std::vector<Buffer> final_observation;  // (R, ...) same fields; valid where terminated or truncated
  AlignedVector<float> reward;
  AlignedVector<float> reward_terms;
  FlagArray terminated;
  FlagArray truncated;
  FlagArray success;
  FlagArray crashed;
  // The episode ended because a setpoint, a pose, a reward or an observation was not finite, or a pose was beyond the world. The
  // drone stayed where it was, the reward and the observation read 0 there. An infinity that the bounds of the observation's
  // field contain counts as finite.
  FlagArray bad_state;
  AlignedVector<std::uint8_t> episode_end;  // EpisodeEnd
  AlignedVector<double> episode_return;
  AlignedVector<double> episode_terms;
  AlignedVector<std::int64_t> episode_length;

  static constexpr auto fields() {
    using C = Outputs;
    constexpr auto flag = [](const char* about) {
      return ArrayInfo{.rows = Rows::task, .values = Values::flag, .writer = "the step", .about = about};
    };
    constexpr auto number = [](const char* about, Per per = Per::row, Access access = Access::read) {
      return ArrayInfo{
          .rows = Rows::task, .per = per, .values = Values::any, .access = access, .writer = "the step", .about = about};
    };
    return field_list(
        field("observation", &C::observation), field("final_observation", &C::final_observation),
        array("reward", &C::reward, number("reward of the last step", Per::row, Access::write)),
        array("reward_terms", &C::reward_terms,
              number("terms of the reward, in the order of the spec; their sum is it", Per::term)),
        array("terminated", &C::terminated, flag("the episode ended here, in a state that ends episodes")),
        array("truncated", &C::truncated, flag("the episode ended here, for another reason")),
        array("success", &C::success, flag("the episode ended here, and the task calls it a success")),
        array("crashed", &C::crashed, flag("the episode ended here, in contact with something")),
        array("bad_state", &C::bad_state,
              flag("the episode ended here, because a number was not finite or a pose beyond the world")),
        array("episode_end", &C::episode_end, number("why the episode ended here, an `EpisodeEnd`; 0 if it goes on")),
        array("episode_return", &C::episode_return,
              number("sum of the rewards of the episode that ended here, else of the current one")),
        array("episode_terms", &C::episode_terms, number("the same sum for each term of the reward", Per::term)),
        array("episode_length", &C::episode_length,
              {.rows = Rows::task,
               .unit = "steps",
               .values = Values::count,
               .writer = "the step",
               .about = "steps flown in the same episode"}));
  }
};

struct Simulation;

// All methods check their input before they change anything and throw std::invalid_argument naming the field, what was expected
// and what came. An empty mask selects every active drone or env; an env is active if one of its drones is. Not thread-safe: one
// caller at a time.
// A batch does not survive fork(): using a parent's batch in the child throws std::runtime_error. So does a call while another
// thread is in one.
class FLOCKSTEP_API Batch {
 public:
  using Worlds = std::vector<std::shared_ptr<const World>>;

  // world_index: (E,), or empty for env i in world i mod W. Drones start at their world's start marker, else at the centre of
  // its bounds. Without a task there is nothing to reset() and step(), and all else works.
  Batch(BatchConfig config, Worlds worlds, std::unique_ptr<Task> task = nullptr, DroneModel drone = DroneModel::quadrotor650(),
        std::span<const std::int32_t> world_index = {});
  // The worlds are those of a pool, which resets draw from: it takes a task. state().world_index has their numbers; until their
  // first reset all drones are in world 0. Cameras are rendered by raycast.
  Batch(BatchConfig config, WorldPool pool, std::unique_ptr<Task> task, DroneModel drone = DroneModel::quadrotor650());
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  const BatchConfig& config() const;
  const Worlds& worlds() const;  // by state().world_index; empty with a pool
  const std::shared_ptr<const World>& world_of(EnvIndex env) const;
  const DroneModel& drone() const;
  int num_threads() const;  // what num_threads = 0 became
  // How many rays of LiDARs and cameras, shadow rays included, have gone through Embree's trees of triangles, and in how many
  // packets; since the batch was made.
  std::int64_t embree_rays() const;
  std::int64_t embree_packets() const;
  const State& state() const;

  // --- motion and sensing; positions (N, 3) m, quaternions (N, 4) wxyz; an empty span leaves the value unchanged
  void set_pose(std::span<const float> position, std::span<const float> quat_wxyz, DroneMask mask = {});  // no collision check
  void move(std::span<const float> position, std::span<const float> quat_wxyz,
            DroneMask mask = {});  // swept; see state().contact
  // Drones that fly by rotors: velocities (N, 3) m/s, world frame, and rad/s, body frame; rotor speeds (N, 4) rad/s. After
  // set_pose() they are at rest, rotors hovering.
  void set_velocity(std::span<const float> velocity, std::span<const float> angular_velocity, std::span<const float> rotor_speed,
                    DroneMask mask = {});
  // Flies a command (N, 4), as config().dynamics.control says, for some ticks; 0: those of a step. move() is for kinematic
  // motion.
  void fly(std::span<const float> command, int ticks = 0, DroneMask mask = {});
  void sense(DroneMask mask = {});

  // --- slots
  void spawn(
      std::span<const std::int64_t> indices, std::span<const float> position, std::span<const float> quat_wxyz,
      std::span<const std::int32_t> world_index);  // rows in the order of indices; an empty span leaves the value unchanged
  void remove(std::span<const std::int64_t> indices);
  void set_world(std::span<const std::int32_t> world_index, EnvMask mask = {});  // (E,); refused with a pool

  // --- the readings of sensors; all arrays are empty for a sensor that the batch does not have
  const PoseReadings& pose_readings() const;
  const ImuReadings& imu_readings(std::size_t imu = 0) const;        // by the index in config().imus
  const LidarReadings& lidar_readings(std::size_t lidar = 0) const;  // by the index in config().lidars
  // The arrays that the sensor of this name publishes. std::invalid_argument if there is none, or two of
  // different kinds have it.
  std::vector<ArrayView> sensor_arrays(std::string_view name) const;

  // --- the LiDARs and IMUs; std::invalid_argument if there is no such sensor
  std::size_t imu_index(std::string_view name) const;    // empty: the first
  std::size_t lidar_index(std::string_view name) const;  // empty: the first
  void require_scan(std::size_t lidar = 0) const;        // std::logic_error before the first scan, when all ranges are inf
  void set_lidar(const LidarChange& change, DroneMask mask = {}, std::size_t lidar = 0);
  LidarConfig lidar_config(std::int64_t index, std::size_t lidar = 0) const;  // of one drone, as changed at run time
  void lidar_directions(std::span<float> out, std::size_t lidar = 0) const;   // (N, channels, beams, 3) unit, body frame
  void lidar_points(std::span<float> out, std::size_t lidar = 0) const;  // (N, channels, beams, 3) m, world frame, inf on a miss

  // --- the cameras, by their index in config().cameras; std::invalid_argument where there is no such camera
  std::size_t camera_index(std::string_view name) const;        // empty: the only one
  const CameraConfig& camera_config(std::size_t camera) const;  // with its present capture mode
  const CameraImages& images(std::size_t camera) const;
  CameraConfig camera_config(std::size_t camera, std::int64_t index) const;  // of one drone, as changed at run time
  void capture(std::size_t camera, DroneMask mask = {});                     // renders now, whatever the mode
  void set_capture_mode(std::size_t camera, CaptureMode mode);
  void set_camera(std::size_t camera, const CameraChange& change, DroneMask mask = {});  // marks its frames stale
  const std::string& camera_backend_report() const;                                      // which backend renders, and why
  std::string take_warning();  // a warning not reported yet, e.g. that OpenGL failed; mostly empty
  // JPEG file of one drone's rgb frame, or grey if it has no rgb; the frame must not be stale. Quality in [1, 100].
  std::string jpeg(std::size_t camera, std::int64_t index, int quality) const;

  // --- random numbers, keyed by (env seed, episode, stream); drawing changes nothing
  void seed(std::span<const std::uint64_t> seeds, EnvMask mask = {});        // (E,); episode counters go to 0
  void begin_episode(EnvMask mask = {});                                     // the next episode of each masked env
  void random(std::uint32_t stream, int count, std::span<float> out) const;  // (E, count), uniform in [0, 1)

  // --- the task; std::logic_error without one, or before the first reset
  const Task* task() const;                                             // null without one
  void reset(std::span<const std::uint64_t> seeds, EnvMask mask = {});  // seeds (E,), or empty: the next episode
  // Actions are rows as TaskSpec::action says. Each is flown EpisodeConfig::frame_skip times.
  void step(std::span<const std::int64_t> actions);  // of an integer type: (R,)
  void step(std::span<const float> actions);         // of a floating-point type: (R, ...)
  const EpisodeState& episodes() const;
  void visit_task(ArrayVisitor& visitor) const;  // the arrays of the task, to be read
  const Outputs& outputs() const;                // of the last step, reset or restore; intact during the next one
  Outputs& outputs();

  // --- all that the next step depends on, with a hash of the configuration that restore() checks
  std::string snapshot() const;
  void restore(const std::string& blob);

 private:
  std::unique_ptr<Simulation> sim_;
};

}  // namespace flockstep
