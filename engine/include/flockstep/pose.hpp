// Small geometric value types shared by all stages.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

#include "flockstep/limits.hpp"

namespace flockstep {

// World frame: right-handed, x east, y north, z up (metres). Body frame: x forward, y left, z up.
using Vec3 = Eigen::Vector3f;
using Mat3 = Eigen::Matrix3f;  // a rotation, body to world, or any other 3 x 3 matrix
// A rotation from body to world. Eigen stores (x, y, z, w); arrays of the interface are (w, x, y, z).
using Quat = Eigen::Quaternionf;

// Position and orientation.
struct Pose {
  Vec3 position = Vec3::Zero();      // m, world frame
  Quat rotation = Quat::Identity();  // unit, body to world
};

// A library and its users must use the same layout of these types.
static_assert(sizeof(Pose) == 32 && alignof(Pose) == 16, "flockstep: expected Eigen's default alignment, got another one");

// Linear and angular velocity.
struct Velocity {
  Vec3 linear = Vec3::Zero();   // m/s, world frame
  Vec3 angular = Vec3::Zero();  // rad/s, body frame
};

// Also returns false for NaN.
inline bool is_in_world(float coordinate) { return std::abs(static_cast<double>(coordinate)) <= kMaxCoordinate; }
inline bool is_in_world(const Vec3& point) { return is_in_world(point.x()) && is_in_world(point.y()) && is_in_world(point.z()); }

// An axis-aligned box.
struct Aabb {
  Vec3 min = Vec3::Constant(0.0F);  // m
  Vec3 max = Vec3::Constant(0.0F);  // m
};

}  // namespace flockstep
