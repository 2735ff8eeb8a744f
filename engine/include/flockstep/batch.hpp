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
  AlignedVector<float> reward;            // (R,)
  AlignedVector<float> reward_terms;      // (R, number of terms); their sum is the reward
  FlagArray terminated;                   // (R,)
  FlagArray truncated;                    // (R,)
  FlagArray success;                      // (R,) ended here, and the task calls it a success
  FlagArray crashed;                      // (R,) ended here, in contact with something
  // (R,) ended here (terminated), because a setpoint, a pose, a reward or an observation was not finite, or a pose was beyond the
  // world. The drone stayed where it was, the reward and the observation read 0 there. An infinity that the bounds of the
  // observation's field contain counts as finite.
  FlagArray bad_state;
  AlignedVector<std::uint8_t> episode_end;     // (R,) EpisodeEnd: why the episode ended here; none if it goes on
  AlignedVector<double> episode_return;        // (R,) of the episode that ended here, else of the current one so far
  AlignedVector<double> episode_terms;         // (R, number of terms) the sum of each reward term over the same episode
  AlignedVector<std::int64_t> episode_length;  // (R,) of the same episode, in flown steps

  static constexpr auto fields() {
    using C = Outputs;
    return field_list(field("observation", &C::observation), field("final_observation", &C::final_observation),
                      field("reward", &C::reward), field("reward_terms", &C::reward_terms), field("terminated", &C::terminated),
                      field("truncated", &C::truncated), field("success", &C::success), field("crashed", &C::crashed),
                      field("bad_state", &C::bad_state), field("episode_end", &C::episode_end),
                      field("episode_return", &C::episode_return), field("episode_terms", &C::episode_terms),
                      field("episode_length", &C::episode_length));
  }
};

struct Simulation;

// All methods check their input before they change anything and throw std::invalid_argument naming the field, what was expected
// and what came. An empty mask selects every active drone or env; an env is active if one of its drones is. Not thread-safe: one
// caller at a time.
// A batch does not survive fork(): using a parent's batch in the child throws std::runtime_error. So does a call while another
// thread is in one.
class Batch {
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

  // --- the pose sensor
  const std::vector<float>& sensed_position() const;   // (N, 3) m
  const std::vector<float>& sensed_quat_wxyz() const;  // (N, 4)

  // --- the IMU; empty without one
  std::span<const float> accelerometer() const;  // (N, 3) m/s^2, sensor frame
  std::span<const float> gyroscope() const;      // (N, 3) rad/s, sensor frame

  // --- the LiDAR; std::invalid_argument without one, or where it has another name
  void require_lidar(std::string_view name) const;
  void require_scan() const;  // std::logic_error before the first scan, when all ranges are inf
  void set_lidar(const LidarChange& change, DroneMask mask = {});
  const std::vector<float>& lidar_ranges() const;      // (N, channels, beams) m, inf on a miss; empty without a LiDAR
  std::span<const float> lidar_max_range_m() const;    // (N,) m, of each drone
  LidarConfig lidar_config(std::int64_t index) const;  // of one drone, as changed at run time
  void lidar_directions(std::span<float> out) const;   // (N, channels, beams, 3) unit, body frame
  void lidar_points(std::span<float> out) const;       // (N, channels, beams, 3) m, world frame, inf on a miss

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
