// Shape: a primitive as the ray kernels want it, its rotation as a matrix.
#pragma once

#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep::trace {

// A convex solid. A plane is a box, a disc a cylinder of no thickness; a room is a box seen from within.
enum class ShapeKind : std::uint8_t { box, cylinder, capsule, sphere };

struct Shape {
  ShapeKind kind = ShapeKind::box;
  bool aligned = true;                // the rotation is the identity: the kernels skip it
  float center[3] = {0, 0, 0};        // m, world frame
  float half_extents[3] = {0, 0, 0};  // m, as in Primitive
  // m, world frame: the bounding box, a little wider than the shape, so that no rounding hides a hit
  Vec3 box_center, box_half;
  Mat3 to_local = Mat3::Identity();  // rotation, world to local; seldom asked for, so that the others share a cache line

  Aabb bounds() const { return {box_center - box_half, box_center + box_half}; }
};

// A shape and its index into World::primitives().
struct alignas(64) NumberedShape {
  Shape shape;
  std::int32_t element;
};

Shape make_shape(const Primitive& primitive);

}  // namespace flockstep::trace
