// Frustum: four half spaces that contain every point reachable along a set of directions.
#pragma once

#include <array>
#include <span>

#include "flockstep/pose.hpp"

namespace flockstep::trace {

// Every point p that rays of these directions reach within a range R satisfies n . p <= R * reach for each of the four normals
// n. A narrow set (all directions within 80 degrees of their mean) has the sides of a pyramid, with reach 0. A wide set, such
// as a fan, has the two planes above and below it. Both are exact up to rounding; `reach` includes a margin for that.
struct Frustum {
  static constexpr std::size_t kPlanes = 4;
  alignas(16) std::array<float, kPlanes> x, y, z;  // unit normals; zero for an unused plane
  alignas(16) std::array<float, kPlanes> reach;    // in units of the range
};

// Returns the frustum of unit directions, in their frame.
Frustum make_frustum(std::span<const float> x, std::span<const float> y, std::span<const float> z);

// Returns the frustum of the directions (1, y, z) with y in [left_min, left_max] and z in [up_min, up_max].
Frustum make_pyramid(float left_min, float left_max, float up_min, float up_max);

}  // namespace flockstep::trace
