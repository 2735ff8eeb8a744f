// Rays as plain arrays, in portions small enough for the first-level cache. Sensors fill them, a Tracer traces them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "trace/frustum.hpp"

namespace flockstep::trace {

inline constexpr std::size_t kMaxRays = 256;    // of one portion
inline constexpr std::size_t kRayPadding = 16;  // whole vectors may be read and written past the last ray

using RayFloats = float[kMaxRays + kRayPadding];
using RayInts = std::int32_t[kMaxRays + kRayPadding];

// m v, summed in one order on every target: Eigen's depends on the width of its vectors.
inline Vec3 rotated(const Mat3& m, const Vec3& v) {
  const auto row = [&](int i) { return m(i, 0) * v[0] + (m(i, 1) * v[1] + m(i, 2) * v[2]); };
  return {row(0), row(1), row(2)};
}

// Rays of one sensor: they share origin and range, and their directions are the same in its frame at every pose. Distances are
// in lengths of the directions: metres along a LiDAR's unit ones; a camera's are 1 along its optical axis, which makes them
// planar depths.
struct RayBundle {
  Vec3 origin;        // m, world frame
  Mat3 rotation;      // sensor to world
  float near = 0.0F;  // a hit is in [near, range]
  float range;
  std::size_t count = 0;        // at most kMaxRays
  const float *x, *y, *z;       // (count + kRayPadding,) directions, sensor frame
  const Frustum* frustum;       // that holds them, sensor frame
  bool numbered = true;         // elements are asked for, not distances alone: for trace_direct() alone
  bool no_hits_yet = false;     // nothing was met so far, and what follows is still to be written: for mesh_tiles.hpp alone
  alignas(64) RayFloats t_hit;  // inf on a miss; written by tracing
  alignas(64) RayInts element;  // index as raycast() gives it, -1 on a miss; likewise

  Vec3 direction(std::size_t i) const { return rotated(rotation, {x[i], y[i], z[i]}); }  // world frame
};

// Rays of any origins and ranges.
struct RayBlock {
  std::size_t count = 0;
  float near = 0.0F;            // as in RayBundle, for all
  alignas(64) RayFloats org_x;  // m, world frame
  alignas(64) RayFloats org_y;
  alignas(64) RayFloats org_z;
  alignas(64) RayFloats dir_x;  // world frame
  alignas(64) RayFloats dir_y;
  alignas(64) RayFloats dir_z;
  alignas(64) RayFloats range;  // a hit is in [near, range]
  alignas(64) RayFloats t_hit;  // as in RayBundle
  alignas(64) RayInts element;
};

// What else is known of rays that have hit triangles; of the others it means nothing.
struct HitDetails {
  alignas(64) RayFloats u, v;                          // barycentric: the weights of the triangle's second and third vertex
  alignas(64) RayFloats normal_x, normal_y, normal_z;  // geometric normal of any length and side, world frame
  alignas(64) RayInts back;                            // 1 where the triangle's corners go around clockwise, as seen; else 0
};

// Which of them are asked for, beside `back`: tiles leave the others as they are.
struct AskedDetails {
  bool normals = true;
  bool weights = true;  // u and v; left out where no triangle has use for them
};

// Appends rays [first, first + count) of the bundle, with what they have hit so far. The block has room for them.
void append(const RayBundle& bundle, std::size_t first, std::size_t count, RayBlock& block);

}  // namespace flockstep::trace
