// Exposure: how a camera moves while it takes an image.
#pragma once

#include <cstddef>

#include "base/pose_path.hpp"
#include "flockstep/pose.hpp"
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

// The exposure of the last row ends at the reading.
struct Exposure {
  PosePath path;  // of the drone, up to the reading
  Mount mount;
  float rolling_ticks;  // between the exposures of the first and the last row
  float row_ticks;      // of the exposure of a row
  int rows;
  int poses;  // within the exposure of a row, of which the last one is at its end

  CameraPose at(std::size_t row, int pose) const {
    const auto left = [](int i, int count) {  // share of the numbers from i to the last one
      return count > 1 ? static_cast<float>(count - 1 - i) / static_cast<float>(count - 1) : 0.0F;
    };
    return mount.on(path.before(rolling_ticks * left(static_cast<int>(row), rows) + row_ticks * left(pose, poses)));
  }
};

}  // namespace flockstep::render
