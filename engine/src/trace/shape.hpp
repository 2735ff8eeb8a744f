// Shape: a primitive in the form that the ray kernels use, with its rotation as a matrix.
#pragma once

#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep::trace {

// A convex solid. A plane is a flat box, a disc is a flat cylinder, and a room is a box seen from inside.
enum class ShapeKind : std::uint8_t { box, cylinder, capsule, sphere };

struct Shape {
  ShapeKind kind = ShapeKind::box;
  bool aligned = true;                // the rotation is the identity and is skipped
  float center[3] = {0, 0, 0};        // m, world frame
  float half_extents[3] = {0, 0, 0};  // m, as in Primitive
  // m, world frame; the bounding box, slightly wider than the shape so that rounding does not hide a hit
  Vec3 box_center, box_half;
  Mat3 to_local = Mat3::Identity();  // rotation, world to local; rarely read: the fields above share a cache line

  Aabb bounds() const { return {box_center - box_half, box_center + box_half}; }
};

// A shape and its index into World::primitives().
struct alignas(64) NumberedShape {
  Shape shape;
  std::int32_t element;
};

ShapeKind shape_kind_of(PrimitiveKind kind);
Shape make_shape(const Primitive& primitive);

}  // namespace flockstep::trace
