// Poses in the state's arrays, where quaternions are (w, x, y, z).
#pragma once

#include <cstddef>

#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

inline Vec3 position_of(const State& state, std::size_t drone) {
  const float* const p = state.position.data() + 3 * drone;
  return {p[0], p[1], p[2]};
}

inline Pose pose_of(const State& state, std::size_t drone) {
  const float* const q = state.quat_wxyz.data() + 4 * drone;
  return {position_of(state, drone), Quat(q[0], q[1], q[2], q[3])};
}

inline void store_pose(float* position, float* quat_wxyz, const Pose& pose) {
  for (int axis = 0; axis < 3; ++axis) position[axis] = pose.position[axis];
  quat_wxyz[0] = pose.rotation.w();
  quat_wxyz[1] = pose.rotation.x();
  quat_wxyz[2] = pose.rotation.y();
  quat_wxyz[3] = pose.rotation.z();
}

inline void set_pose_of(State& state, std::size_t drone, const Pose& pose) {
  store_pose(state.position.data() + 3 * drone, state.quat_wxyz.data() + 4 * drone, pose);
}

}  // namespace flockstep
