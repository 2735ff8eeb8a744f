#include "flockstep/raycast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "prepared/prepared_world.hpp"
#include "trace/tracer.hpp"
#include "world/triangle_normal.hpp"

namespace flockstep {
namespace {

using Vec3d = Eigen::Vector3d;

// Returns the outward normal of a primitive's surface at (or numerically near) a point on it.
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

template <class Holds>
void require_rows(std::span<const float> values, const char* field, const std::string& expected, const Holds& holds) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!holds(values[i])) refuse(field, expected, std::to_string(values[i]) + " in row " + std::to_string(i / 3));
  }
}

}  // namespace

RayHits raycast(const World& world, std::span<const float> origins, std::span<const float> directions, float max_range_m) {
  if (origins.size() != directions.size() || origins.size() % 3 != 0) {
    refuse("directions", "as many rows of 3 as origins (" + std::to_string(origins.size()) + " numbers)", directions.size());
  }
  require(max_range_m > 0.0F, "max_range_m", "a number > 0", max_range_m);
  require_rows(origins, "origins", in_world("finite coordinates"), [](float value) { return is_in_world(value); });
  require_rows(directions, "directions", "finite numbers", [](float value) { return std::isfinite(value); });
  const std::size_t count = origins.size() / 3;
  std::vector<Vec3> unit(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3d direction(directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]);
    const double length = direction.norm();
    if (length == 0.0) refuse("directions", "non-zero rows", "zero in row " + std::to_string(i));
    unit[i] = (direction / length).cast<float>();
  }

  RayHits hits;
  hits.t_hit.assign(count, std::numeric_limits<float>::infinity());
  hits.normal.assign(count, Vec3::Zero());
  hits.u.assign(count, 0.0F);
  hits.v.assign(count, 0.0F);
  hits.primitive.assign(count, -1);
  hits.material.assign(count, -1);
  const trace::Scene& scene = prepared(world).scene();
  const auto tracer = std::make_unique<trace::Tracer>();
  trace::RayBlock& rays = tracer->block();
  const trace::HitDetails& details = tracer->details();
  rays.near = 0.0F;
  for (std::size_t first = 0; first < count; first += trace::kMaxRays) {
    Interrupt::poll();
    rays.count = std::min(trace::kMaxRays, count - first);
    for (std::size_t i = 0; i < rays.count; ++i) {
      rays.org_x[i] = origins[3 * (first + i)];
      rays.org_y[i] = origins[3 * (first + i) + 1];
      rays.org_z[i] = origins[3 * (first + i) + 2];
      rays.dir_x[i] = unit[first + i].x();
      rays.dir_y[i] = unit[first + i].y();
      rays.dir_z[i] = unit[first + i].z();
      rays.range[i] = max_range_m;
    }
    {
      const FlushDenormals flush;
      tracer->trace_block(scene);
    }
    for (std::size_t i = 0; i < rays.count; ++i) {
      if (rays.element[i] < 0) continue;
      const std::size_t ray = first + i;
      const auto element = static_cast<std::size_t>(rays.element[i]);
      const Vec3d origin(origins[3 * ray], origins[3 * ray + 1], origins[3 * ray + 2]);
      const Vec3d direction = unit[ray].cast<double>();
      const bool is_primitive = element < world.primitives().size();
      const std::size_t triangle = element - world.primitives().size();  // for triangles
      Vec3d normal = is_primitive ? surface_normal(world.primitives()[element], origin + rays.t_hit[i] * direction)
                                  : triangle_normal(world.triangles(), triangle);
      if (normal.dot(direction) > 0.0) normal = -normal;  // surfaces are two-sided
      hits.t_hit[ray] = rays.t_hit[i];
      hits.normal[ray] = normal.cast<float>();
      if (!is_primitive) {
        hits.u[ray] = details.u[i];
        hits.v[ray] = details.v[i];
      }
      hits.primitive[ray] = rays.element[i];
      hits.material[ray] = is_primitive ? world.primitives()[element].material : world.triangles().materials[triangle];
    }
  }
  return hits;
}

}  // namespace flockstep
