// Access to poses in arrays. Quaternions are (w, x, y, z).
#pragma once

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

}  // namespace flockstep
