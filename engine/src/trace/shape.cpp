#include "trace/shape.hpp"

#include "world/scene_description.hpp"

namespace swiftlet::trace {
namespace {

// Wider than the shape, so that no rounding hides a hit.
Aabb widened(const Aabb& box) {
  const Vec3 margin = 1e-5F * (Vec3::Ones() + box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs()));
  return {box.min - margin, box.max + margin};
}

ShapeKind kind_of(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::cylinder:
    case PrimitiveKind::disc:
      return ShapeKind::cylinder;
    case PrimitiveKind::capsule:
      return ShapeKind::capsule;
    case PrimitiveKind::sphere:
      return ShapeKind::sphere;
    default:  // room, box, plane
      return ShapeKind::box;
  }
}

}  // namespace

Shape make_shape(const Primitive& primitive) {
  Shape shape;
  shape.kind = kind_of(primitive.kind);
  shape.bounds = widened(bounds(primitive));
  shape.aligned = primitive.rotation.coeffs() == Quat::Identity().coeffs();
  const Mat3 to_local = primitive.rotation.toRotationMatrix().transpose();
  for (int row = 0; row < 3; ++row) {
    shape.center[row] = primitive.center[row];
    shape.half_extents[row] = primitive.half_extents[row];
    for (int column = 0; column < 3; ++column) shape.to_local[3 * row + column] = to_local(row, column);
  }
  return shape;
}

}  // namespace swiftlet::trace
