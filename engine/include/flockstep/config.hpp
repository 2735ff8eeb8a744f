// Every configuration of the engine. Plain structs, valid by default, validated once where they enter.
// Names carry their unit or kind. Throws of validate(): std::invalid_argument naming the field, what was expected and what came.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace flockstep {

// A scanning LiDAR. Either a grid of channels x beams, or (azimuth_deg, elevation_deg) lists of equal length.
struct LidarConfig {
  int channels = 1;                            // rows, spread over vfov_deg from -vfov/2 to +vfov/2, both ends included
  int beams = 35;                              // per channel, counter-clockwise from -hfov/2 to +hfov/2, both ends included
                                               // (at 360 the end is left out)
  float hfov_deg = 270.0F;                     // in (0, 360]
  float vfov_deg = 0.0F;                       // in [0, 180]; one channel looks at elevation 0
  float max_range_m = 3.0F;                    // > 0; farther is a miss: inf in metres, 1 when normalised
  std::array<float, 3> offset_m{0, 0, 0};      // of the sensor in the body frame
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};  // sensor to body; normalised if close to unit
  std::vector<float> azimuth_deg;              // a pattern instead of the grid: shape (N, 1, len)
  std::vector<float> elevation_deg;            // same length as azimuth_deg

  void validate() const;
  bool has_pattern() const { return !azimuth_deg.empty() || !elevation_deg.empty(); }
  int rows() const { return has_pattern() ? 1 : channels; }
  int columns() const { return has_pattern() ? static_cast<int>(azimuth_deg.size()) : beams; }
};

enum class DepthKind : std::uint8_t {
  planar,  // along the optical axis
  range,   // from the camera
};

enum class ImageLayout : std::uint8_t {
  hwc,  // (N, H, W, 3)
  chw,  // (N, 3, H, W)
};

// When frames are rendered. A reset, and a change of the camera itself, is always a reason to render (on_demand: at the next
// capture).
enum class CaptureMode : std::uint8_t {
  every_step,   // at every step or sense()
  on_movement,  // at those where the drone's pose or world is another than its frame shows
  on_demand,    // by capture() alone
};

// What a camera writes; see CameraImages.
struct CameraOutputs {
  bool rgb = true;
  bool depth = false;
  bool semantic = false;
  bool instance = false;
  bool normal = false;
  bool grey = false;

  bool any_color() const { return rgb || grey; }
};

// A pinhole camera. Its frame: x along the optical axis, y left, z up. The centre of the image is where the axis meets it.
struct CameraConfig {
  std::string name = "front";  // of its own in the batch: letters, digits, _ and -
  int width_px = 640;          // in [1, 8192]
  int height_px = 480;         // in [1, 8192]
  // Each in [0.1, 179]. One alone: pixels are square, and the other, which follows, is below 179, too. Neither: hfov_deg is 90.
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::array<float, 3> offset_m{0, 0, 0};      // of the camera in the body frame
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};  // camera to body; normalised if close to unit
  float near_m = 0.05F;                        // > 0; planar depth below which nothing is seen
  float far_m = 100.0F;                        // > near_m, at most 1e6; planar depth beyond which the sky is seen
  CameraOutputs outputs;
  DepthKind depth_kind = DepthKind::planar;
  ImageLayout layout = ImageLayout::hwc;  // of rgb and normal
  CaptureMode capture_mode = CaptureMode::every_step;
  int samples_per_pixel = 1;  // 1, 4, 9 or 16, a grid, averaged as written; colours only: the rest is of the pixel's centre
  bool shadows = false;       // hard shadows of the sun; rooms and markers cast none

  void validate() const;
  float fx() const;  // px
  float fy() const;  // px
};

// Who renders cameras.
enum class CameraBackend : std::uint8_t {
  raycast,    // the engine's own tracing: needs nothing, and repeats to the bit
  gl,         // OpenGL 4.5 by EGL, headless; without it, raycast with a warning
  automatic,  // the faster of the two on the batch's worlds, timed when it is made; likewise
};

// Exact pose, with optional Gaussian noise.
struct PoseSensorConfig {
  float position_noise_std_m = 0.0F;  // per axis, >= 0
  float tilt_noise_std_deg = 0.0F;    // rotation-vector noise per axis, >= 0

  void validate() const;
  bool is_exact() const { return position_noise_std_m == 0.0F && tilt_noise_std_deg == 0.0F; }
};

// What actions mean in the built-in tasks.
enum class ActionKind : std::uint8_t {
  discrete,          // 0..5: +x, -x, +y, -y, +z, -z by step_m in the body frame
  displacement,      // (3,) in [-1, 1]: times step_m, body frame
  displacement_yaw,  // (4,): the same and a yaw turn of up to yaw_step_deg, counter-clockwise positive
  discrete_forward,  // 0..2: +x, +y, -y by step_m in the body frame
};

inline constexpr bool is_discrete(ActionKind kind) {
  return kind == ActionKind::discrete || kind == ActionKind::discrete_forward;
}

// What the built-in tasks show a policy. The camera is the batch's first; it needs rgb, and a capture mode other than on_demand.
enum class ObservationKind : std::uint8_t {
  goal,    // unit direction to the current goal in the body frame (3), then the normalised ranges
  blob,    // offset and area of the green in the camera's image (2), then the normalised ranges; see task/green_blob.hpp
  pixels,  // the normalised ranges, and the camera's image apart; its layout is chw
};

// When an env whose episode ended is reset.
enum class AutoresetMode : std::uint8_t {
  next_step,  // the following step ignores the action and returns the reset observation, reward 0, flags false
  same_step,  // the ending step returns the reset observation; the last one of the episode is final_observation
  disabled,   // the caller resets with a mask; a finished env does not change until then
};

// The reward of the navigation task: the sum of these terms, each times its weight.
// Source: the LiDAR and camera experiments of the thesis "Drone Simulation Using Unreal Engine", chapter 6.
// l are the LiDAR ranges over max_range_m, |L| their number, M = min_clearance, R = goal_reward.
struct NavigationReward {
  float distance_weight = 1.0F;  // R at the goal; R * waypoint_share / #waypoints at a waypoint; else cm gained towards the goal
  float crash_weight = 1.0F;     // -R on a collision; else min(l) - M where min(l) < M; else 0
  float free_space_weight = 1.0F;     // sum(l / M - 1) / (|L| / M - |L|): 1 in the open
  float step_weight = 1.0F;           // -(step number) / step_scale, the first step being number 0
  float action_change_weight = 1.0F;  // -1 if the action differs from the last one; the first action counts as a change
  float overshoot_weight =
      0.0F;  // -R / 10 when x exceeds the current goal's x + goal_radius_m; non-zero also ends the episode there

  float goal_reward = 10000.0F;      // R
  float waypoint_share = 0.1F;       // of R, split among the waypoints
  float goal_radius_m = 0.5F;        // T, > 0: goal and waypoints count as reached within it
  float min_clearance = 0.2F;        // M, in (0, 1), in units of max_range_m
  float step_scale = 3000.0F;        // > 0
  bool carry_over_distance = false;  // keep the last distance when the goal changes, as the thesis's program did

  void validate() const;
};

inline constexpr int kNumRewardTerms = 6;  // in the order of the weights above

// Fly from the start over the waypoints to the goal, by LiDAR and what `observation` adds to it.
struct NavigationConfig {
  ActionKind action = ActionKind::discrete;
  ObservationKind observation = ObservationKind::goal;
  float step_m = 0.1F;           // > 0
  float yaw_step_deg = 10.0F;    // in (0, 180]
  int max_episode_steps = 3000;  // truncation, in flown steps; 0: never
  int frame_skip = 1;  // in [1, 1000]: a step() flies its action so many times, or until the episode ends, and is rewarded
                       // the sum. All that counts steps counts those flown. The camera looks after the last alone.
  NavigationReward reward;
  bool random_start = false;           // start uniformly in the world's spawn box instead of at its start marker
  bool random_world = false;           // each reset draws a world at random instead of keeping the env's own
  bool stagger_first_episode = false;  // first time limits spread over [1, max_episode_steps], keyed by seed

  void validate() const;
};

enum class TaskKind : std::uint8_t { none, navigation };

struct BatchConfig {
  int num_drones = 1;   // N, in [1, 1 << 20]
  int num_threads = 0;  // 0: physical cores in the affinity mask
  bool has_lidar = false;
  LidarConfig lidar;
  std::vector<CameraConfig> cameras;  // of different names; at most 2^32 pixels each, of all drones
  CameraBackend camera_backend = CameraBackend::raycast;
  PoseSensorConfig pose_sensor;
  TaskKind task = TaskKind::none;  // navigation requires a LiDAR
  NavigationConfig navigation;
  AutoresetMode autoreset_mode = AutoresetMode::next_step;
  int block_size = 64;  // drones a thread takes at once, > 0; no result depends on it

  void validate() const;
};

}  // namespace flockstep
