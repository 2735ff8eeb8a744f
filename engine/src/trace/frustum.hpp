// Frustum: four half spaces that hold whatever a set of directions can reach.
#pragma once

#include <array>
#include <span>

#include "flockstep/pose.hpp"

namespace flockstep::trace {

// All points p that rays of these directions reach within a range R satisfy n . p <= R * reach for each of the four normals n.
// A narrow set (all within 80 degrees of their mean) has the sides of a pyramid, reach 0; a wide one, like a fan, the two planes
// above and below it. Both exact up to rounding, for which `reach` has a margin.
struct Frustum {
  static constexpr std::size_t kPlanes = 4;
  alignas(16) std::array<float, kPlanes> x, y, z;  // unit normals; zero where there is no plane
  alignas(16) std::array<float, kPlanes> reach;    // in units of the range
};

// Of unit directions, in their frame.
Frustum make_frustum(std::span<const float> x, std::span<const float> y, std::span<const float> z);

// Of the directions (1, y, z) with y in [left_min, left_max] and z in [up_min, up_max].
Frustum make_pyramid(float left_min, float left_max, float up_min, float up_max);

}  // namespace flockstep::trace
