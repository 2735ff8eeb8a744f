#include "sensors/beam_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/beam_targets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "base/wide-inl.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "trace/normals-inl.hpp"
#include "world/triangle_normal.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type
using namespace flockstep::trace::HWY_NAMESPACE;

using F = WideUpTo<trace::kRayPadding>;
using F3 = Wide3<F>;

// Returns the magnitude of the cosine at a point of a solid. direction: unit, in the solid's frame like the point.
HWY_INLINE F cosine_at(const trace::Shape& shape, const F3& at, const F3& direction) {
  if (shape.kind == trace::ShapeKind::box) {
    const auto [y_over_x, z_over_xy] = nearest_face(shape, at);
    return abs(select(z_over_xy, direction.z, select(y_over_x, direction.y, direction.x)));
  }
  const F cosine = abs(dot(outward_normal(shape, at), direction));
  return shape.kind == trace::ShapeKind::cylinder ? select(is_on_cap(shape, at), abs(direction.z), cosine) : cosine;
}

void at_solid(const trace::Shape& shape, const trace::BeamHits& hits, float* cosines) {
  const Vec3 offset = hits.origin - Vec3(shape.center[0], shape.center[1], shape.center[2]);
  const Vec3 o = shape.aligned ? offset : trace::rotated(shape.to_local, offset);
  for (std::size_t i = 0; i < hits.count; i += F::kCount) {
    const F3 in_world = rotate(hits.rotation, F3::load_unaligned(hits.x + i, hits.y + i, hits.z + i));
    const F3 direction = shape.aligned ? in_world : rotate(shape.to_local, in_world);
    const F range = F::load_first(hits.count - i, hits.ranges + i);
    const F3 at{o.x() + range * direction.x, o.y() + range * direction.y, o.z() + range * direction.z};
    cosine_at(shape, at, direction).store_unaligned(cosines + i);
  }
}

void at_plane(const Vec3& normal, const trace::BeamHits& hits, float* cosines) {
  for (std::size_t i = 0; i < hits.count; i += F::kCount) {
    const F3 direction = rotate(hits.rotation, F3::load_unaligned(hits.x + i, hits.y + i, hits.z + i));
    abs(dot(direction, F3{normal.x(), normal.y(), normal.z()})).store_unaligned(cosines + i);
  }
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

HWY_EXPORT(at_solid);
HWY_EXPORT(at_plane);

namespace {

void at_solid(const trace::Shape& shape, const trace::BeamHits& hits, float* cosines) {
  HWY_DYNAMIC_DISPATCH(at_solid)(shape, hits, cosines);
}
void at_plane(const Vec3& normal, const trace::BeamHits& hits, float* cosines) {
  HWY_DYNAMIC_DISPATCH(at_plane)(normal, hits, cosines);
}

std::size_t number_of(std::int32_t element, const trace::Bodies& among) {
  return static_cast<std::size_t>(element - among.first_element);
}

const Material& material_of(const World& world, std::size_t triangle) {
  return world.materials()[world.triangles().materials[triangle]];
}

}  // namespace

void BeamTargets::read(const trace::BeamHits& hits, const trace::EchoRows& to) const {
  const trace::Echoes& echoes = *scene->echoes();
  const auto is_unread = [&](std::size_t beam) { return echoes.needs_closer_look(hits, beam, to.needs_cosines); };
  for (std::size_t row = 0; row < hits.count; row += to.width) {
    for (std::size_t beam = row, end; beam < row + to.width; beam = end) {  // neighbours mostly hit the same
      const std::int32_t element = hits.elements[beam], triangle = hits.triangles[beam];
      end = beam + 1;
      if (!is_unread(beam)) continue;
      while (end < row + to.width && hits.elements[end] == element && hits.triangles[end] == triangle && is_unread(end)) ++end;
      const trace::BeamHits same = hits.part(beam, end - beam);
      alignas(64) trace::RayFloats cosines;
      if (to.needs_cosines) write_cosines(element, triangle, same, cosines);
      trace::write_echo(echo(element, triangle), cosines, same, to.part(beam, end - beam));
    }
  }
}

trace::Echo BeamTargets::echo(std::int32_t element, std::int32_t triangle) const {
  if (is_of_world(element)) return (*scene->echoes())[element];
  if (is_drone(element)) {
    return trace::echo_of(render::kHullColor, kSemanticDrone,
                          static_cast<std::uint16_t>(kFirstDroneInstance + number_of(element, drones)));
  }
  const std::size_t number = number_of(element, bodies.shapes);
  const render::BodySurface& body = bodies.surface(number);
  return trace::echo_of(
      body.mesh == nullptr ? body.color : material_of(**body.mesh, static_cast<std::size_t>(triangle)).base_color, body.semantic,
      bodies.instance(number));
}

void BeamTargets::write_cosines(std::int32_t element, std::int32_t triangle, const trace::BeamHits& hits,
                                trace::RayFloats& cosines) const {
  if (is_of_world(element)) return at_solid(scene->shape(static_cast<std::size_t>(element)), hits, cosines);
  if (is_drone(element)) {
    const std::size_t number = number_of(element, drones);
    const float* const q = drones.quat_wxyz + 4 * number;
    const Mat3 to_drone = Quat(q[0], q[1], q[2], q[3]).toRotationMatrix().transpose();
    const Vec3 origin = trace::rotated(to_drone, hits.origin - Vec3::Map(drones.position + 3 * number));
    for (std::size_t i = 0; i < hits.count; ++i) {
      const Vec3 direction = trace::rotated(to_drone, trace::rotated(hits.rotation, {hits.x[i], hits.y[i], hits.z[i]}));
      cosines[i] = std::abs(drones.common_hull->normal_at(origin + hits.ranges[i] * direction).dot(direction));
    }
    return;
  }
  const std::size_t number = number_of(element, bodies.shapes);
  if (bodies.shapes.mesh(number) == nullptr) {
    return at_solid(trace::make_shape(trace::posed_solid(bodies.shapes, number)), hits, cosines);
  }
  const trace::PosedMesh mesh = trace::posed_mesh(bodies.shapes, number);
  const Vec3 normal = triangle_normal(mesh.scene->world().triangles(), static_cast<std::size_t>(triangle)).cast<float>();
  at_plane(trace::rotated(mesh.to_local.transpose(), normal), hits, cosines);
}

}  // namespace flockstep::sensors
#endif
