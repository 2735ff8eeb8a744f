#include "swiftlet/config.hpp"

#include <cmath>

#include "batch/require.hpp"

namespace swiftlet {
namespace {

constexpr int kMaxRays = 1 << 18;  // per drone

void require_finite(float value, const char* field) { require(std::isfinite(value), field, "a finite number", value); }

void require_positive(float value, const char* field) {
  require(std::isfinite(value) && value > 0.0F, field, "a finite number > 0", value);
}

void require_not_negative(float value, const char* field) {
  require(std::isfinite(value) && value >= 0.0F, field, "a finite number >= 0", value);
}

}  // namespace

void LidarConfig::validate() const {
  require(channels >= 1 && channels <= kMaxRays, "lidar.channels", "an integer in [1, 262144]", channels);
  require(beams >= 1 && beams <= kMaxRays, "lidar.beams", "an integer in [1, 262144]", beams);
  require(hfov_deg > 0.0F && hfov_deg <= 360.0F, "lidar.hfov_deg", "a number in (0, 360]", hfov_deg);
  require(vfov_deg >= 0.0F && vfov_deg <= 180.0F, "lidar.vfov_deg", "a number in [0, 180]", vfov_deg);
  require_positive(max_range_m, "lidar.max_range_m");
  for (const float value : offset_m) require_finite(value, "lidar.offset_m");
  float norm = 0.0F;
  for (const float value : quat_wxyz) norm += value * value;
  norm = std::sqrt(norm);
  require(std::abs(norm - 1.0F) < 1e-2F, "lidar.quat_wxyz", "a unit quaternion (w, x, y, z)",
          "one of norm " + std::to_string(norm));
  require(azimuth_deg.size() == elevation_deg.size(), "lidar.elevation_deg",
          "as many values as azimuth_deg (" + std::to_string(azimuth_deg.size()) + ")", elevation_deg.size());
  for (const float value : azimuth_deg) {
    require(std::abs(value) <= 360.0F, "lidar.azimuth_deg", "values in [-360, 360]", value);
  }
  for (const float value : elevation_deg) {
    require(std::abs(value) <= 90.0F, "lidar.elevation_deg", "values in [-90, 90]", value);
  }
  const long long rays = static_cast<long long>(rows()) * columns();
  require(rays <= kMaxRays, "lidar.channels x lidar.beams", "at most 262144 rays", rays);
}

void PoseSensorConfig::validate() const {
  require_not_negative(position_noise_std_m, "pose_sensor.position_noise_std_m");
  require_not_negative(tilt_noise_std_deg, "pose_sensor.tilt_noise_std_deg");
}

void NavigationReward::validate() const {
  require_finite(distance_weight, "reward.distance_weight");
  require_finite(crash_weight, "reward.crash_weight");
  require_finite(free_space_weight, "reward.free_space_weight");
  require_finite(step_weight, "reward.step_weight");
  require_finite(action_change_weight, "reward.action_change_weight");
  require_finite(outrun_weight, "reward.outrun_weight");
  require_finite(goal_reward, "reward.goal_reward");
  require_finite(waypoint_share, "reward.waypoint_share");
  require_positive(goal_radius_m, "reward.goal_radius_m");
  require(min_clearance > 0.0F && min_clearance < 1.0F, "reward.min_clearance", "a number in (0, 1)", min_clearance);
  require_positive(step_scale, "reward.step_scale");
}

void NavigationConfig::validate() const {
  require_positive(step_m, "task.step_m");
  require(yaw_step_deg > 0.0F && yaw_step_deg <= 180.0F, "task.yaw_step_deg", "a number in (0, 180]", yaw_step_deg);
  require(max_episode_steps >= 0, "task.max_episode_steps", "an integer >= 0", max_episode_steps);
  require(!stagger_first_episode || max_episode_steps > 0, "task.stagger_first_episode",
          "False where max_episode_steps is 0 (there is no limit to stagger)", "True");
  reward.validate();
}

void BatchConfig::validate() const {
  require(num_drones >= 1 && num_drones <= (1 << 20), "num_drones", "an integer in [1, 1048576]", num_drones);
  require(num_threads >= 0 && num_threads <= 4096, "num_threads", "an integer in [0, 4096]", num_threads);
  require(block_size >= 1, "block_size", "an integer >= 1", block_size);
  if (has_lidar) {
    lidar.validate();
    const long long rays = static_cast<long long>(num_drones) * lidar.rows() * lidar.columns();
    require(rays <= (1LL << 31), "num_drones x lidar rays", "at most 2147483648 rays", rays);
  }
  pose_sensor.validate();
  if (task == TaskKind::navigation) {
    navigation.validate();
    require(has_lidar, "lidar", "a LidarConfig (the navigation task needs one)", "None");
  }
}

}  // namespace swiftlet
