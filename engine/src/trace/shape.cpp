#include "trace/shape.hpp"

#include <algorithm>
#include <cmath>

namespace swiftlet::trace {
namespace {

Aabb bounds_of(const Primitive& primitive) {
  const Vec3& half = primitive.half_extents;
  const Mat3 rotation = primitive.rotation.toRotationMatrix();
  Vec3 reach;
  switch (primitive.kind) {
    case PrimitiveKind::sphere:
      reach = half;
      break;
    case PrimitiveKind::cylinder: {
      // A disc of radius r and normal n reaches r * sqrt(1 - n_i^2) along axis i.
      const Vec3 axis = rotation.col(2);
      for (int i = 0; i < 3; ++i) {
        reach[i] = half[0] * std::sqrt(std::max(0.0F, 1.0F - axis[i] * axis[i])) + half[2] * std::abs(axis[i]);
      }
      break;
    }
    default:
      reach = rotation.cwiseAbs() * half;
  }
  const Vec3 margin = 1e-5F * (Vec3::Ones() + primitive.center.cwiseAbs() + reach);
  return {primitive.center - reach - margin, primitive.center + reach + margin};
}

}  // namespace

Shape make_shape(const Primitive& primitive) {
  Shape shape;
  shape.kind = primitive.kind;
  shape.bounds = bounds_of(primitive);
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
