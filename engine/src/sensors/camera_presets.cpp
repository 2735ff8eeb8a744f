#include <array>
#include <string_view>

#include "base/check_fields.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/sensors/camera.hpp"
#include "sensors/presets.hpp"

namespace flockstep {

// docs/reference/sensors.md has the sources of the numbers.
CameraConfig CameraConfig::preset(std::string_view product) {
  constexpr CameraOutputs kDepth{.rgb = false, .depth = true};
  // A RealSense. Its greatest disparity is 126 px, which limits the range.
  const auto realsense = [&](const char* name, float baseline_m) {
    CameraConfig camera{.name = name, .width_px = 848, .height_px = 480, .hfov_deg = 87.0F, .far_m = 10.0F, .outputs = kDepth};
    camera.depth_errors = {.baseline_m = baseline_m,
                           .focal_px = camera.fx(),
                           .edge_shadow = true,
                           .blotches = 0.02F,
                           .blotch_size_px = 40.0F,
                           .disparity_noise_px = 0.1F,
                           .disparity_step_px = 1.0F / 32,
                           .min_range_m = camera.fx() * baseline_m / 126,
                           .dropout = 0.01F,
                           .hole_m = 0.0F};
    return camera;
  };
  CameraConfig kinect{.name = "kinect", .width_px = 640, .height_px = 480, .hfov_deg = 57.0F, .far_m = 5.0F, .outputs = kDepth};
  kinect.depth_errors = {.baseline_m = 0.075F,
                         .focal_px = kinect.fx(),
                         .edge_shadow = true,
                         .blotches = 0.02F,
                         .blotch_size_px = 40.0F,
                         .disparity_noise_px = 1.0F / 6,
                         .disparity_step_px = 1.0F / 8,
                         .min_range_m = 0.5F,
                         .hole_m = 0.0F};
  CameraConfig tof{.name = "tof", .width_px = 224, .height_px = 172, .hfov_deg = 56.0F, .far_m = 4.0F, .outputs = kDepth};
  tof.depth_errors = {.noise_std_m = 0.0053F, .min_range_m = 0.1F, .dropout = 0.01F, .hole_m = 0.0F};
  const std::array presets{realsense("d435", 0.05F), realsense("d455", 0.095F), kinect, tof};
  return sensors::preset_named(product, presets, "CameraConfig.preset");
}

std::array<CameraConfig, 2> CameraConfig::stereo_pair(float baseline_m) const {
  check_number(baseline_m, kFields<DepthErrors>.get<0>().info.limits, "baseline_m");
  validate();  // the rotation is one
  std::array<CameraConfig, 2> pair{*this, *this};
  const Quat rotation = Quat(quat_wxyz[0], quat_wxyz[1], quat_wxyz[2], quat_wxyz[3]).normalized();
  Vec3::Map(pair[1].offset_m.data()) -= rotation * Vec3(0, baseline_m, 0);
  pair[0].name += "_left";
  pair[1].name += "_right";
  return pair;
}

}  // namespace flockstep
