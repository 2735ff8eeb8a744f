#include "world/surface_normal.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace flockstep {

using Vec3d = Eigen::Vector3d;

Vec3d surface_normal(const Primitive& primitive, const Vec3d& point) {
  const Eigen::Matrix3d rotation = primitive.rotation.cast<double>().toRotationMatrix();
  const Vec3d local = rotation.transpose() * (point - primitive.center.cast<double>());
  const Vec3d half = primitive.half_extents.cast<double>();
  if (primitive.kind == PrimitiveKind::sphere) return local.normalized();
  if (primitive.kind == PrimitiveKind::plane || primitive.kind == PrimitiveKind::disc) return rotation.col(2);
  if (primitive.kind == PrimitiveKind::capsule) {
    const double middle = half.z() - half.x();
    return rotation * (local - Vec3d(0, 0, std::clamp(local.z(), -middle, middle))).normalized();
  }
  if (primitive.kind == PrimitiveKind::cylinder) {
    const double radial = std::hypot(local.x(), local.y());
    const bool cap = std::abs(std::abs(local.z()) - half.z()) < std::abs(radial - half.x());
    const Vec3d normal = cap ? Vec3d(0, 0, std::copysign(1.0, local.z())) : Vec3d(local.x() / radial, local.y() / radial, 0);
    return rotation * normal;
  }
  int face = 0;  // face whose plane is nearest
  ((local.cwiseAbs() - half).cwiseAbs()).minCoeff(&face);
  Vec3d normal = Vec3d::Zero();
  normal[face] = std::copysign(1.0, local[face]);
  return rotation * normal;
}

Vec3d triangle_normal(const TriangleMesh& mesh, std::size_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  const auto vertex = [&](std::int32_t i) { return mesh.vertices[static_cast<std::size_t>(i)].cast<double>(); };
  const Vec3d origin = vertex(a);
  return (vertex(b) - origin).cross(vertex(c) - origin).normalized();
}

}  // namespace flockstep
