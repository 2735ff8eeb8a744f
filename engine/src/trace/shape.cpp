#include "trace/shape.hpp"

#include "world/scene_description.hpp"

namespace flockstep::trace {

ShapeKind shape_kind_of(PrimitiveKind kind) {
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

Shape make_shape(const Primitive& primitive) {
  Shape shape;
  shape.kind = shape_kind_of(primitive.kind);
  const Aabb box = bounds(primitive);
  shape.box_center = 0.5F * (box.min + box.max);
  shape.box_half = 0.5F * (box.max - box.min) + 1e-5F * (Vec3::Ones() + box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs()));
  shape.aligned = primitive.rotation.coeffs() == Quat::Identity().coeffs();
  shape.to_local = primitive.rotation.toRotationMatrix().transpose();
  for (int axis = 0; axis < 3; ++axis) {
    shape.center[axis] = primitive.center[axis];
    shape.half_extents[axis] = primitive.half_extents[axis];
  }
  return shape;
}

}  // namespace flockstep::trace
