// Convex: one solid or triangle of the world, as the narrow phase wants it.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep::collision {

using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

struct Convex {
  enum class Kind : std::uint8_t {
    box,
    cylinder,
    capsule,
    sphere,
    triangle
  };  // round ones about local z; flat caps
      // but for the capsule's

  Kind kind = Kind::box;
  Vec3d center = Vec3d::Zero();        // m, world frame, the local origin
  Mat3d rotation = Mat3d::Identity();  // local to world
  Vec3d half_extents = Vec3d::Zero();  // m, as in Primitive
  std::array<Vec3d, 3> corners{};      // m, local frame; triangle only
};

Convex make_convex(const Primitive& primitive);  // not for rooms, which are hollow
Convex make_triangle(const Vec3& a, const Vec3& b, const Vec3& c);

// The point farthest along the direction (any length), local frame.
Vec3d support(const Convex& convex, const Vec3d& direction);

// The point nearest to `point`, itself if inside; world frame.
Vec3d closest_point(const Convex& convex, const Vec3d& point);

}  // namespace flockstep::collision
