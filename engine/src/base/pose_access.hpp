// Access to poses in arrays, whose quaternions are (w, x, y, z), and rotations as roll, pitch and yaw.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

inline Pose load_pose(const float* position, const float* quat_wxyz) {
  return {Vec3(position[0], position[1], position[2]), Quat(quat_wxyz[0], quat_wxyz[1], quat_wxyz[2], quat_wxyz[3])};
}

inline void store_pose(float* position, float* quat_wxyz, const Pose& pose) {
  for (int axis = 0; axis < 3; ++axis) position[axis] = pose.position[axis];
  quat_wxyz[0] = pose.rotation.w();
  quat_wxyz[1] = pose.rotation.x();
  quat_wxyz[2] = pose.rotation.y();
  quat_wxyz[3] = pose.rotation.z();
}

inline void set_pose_of(State& state, DroneIndex drone, const Pose& pose) {
  store_pose(state.position.data() + 3 * drone, state.quat_wxyz.data() + 4 * drone, pose);
}

// R_z(yaw) R_y(pitch) R_x(roll), angles in rad: pitch is positive nose down.
inline Quat quat_from_rpy(float roll, float pitch, float yaw) {
  const Quat turned(std::cos(yaw / 2), 0.0F, 0.0F, std::sin(yaw / 2));
  const Quat pitched(std::cos(pitch / 2), 0.0F, std::sin(pitch / 2), 0.0F);
  const Quat rolled(std::cos(roll / 2), std::sin(roll / 2), 0.0F, 0.0F);
  return turned * pitched * rolled;
}

// Returns roll, pitch and yaw. If the body's x axis points up or down, roll and yaw turn about the same axis; yaw is then 0.
inline Eigen::Vector3d rpy_from_quat(const Quat& q) {
  const double w = q.w(), x = q.x(), y = q.y(), z = q.z();
  const double sine = std::clamp(2.0 * (w * y - z * x), -1.0, 1.0);
  if (std::abs(sine) > 1.0 - 1e-7) return {2.0 * std::atan2(x, w), std::asin(sine), 0.0};
  return {std::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)), std::asin(sine),
          std::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))};
}

}  // namespace flockstep
