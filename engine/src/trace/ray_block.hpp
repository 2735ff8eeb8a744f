// Rays as plain arrays, in blocks small enough for the first-level cache. Sensors fill them, a Tracer traces them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "trace/frustum.hpp"

namespace flockstep::trace {

inline constexpr std::size_t kMaxRays = 256;    // in one bundle or block
inline constexpr std::size_t kRayPadding = 16;  // vectors may read and write this far past the last ray

using RayFloats = float[kMaxRays + kRayPadding];
using RayInts = std::int32_t[kMaxRays + kRayPadding];

// Returns m v, summed in the same order on every target: Eigen's order depends on its vector width.
inline Vec3 rotated(const Mat3& m, const Vec3& v) {
  const auto row = [&](int i) { return m(i, 0) * v[0] + (m(i, 1) * v[1] + m(i, 2) * v[2]); };
  return {row(0), row(1), row(2)};
}

// Rays of one sensor. They share origin and range, and their directions are fixed in the sensor's frame. Distances are in
// lengths of the directions. A LiDAR's directions are unit vectors, so its distances are metres. A camera's directions are 1
// along its optical axis, so its distances are planar depths.
struct RayBundle {
  Vec3 origin;        // m, world frame
  Mat3 rotation;      // sensor to world
  float near = 0.0F;  // hits are in [near, range]
  float range;
  std::size_t count = 0;        // at most kMaxRays
  const float *x, *y, *z;       // (count + kRayPadding,) directions, sensor frame
  const Frustum* frustum;       // contains the directions, sensor frame
  bool numbered = true;         // elements are needed, not only distances; read by trace_direct() only
  bool has_cosines = false;     // cosines are needed, too, and directions are unit; read by trace_direct() only
  bool is_rectangle = false;    // directions (1, u, v) of a grid with rows of 16: all lie between its four corners
  bool no_hits_yet = false;     // no hits so far, t_hit and element are uninitialised; read by mesh_tiles.hpp only
  alignas(64) RayFloats t_hit;  // inf on a miss; written by tracing
  alignas(64) RayInts element;  // index as in raycast(), -1 on a miss; written by tracing
  // Of the angles to the normals of solids, if it has them; those of other hits and of misses mean nothing.
  alignas(64) RayFloats cosine;

  Vec3 direction(std::size_t i) const { return rotated(rotation, {x[i], y[i], z[i]}); }  // world frame
};

// Rays of arbitrary origins and ranges.
struct RayBlock {
  std::size_t count = 0;
  float near = 0.0F;            // as in RayBundle, for all rays
  alignas(64) RayFloats org_x;  // m, world frame
  alignas(64) RayFloats org_y;
  alignas(64) RayFloats org_z;
  alignas(64) RayFloats dir_x;  // world frame
  alignas(64) RayFloats dir_y;
  alignas(64) RayFloats dir_z;
  alignas(64) RayFloats range;  // hits are in [near, range]
  alignas(64) RayFloats t_hit;  // as in RayBundle
  alignas(64) RayInts element;
};

// Details of hits on triangles; meaningless for other rays.
struct HitDetails {
  alignas(64) RayFloats u, v;                          // barycentric weights of the triangle's second and third vertex
  alignas(64) RayFloats normal_x, normal_y, normal_z;  // geometric normal of any length and either sign, world frame
  alignas(64) RayInts back;                            // 1 if the triangle's corners appear clockwise, else 0
  alignas(64) RayInts triangle;                        // its number in the mesh of a body; only for such hits, whose normal is
                                                       // in the body's frame
};

// The details to write, in addition to `back`. Tiles leave the others unchanged.
struct AskedDetails {
  bool normals = true;
  bool weights = true;  // u and v; skipped if no triangle needs them
};

// Appends rays [first, first + count) of the bundle, with their hits so far. The block must have room for them.
void append(const RayBundle& bundle, std::size_t first, std::size_t count, RayBlock& block);

}  // namespace flockstep::trace
