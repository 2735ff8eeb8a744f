// Corners: the corners of a convex body, for the query that its distance needs: the corner farthest along a direction.
#pragma once

#include <span>

#include "collision/convex.hpp"
#include "flockstep/aligned.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

class Corners {
 public:
  // Takes the corners of the mesh's solid triangles. Those that are not corners of their convex hull only cost time.
  explicit Corners(const TriangleMesh& mesh);

  bool empty() const { return x_.empty(); }
  std::size_t count() const { return x_.size(); }
  Vec3d corner(std::size_t index) const {  // m, local frame
    return {static_cast<double>(x_[index]), static_cast<double>(y_[index]), static_cast<double>(z_[index])};
  }
  // Returns the corner farthest along the direction (local frame, any length).
  Vec3d support(const Vec3d& direction) const;
  double radius() const { return radius_; }  // m, of the ball around the local origin that contains the corners

 private:
  // (count,) m, local frame
  AlignedVector<float> x_, y_, z_;
  double radius_ = 0.0;
};

}  // namespace flockstep::collision
