// Convex: one solid or triangle of the world, in the form that the narrow phase uses.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

class Corners;

struct Convex {
  // The axis of cylinders and capsules is local z. Cylinders have flat caps. A hull is the convex hull of its corners.
  enum class Kind : std::uint8_t { box, cylinder, capsule, sphere, triangle, hull };

  Kind kind = Kind::box;
  Vec3d center = Vec3d::Zero();        // m, world frame, the local origin
  Mat3d rotation = Mat3d::Identity();  // local to world
  Vec3d half_extents = Vec3d::Zero();  // m, as in Primitive
  std::array<Vec3d, 3> corners{};      // m, local frame; triangle only
  const Corners* hull = nullptr;       // hull only
};

Convex make_convex(const Primitive& primitive);  // not for rooms, which are hollow
// The corners must outlive the convex.
Convex make_hull(const Corners& corners, const Pose& pose);
Convex make_triangle(const Vec3& a, const Vec3& b, const Vec3& c);

// Returns the point farthest along the direction (any length), local frame.
Vec3d support(const Convex& convex, const Vec3d& direction);

// Returns the point of the convex nearest to `point`, or `point` itself if it is inside; world frame.
Vec3d closest_point(const Convex& convex, const Vec3d& point);

// Corners: the corners of a convex part of a body, for the query that its distance needs: the corner farthest along a
// direction.
class Corners {
 public:
  // Takes the corners of triangles. Those that are not corners of their convex hull only cost time.
  Corners(const TriangleMesh& mesh, std::span<const std::array<std::int32_t, 3>> triangles);
  explicit Corners(std::span<const Vec3> points);

  std::size_t count() const { return x_.size(); }
  Vec3d corner(std::size_t index) const {  // m, local frame
    return {static_cast<double>(x_[index]), static_cast<double>(y_[index]), static_cast<double>(z_[index])};
  }
  // Returns the corner farthest along the direction (local frame, any length).
  Vec3d support(const Vec3d& direction) const;
  double radius() const { return radius_; }  // m, of the ball around the local origin that contains the corners

 private:
  void take(std::vector<std::array<float, 3>> corners);  // without repetitions

  // (count,) m, local frame
  AlignedVector<float> x_, y_, z_;
  double radius_ = 0.0;
};

// Returns the corners of each solid object of a mesh.
std::vector<Corners> corners_of_objects(const TriangleMesh& mesh);

}  // namespace flockstep::collision
