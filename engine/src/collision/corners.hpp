// Corners: the corners of a convex part of a body, for the query that its distance needs: the corner farthest along a direction.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "collision/convex.hpp"
#include "flockstep/aligned.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

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
