#include "batch/snapshot.hpp"

#include <sstream>

namespace flockstep {

std::uint64_t config_hash(const BatchConfig& config, const std::vector<std::shared_ptr<const World>>& worlds,
                          const DroneModel& drone) {
  std::ostringstream text;
  text << std::hexfloat;
  const auto list = [&](const auto& values) {
    text << '[';
    for (const auto& value : values) text << value << ',';
    text << ']';
  };
  const auto field = [&](const auto& value) { text << value << ';'; };
  field(config.num_drones);
  field(config.has_lidar);
  if (config.has_lidar) {
    const LidarConfig& lidar = config.lidar;
    field(lidar.rows());
    field(lidar.columns());
    list(lidar.azimuth_deg);
    list(lidar.elevation_deg);
    field(lidar.hfov_deg);
    field(lidar.vfov_deg);
    field(lidar.max_range_m);
    list(lidar.offset_m);
    list(lidar.quat_wxyz);
  }
  field(config.cameras.size());
  for (const CameraConfig& camera : config.cameras) {
    field(camera.name);
    field(camera.width_px);
    field(camera.height_px);
    field(camera.fx());
    field(camera.fy());
    list(camera.offset_m);
    list(camera.quat_wxyz);
    field(camera.near_m);
    field(camera.far_m);
    const CameraOutputs& outputs = camera.outputs;
    for (const bool output :
         {outputs.rgb, outputs.depth, outputs.semantic, outputs.instance, outputs.normal, outputs.grey, camera.shadows}) {
      field(output);
    }
    field(static_cast<int>(camera.depth_kind));
    field(static_cast<int>(camera.layout));
    field(camera.samples_per_pixel);
  }
  field(config.pose_sensor.position_noise_std_m);
  field(config.pose_sensor.tilt_noise_std_deg);
  field(static_cast<int>(config.task));
  if (config.task == TaskKind::navigation) {
    const NavigationConfig& task = config.navigation;
    field(static_cast<int>(task.action));
    field(static_cast<int>(task.observation));
    field(task.frame_skip);
    field(task.step_m);
    field(task.yaw_step_deg);
    field(task.max_episode_steps);
    field(task.random_start);
    field(task.random_world);
    field(task.stagger_first_episode);
    const NavigationReward& reward = task.reward;
    for (const float value : {reward.distance_weight, reward.crash_weight, reward.free_space_weight, reward.step_weight,
                              reward.action_change_weight, reward.overshoot_weight, reward.goal_reward, reward.waypoint_share,
                              reward.goal_radius_m, reward.min_clearance, reward.step_scale}) {
      field(value);
    }
    field(reward.carry_over_distance);
  }
  field(static_cast<int>(config.autoreset_mode));
  for (const auto& world : worlds) field(world->to_json());
  for (const Vec3& vertex : drone.hull()) list(std::vector<float>{vertex.x(), vertex.y(), vertex.z()});
  return hash_bytes(text.str());
}

}  // namespace flockstep
