// Writes poses to arrays, where quaternions are (w, x, y, z). State has what reads them.
#pragma once

#include <cstddef>

#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

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
