// Polygons of mesh files.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep {

inline constexpr std::size_t kMaxCorners = 1000;  // of a face: cutting it into triangles takes their number squared

class PolygonCutter {
 public:
  using Triangle = std::array<std::size_t, 3>;

  // Triangles of a polygon of 3 to kMaxCorners corners, two fewer than corners: their indices in `corners`, in the polygon's
  // direction. Quads are cut at the shorter diagonal that is inside, larger polygons by ear clipping; they may be concave. They
  // last until the next call.
  std::span<const Triangle> cut(std::span<const Vec3> corners);

 private:
  double turn(std::size_t a, std::size_t b, std::size_t c) const;
  bool is_empty(const Triangle& ear, bool with_edges) const;

  std::vector<Eigen::Vector3d> points_;  // the corners
  Eigen::Vector3d normal_;               // of the polygon, on the side from which it runs counterclockwise
  std::vector<std::size_t> left_;
  std::vector<Triangle> triangles_;
};

}  // namespace flockstep
