// Normals of surfaces, in double precision.
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "flockstep/world.hpp"

namespace flockstep {

// Returns the outward unit normal of a primitive's surface at (or numerically near) a point on it.
Eigen::Vector3d surface_normal(const Primitive& primitive, const Eigen::Vector3d& point);

// Returns the unit normal of a triangle, towards the side from which its corners appear counterclockwise.
Eigen::Vector3d triangle_normal(const TriangleMesh& mesh, std::size_t triangle);

}  // namespace flockstep
