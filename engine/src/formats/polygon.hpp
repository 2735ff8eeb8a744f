// Triangulates polygons of mesh files.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep {

inline constexpr std::size_t kMaxCorners = 1000;  // limit per face, because triangulation takes quadratic time

// Indices of a triangle's corners in its polygon.
using CornerTriple = std::array<std::size_t, 3>;

// Cuts a polygon of 3 to kMaxCorners corners into triangles with the polygon's orientation, two fewer than it has corners.
// Quads are cut at the shorter interior diagonal, larger polygons by ear clipping. Polygons may be concave.
std::vector<CornerTriple> cut_polygon(std::span<const Vec3> corners);

}  // namespace flockstep
