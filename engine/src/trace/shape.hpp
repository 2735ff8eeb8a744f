// Shape: a primitive as the ray kernels want it, its rotation as a matrix.
#pragma once

#include <span>
#include <vector>

#include "swiftlet/world.hpp"

namespace swiftlet::trace {

struct Shape {
  PrimitiveKind kind = PrimitiveKind::box;
  bool aligned = true;                // the rotation is the identity: the kernels skip it
  float center[3] = {0, 0, 0};        // m, world frame
  float to_local[9] = {};             // row-major rotation, world to local
  float half_extents[3] = {0, 0, 0};  // m, as in Primitive
  Aabb bounds;                        // m, world frame; a little wider than the shape, so that no rounding hides a hit
};

Shape make_shape(const Primitive& primitive);

}  // namespace swiftlet::trace
