// Rays as plain arrays, in portions small enough for the first-level cache. Sensors fill them, a Scene traces them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "swiftlet/pose.hpp"

namespace swiftlet::trace {

inline constexpr std::size_t kMaxRays = 256;   // of one portion
inline constexpr std::size_t kRayPadding = 16;  // whole vectors may be read and written past the last ray

using RayFloats = float[kMaxRays + kRayPadding];
using RayInts = std::int32_t[kMaxRays + kRayPadding];

// Rays that share their origin and range.
struct RayBundle {
  std::size_t count = 0;
  Vec3 origin;                // m, world frame
  float range;                // m; a hit is in [0, range]
  alignas(64) RayFloats dir_x;  // unit, world frame
  alignas(64) RayFloats dir_y;
  alignas(64) RayFloats dir_z;
  alignas(64) RayFloats t_hit;  // m, inf on a miss; written by Scene::intersect
  alignas(64) RayInts element;  // index as World::raycast gives it, -1 on a miss; likewise
};

// Rays of any origins and ranges.
struct RayBlock {
  std::size_t count = 0;
  alignas(64) RayFloats org_x;  // m, world frame
  alignas(64) RayFloats org_y;
  alignas(64) RayFloats org_z;
  alignas(64) RayFloats dir_x;  // unit, world frame
  alignas(64) RayFloats dir_y;
  alignas(64) RayFloats dir_z;
  alignas(64) RayFloats range;  // m; a hit is in [0, range]
  alignas(64) RayFloats t_hit;  // m, inf on a miss; as in RayBundle
  alignas(64) RayInts element;
};

}  // namespace swiftlet::trace
