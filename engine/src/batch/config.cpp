#include "flockstep/config.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/require.hpp"

namespace flockstep {
namespace {

constexpr int kMaxRays = 1 << 18;  // per drone
constexpr int kMaxSide = 8192;     // px, of an image

void require_finite(float value, const char* field) { require(std::isfinite(value), field, "a finite number", value); }

void require_positive(float value, const char* field) {
  require(std::isfinite(value) && value > 0.0F, field, "a finite number > 0", value);
}

void require_not_negative(float value, const char* field) {
  require(std::isfinite(value) && value >= 0.0F, field, "a finite number >= 0", value);
}

void require_unit_quaternion(const std::array<float, 4>& quat_wxyz, const char* field) {
  float norm = 0.0F;
  for (const float value : quat_wxyz) norm += value * value;
  norm = std::sqrt(norm);
  require(std::abs(norm - 1.0F) < 1e-2F, field, "a unit quaternion (w, x, y, z)", "one of norm " + std::to_string(norm));
}

// Pixels per unit of slope, of an image that many pixels long.
float focal_length(int pixels, float fov_deg) {
  return static_cast<float>(0.5 * pixels / std::tan(0.5 * static_cast<double>(fov_deg) * std::numbers::pi / 180.0));
}

}  // namespace

void LidarConfig::validate() const {
  require(channels >= 1 && channels <= kMaxRays, "lidar.channels", "an integer in [1, 262144]", channels);
  require(beams >= 1 && beams <= kMaxRays, "lidar.beams", "an integer in [1, 262144]", beams);
  require(hfov_deg > 0.0F && hfov_deg <= 360.0F, "lidar.hfov_deg", "a number in (0, 360]", hfov_deg);
  require(vfov_deg >= 0.0F && vfov_deg <= 180.0F, "lidar.vfov_deg", "a number in [0, 180]", vfov_deg);
  require_positive(max_range_m, "lidar.max_range_m");
  for (const float value : offset_m) require_finite(value, "lidar.offset_m");
  require_unit_quaternion(quat_wxyz, "lidar.quat_wxyz");
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

float CameraConfig::fx() const { return hfov_deg || !vfov_deg ? focal_length(width_px, hfov_deg.value_or(90.0F)) : fy(); }

float CameraConfig::fy() const { return vfov_deg ? focal_length(height_px, *vfov_deg) : fx(); }

void CameraConfig::validate() const {
  // It becomes part of file names.
  const auto is_plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '-';
  };
  require(!name.empty() && std::all_of(name.begin(), name.end(), is_plain), "camera.name", "letters, digits, _ and -",
          '"' + name + '"');
  require(width_px >= 1 && width_px <= kMaxSide, "camera.width_px", "an integer in [1, 8192]", width_px);
  require(height_px >= 1 && height_px <= kMaxSide, "camera.height_px", "an integer in [1, 8192]", height_px);
  const auto require_fov = [](const std::optional<float>& fov_deg, const char* field) {
    if (fov_deg) require(*fov_deg >= 0.1F && *fov_deg <= 179.0F, field, "a number in [0.1, 179]", *fov_deg);
  };
  require_fov(hfov_deg, "camera.hfov_deg");
  require_fov(vfov_deg, "camera.vfov_deg");
  // What one field of view makes of the other.
  for (const float slope : {0.5F * static_cast<float>(width_px) / fx(), 0.5F * static_cast<float>(height_px) / fy()}) {
    require(slope < 115.0F, hfov_deg ? "camera.hfov_deg" : "camera.vfov_deg",
            "one that leaves the other below 179 degrees (pixels are square)", hfov_deg ? *hfov_deg : vfov_deg.value_or(90.0F));
  }
  for (const float value : offset_m) require_finite(value, "camera.offset_m");
  require_unit_quaternion(quat_wxyz, "camera.quat_wxyz");
  require_positive(near_m, "camera.near_m");
  require(std::isfinite(far_m) && far_m > near_m, "camera.far_m", "a finite number > near_m (" + std::to_string(near_m) + ")",
          far_m);
  require(far_m <= 1e6F, "camera.far_m", "at most 1e+06", far_m);
  require(outputs.any_color() || outputs.depth || outputs.semantic || outputs.instance || outputs.normal, "camera.outputs",
          "at least one of rgb, depth, semantic, instance, normal, grey", "none");
  require(samples_per_pixel == 1 || samples_per_pixel == 4 || samples_per_pixel == 9 || samples_per_pixel == 16,
          "camera.samples_per_pixel", "1, 4, 9 or 16", samples_per_pixel);
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
  require_finite(overshoot_weight, "reward.overshoot_weight");
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
  require(frame_skip >= 1 && frame_skip <= 1000, "task.frame_skip", "an integer in [1, 1000]", frame_skip);
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
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const CameraConfig& camera = cameras[i];
    camera.validate();
    const auto same = [&](const CameraConfig& other) { return other.name == camera.name; };
    require(std::none_of(cameras.begin(), cameras.begin() + static_cast<std::ptrdiff_t>(i), same), "camera.name",
            "a name that no other camera has", '"' + camera.name + '"');
    const long long pixels = static_cast<long long>(num_drones) * camera.width_px * camera.height_px;
    require(pixels <= (1LL << 32), "num_drones x camera pixels", "at most 4294967296 pixels", pixels);
  }
  pose_sensor.validate();
  if (task == TaskKind::navigation) {
    navigation.validate();
    require(has_lidar, "lidar", "a LidarConfig (the navigation task needs one)", "None");
  }
  if (task == TaskKind::navigation && navigation.observation != ObservationKind::goal) {
    require(!cameras.empty(), "cameras", "a CameraConfig (the task observes its image)", "none");
    const CameraConfig& camera = cameras.front();
    require(camera.outputs.rgb, "camera.outputs", "rgb among them (the task observes it)", "none");
    require(camera.capture_mode != CaptureMode::on_demand, "camera.capture_mode",
            "every_step or on_movement (the task observes it)", "on_demand");
    require(navigation.observation != ObservationKind::pixels || camera.layout == ImageLayout::chw, "camera.layout",
            "chw (the task observes pixels)", "hwc");
  }
}

}  // namespace flockstep
