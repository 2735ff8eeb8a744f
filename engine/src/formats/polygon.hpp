// Polygons of mesh files.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep {

inline constexpr std::size_t kMaxCorners = 1000;  // of a face: cutting it into triangles takes their number squared

// Indices of a triangle's corners among those of its polygon.
using CornerTriple = std::array<std::size_t, 3>;

// Cuts a polygon of 3 to kMaxCorners corners into triangles, two fewer than corners, which run in the polygon's direction. Quads
// are cut at the shorter diagonal that is inside, larger polygons by ear clipping. They may be concave.
std::vector<CornerTriple> cut_polygon(std::span<const Vec3> corners);

}  // namespace flockstep
