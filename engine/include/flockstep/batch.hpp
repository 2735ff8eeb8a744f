// Batch: N drone slots over W worlds, stepped together.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Run-time changes to the LiDARs of some drones; what is not set stays. The number of rays is fixed per batch.
struct LidarChange {
  std::optional<float> max_range_m;
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::optional<std::array<float, 3>> offset_m;
  std::optional<std::array<float, 4>> quat_wxyz;
};

// The same for a camera. The resolution is fixed per batch.
struct CameraChange {
  std::optional<float> hfov_deg;  // either of the two lets go of the other, unless both are given
  std::optional<float> vfov_deg;
  std::optional<std::array<float, 3>> offset_m;
  std::optional<std::array<float, 4>> quat_wxyz;

  bool any() const { return hfov_deg || vfov_deg || offset_m || quat_wxyz; }
};

// All methods check their input before they change anything and throw std::invalid_argument naming the field, what was expected
// and what came. A mask is (N,), 0 or 1, or empty for every active drone. Not thread-safe: one caller at a time.
// A batch does not survive fork(): using a parent's batch in the child throws std::runtime_error.
class Batch {
 public:
  using Worlds = std::vector<std::shared_ptr<const World>>;
  using Mask = std::span<const std::uint8_t>;

  // world_index: (N,), or empty for drone i in world i mod W. Drones start at their world's start marker, else at the centre of
  // its bounds.
  Batch(BatchConfig config, Worlds worlds, DroneModel drone = DroneModel::quadrotor650(),
        std::span<const std::int32_t> world_index = {});
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  const BatchConfig& config() const;
  const Worlds& worlds() const;
  const DroneModel& drone() const;
  int num_threads() const;  // what num_threads = 0 became
  const State& state() const;

  // --- motion and sensing; positions (N, 3) m, quaternions (N, 4) wxyz; an empty span keeps what is
  void set_pose(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask = {});  // no collision check
  void move(std::span<const float> position, std::span<const float> quat_wxyz, Mask mask = {});      // swept; see state().contact
  void sense(Mask mask = {});

  // --- slots
  void spawn(std::span<const std::int64_t> indices, std::span<const float> position, std::span<const float> quat_wxyz,
             std::span<const std::int32_t> world_index);  // rows in the order of indices; an empty span keeps what is
  void remove(std::span<const std::int64_t> indices);
  void set_world(std::span<const std::int32_t> world_index, Mask mask = {});  // (N,)

  // --- the LiDAR
  void set_lidar(const LidarChange& change, Mask mask = {});
  std::span<const float> lidar_max_range_m() const;    // (N,) m, of each drone; std::logic_error without a LiDAR
  LidarConfig lidar_config(std::int64_t index) const;  // of one drone, as changed at run time; likewise
  void lidar_directions(std::span<float> out) const;   // (N, channels, beams, 3) unit, body frame
  void lidar_points(std::span<float> out) const;       // (N, channels, beams, 3) m, world frame, inf on a miss

  // --- the cameras, by their index in config().cameras; std::invalid_argument where there is no such camera
  std::size_t camera_index(std::string_view name) const;
  const CameraImages& images(std::size_t camera) const;
  CameraConfig camera_config(std::size_t camera, std::int64_t index) const;  // of one drone, as changed at run time
  void capture(std::size_t camera, Mask mask = {});                          // renders now, whatever the mode
  void set_capture_mode(std::size_t camera, CaptureMode mode);
  void set_camera(std::size_t camera, const CameraChange& change, Mask mask = {});  // marks its frames stale
  const std::string& camera_backend_report() const;                                 // which backend renders, and why
  std::string take_warning();  // what was not told yet, such as that OpenGL failed; empty mostly
  // The bytes of a file of one drone's rgb, else grey, frame, which is not to be stale; quality in [1, 100].
  std::string jpeg(std::size_t camera, std::int64_t index, int quality) const;

  // --- random numbers, keyed by (env seed, episode, stream); drawing changes nothing
  void seed(std::span<const std::uint64_t> seeds, Mask mask = {});           // (N,); episode counters go to 0
  void begin_episode(Mask mask = {});                                        // the next episode of each masked env
  void random(std::uint32_t stream, int count, std::span<float> out) const;  // (N, count), uniform in [0, 1)

  // --- the built-in task; std::logic_error without one, or before the first reset
  int observation_size() const;
  int image_size() const;  // of Outputs::image; 0 where the task does not observe pixels
  void reset(std::span<const std::uint64_t> seeds, Mask mask = {});  // seeds (N,), or empty: the next episode
  // An action is flown NavigationConfig::frame_skip times.
  void step(std::span<const std::int64_t> actions);  // (N,) discrete
  void step(std::span<const float> actions);         // (N, 3) or (N, 4), clipped to [-1, 1]
  const Outputs& outputs() const;                    // of the last step, reset or restore; intact during the next one
  Outputs& outputs();
  std::span<const std::int32_t> goal_index() const;  // (N,) 0 .. number of waypoints

  // --- all that the next step depends on, with a hash of the configuration that restore() checks
  std::string snapshot() const;
  void restore(const std::string& blob);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace flockstep
