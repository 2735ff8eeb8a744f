// The normal of a triangle, in double precision.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep {

// Returns the unit normal towards the side from which the corners appear counterclockwise; 0 if they lie on a line.
inline Eigen::Vector3d triangle_normal(const TriangleMesh& mesh, std::size_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  const auto vertex = [&](std::int32_t i) { return mesh.vertices[static_cast<std::size_t>(i)].cast<double>(); };
  const Eigen::Vector3d origin = vertex(a);
  return (vertex(b) - origin).cross(vertex(c) - origin).normalized();
}

}  // namespace flockstep
