// The faces of the convex hull of some points.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep {

struct HullFace {
  Eigen::Vector3d normal;            // unit, outwards
  double offset;                     // m; no point p of the hull has normal . p > offset
  std::vector<std::size_t> corners;  // numbers of points, counter-clockwise seen from outside
};

// Returns at most `most` faces (at least 60). Together they bound the hull, up to a millionth of its size: faces that lie within
// this of one plane are one face. points: of a valid DroneModel.
std::vector<HullFace> hull_faces(std::span<const Vec3> points, std::size_t most);

}  // namespace flockstep
