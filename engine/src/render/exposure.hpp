// Exposure: how a camera moves while it takes an image.
#pragma once

#include <cstddef>

#include "base/pose_path.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/sensors/camera.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::render {

struct CameraPose {
  Vec3 position;  // m, world frame
  Mat3 rotation;  // camera to world
};

// The mounting of a camera on its drone.
struct Mount {
  Vec3 offset;    // m, body frame
  Mat3 rotation;  // camera to body

  CameraPose on(const Pose& drone) const {
    const Mat3 body = drone.rotation.toRotationMatrix();
    CameraPose pose;
    for (int axis = 0; axis < 3; ++axis) pose.rotation.col(axis) = trace::rotated(body, rotation.col(axis));
    pose.position = drone.position + trace::rotated(body, offset);
    return pose;
  }
};

// The exposure of each row lasts `exposure_s`. The last row's ends at the reading, the first row's `rolling_shutter_s` before.
struct Exposure {
  PosePath path;  // of the drone, up to the reading
  Mount mount;
  float ticks_hz;  // ticks of the path per second

  // Returns the camera's pose number `pose` of CameraConfig::num_poses(), the last of which is at the end of a row's exposure.
  CameraPose at(const CameraConfig& camera, std::size_t row, int pose) const {
    const auto left = [](int i, int count) {  // share of the numbers from i to the last one
      return count > 1 ? static_cast<float>(count - 1 - i) / static_cast<float>(count - 1) : 0.0F;
    };
    const float age_s = camera.rolling_shutter_s * left(static_cast<int>(row), camera.height_px) +
                        camera.exposure_s * left(pose, camera.num_poses());
    return mount.on(path.before(age_s * ticks_hz));
  }
};

}  // namespace flockstep::render
