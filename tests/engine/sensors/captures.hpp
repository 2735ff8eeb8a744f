// Batches with cameras whose frames show when they were taken.
#pragma once

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "picture_oracle.hpp"

namespace flockstep::captures {

using namespace testing;
using Flags = std::vector<std::uint8_t>;
using Steps = std::vector<std::int64_t>;

// -- Capture times. A camera of one pixel faces a wall, so its depth shows the drone's position at the capture.

inline constexpr float kWall = 10.0F;  // m, distance of the wall ahead in the first world; doubled in the second

inline BatchConfig probes(int num_envs, CaptureMode mode) {
  return camera_batch({.width_px = 1, .height_px = 1, .outputs = {.rgb = false, .depth = true}, .capture_mode = mode}, num_envs);
}

inline const Batch::Worlds& halls() {
  static const Batch::Worlds worlds{make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {kWall, 9, 9})}),
                                    make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {2 * kWall, 9, 9})})};
  return worlds;
}

inline void put(Batch& batch, const std::vector<float>& x, const Flags& mask = {}) {
  std::vector<float> position;
  for (const float each : x) position.insert(position.end(), {each, 0.0F, 0.0F});
  batch.set_pose(position, {}, mask);
}

// Returns the drones' x at the capture, in the first world; inf before the first capture.
inline std::vector<float> shown(const Batch& batch, std::size_t camera = 0) {
  std::vector<float> x;
  for (const float depth : batch.camera(camera).images().depth) x.push_back(depth == kInfinity ? kInfinity : kWall - depth);
  return x;
}

inline const Steps& frame_step(const Batch& batch, std::size_t camera = 0) { return batch.camera(camera).images().frame_step; }

// Overwrites all frames, so that frames without a new capture are recognised.
inline void smear(const Batch& batch, std::size_t camera = 0) {
  for (const float& depth : batch.camera(camera).images().depth) const_cast<float&>(depth) = -1.0F;
}

inline bool is_smeared(const Batch& batch, std::size_t drone) { return batch.camera(0).images().depth[drone] == -1.0F; }

// -- Captures by the task: in every autoreset mode, no frame is older than its capture mode allows.

inline std::shared_ptr<const World> smaller_closet() {
  return make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {1.0F, 1.0F, 0.75F}),
                     primitive(PrimitiveKind::sphere, {1.8F, 1.7F, 0.4F}, {0.125F, 0.125F, 0.125F})},
                    {.start = Vec3(1, 1, 0.75F),
                     .goal = Vec3(1, 1.25F, 0.75F),
                     .spawn_box = Aabb{Vec3(0.9F, 0.9F, 0.6F), Vec3(1.1F, 1, 0.9F)}});
}

inline constexpr std::size_t kEnvs = 12;

inline NavigationBatch flying(AutoresetMode autoreset, CaptureMode mode) {
  NavigationBatch config = navigation_batch(kEnvs);
  config.episode.autoreset_mode = autoreset;
  config.navigation.action = ActionKind::displacement;
  config.episode.max_episode_steps = 14;
  config.navigation.random_start = true;
  config.episode.random_world = true;
  config.episode.stagger_first_episode = true;
  config.cameras = {{.width_px = 9, .height_px = 7, .outputs = {.rgb = true, .depth = true}, .capture_mode = mode}};
  return config;
}

// Random actions. Some drones stay at rest with action 0.
inline std::vector<float> random_actions(Random& random) {
  std::vector<float> actions(3 * kEnvs, 0.0F);
  for (std::size_t i = 0; i < kEnvs; ++i) {
    if (random.within(0, 1) < 0.4F) continue;
    for (std::size_t k = 0; k < 3; ++k) actions[3 * i + k] = random.within(-1, 1);
  }
  return actions;
}

}  // namespace flockstep::captures
