#include "sensors/beam_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/beam_targets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

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
using I = F::Int;
using Ids = Wide<hn::Rebind<std::uint16_t, F::Tag>>;
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

void at_solid(const trace::Shape& shape, const BeamRun& run, float* cosines) {
  const Vec3 offset = run.origin - Vec3(shape.center[0], shape.center[1], shape.center[2]);
  const Vec3 o = shape.aligned ? offset : trace::rotated(shape.to_local, offset);
  for (std::size_t i = 0; i < run.count; i += F::kCount) {
    const F3 in_world = rotate(run.rotation, F3::load_unaligned(run.x + i, run.y + i, run.z + i));
    const F3 direction = shape.aligned ? in_world : rotate(shape.to_local, in_world);
    const F range = F::load_first(run.count - i, run.ranges + i);
    const F3 at{o.x() + range * direction.x, o.y() + range * direction.y, o.z() + range * direction.z};
    cosine_at(shape, at, direction).store_unaligned(cosines + i);
  }
}

void at_plane(const Vec3& normal, const BeamRun& run, float* cosines) {
  for (std::size_t i = 0; i < run.count; i += F::kCount) {
    const F3 direction = rotate(run.rotation, F3::load_unaligned(run.x + i, run.y + i, run.z + i));
    abs(dot(direction, F3{normal.x(), normal.y(), normal.z()})).store_unaligned(cosines + i);
  }
}

void at_triangles(const trace::Echoes& echoes, const BeamRun& run, const std::int32_t* elements, float* cosines) {
  for (std::size_t i = 0; i < run.count; i += F::kCount) {
    const I element = I::load_first(run.count - i, elements + i);
    const I::Mask is_triangle = (element > echoes.first_triangle - 1) & (element < echoes.num_elements);
    if (none(is_triangle)) continue;
    const I triangle = value_if(is_triangle, element - echoes.first_triangle);
    const auto component = [&](const std::vector<float>& axis) HWY_ATTR { return F::gather(axis.data(), triangle); };
    const F3 normal{component(echoes.normal_x), component(echoes.normal_y), component(echoes.normal_z)};
    const F3 direction = rotate(run.rotation, F3::load_unaligned(run.x + i, run.y + i, run.z + i));
    const F before = F::load_first(run.count - i, cosines + i);
    select(is_triangle, abs(dot(direction, normal)), before).store_first(run.count - i, cosines + i);
  }
}

HWY_INLINE void write_ids(const Scan& scan, std::size_t i, I ids) {
  const std::size_t left = scan.ranges.size() - i;
  if (!scan.semantic.empty()) convert<Ids>(ids & 0xFFFF).store_first(left, scan.semantic.data() + i);
  if (!scan.instance.empty()) convert<Ids>(shift_right<16>(ids) & 0xFFFF).store_first(left, scan.instance.data() + i);
}

// The LiDAR equation of a surface that scatters light evenly (Lambert), in the units of LidarReadings. Directions are rounded.
// unread: beams that keep their ranges, and get no intensity yet.
HWY_INLINE void write_intensity(const Scan& scan, std::size_t i, F reflectance, F cosine, F::Mask unread,
                                const LeastReturn& least) {
  const std::size_t left = scan.ranges.size() - i;
  const F range = F::load_first(left, scan.ranges.data() + i);
  const F distance = max(range, 1.0F);
  const F intensity = min(reflectance * cosine / (distance * distance), 1.0F);
  select(unread, trace::HitRows::kNoCosine, intensity).store_first(left, scan.intensity.data() + i);
  if (least.cosine <= 0.0F && least.intensity <= 0.0F) return;
  const F::Mask misses = without((cosine < least.cosine) | (intensity < least.intensity), unread);
  select(misses, -range, range).store_first(left, scan.ranges.data() + i);
}

template <class Value, bool kSmall>
HWY_INLINE Value of_entries(const typename Value::T* values, I entry) {
  if constexpr (kSmall) {
    return Value::look_up(values, entry);
  } else {
    return Value::gather(values, entry);
  }
}

// kSmall: the world has so few elements that a table of two vectors holds them. Arguments are copies, because what is stored
// could be a part of them for all that the compiler knows.
template <bool kSmall>
HWY_INLINE bool read_beams(const trace::Echoes& echoes, LeastReturn least, Scan scan) {
  const I last_element = echoes.num_elements - 1;
  const std::int32_t* const ids = echoes.ids.data();
  const float* const reflectance = echoes.reflectance.data();
  F::Mask all_unread(false);
  for (std::size_t i = 0; i < scan.elements.size(); i += F::kCount) {
    const std::size_t left = scan.elements.size() - i;
    const I element = I::load_first(left, scan.elements.data() + i);
    F::Mask unread = element > last_element;
    const I entry = zero_if(unread, element + 1);
    if (!scan.semantic.empty() || !scan.instance.empty()) write_ids(scan, i, of_entries<I, kSmall>(ids, entry));
    if (!scan.intensity.empty()) {
      const F cosine = value_if(element > -1, F::load_first(left, scan.intensity.data() + i));
      unread = unread | (cosine < 0.0F);
      write_intensity(scan, i, of_entries<F, kSmall>(reflectance, entry), cosine, unread, least);
    }
    all_unread = all_unread | unread;
  }
  return !none(all_unread);
}

bool of_world(const trace::Echoes& echoes, const LeastReturn& least, const Scan& scan) {
  const bool is_small = static_cast<std::size_t>(echoes.num_elements) < 2 * F::kLanes;
  return is_small ? read_beams<true>(echoes, least, scan) : read_beams<false>(echoes, least, scan);
}

void of_run(const trace::Echo& echo, const float* cosines, const LeastReturn& least, const Scan& outputs) {
  for (std::size_t i = 0; i < outputs.ranges.size(); i += F::kCount) {
    write_ids(outputs, i, echo.ids);
    if (outputs.intensity.empty()) continue;
    write_intensity(outputs, i, echo.reflectance, F::load_unaligned(cosines + i), F::Mask(false), least);
  }
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

HWY_EXPORT(at_solid);
HWY_EXPORT(at_plane);
HWY_EXPORT(at_triangles);
HWY_EXPORT(of_world);
HWY_EXPORT(of_run);

namespace {

void at_solid(const trace::Shape& shape, const BeamRun& run, float* cosines) {
  HWY_DYNAMIC_DISPATCH(at_solid)(shape, run, cosines);
}
void at_plane(const Vec3& normal, const BeamRun& run, float* cosines) { HWY_DYNAMIC_DISPATCH(at_plane)(normal, run, cosines); }

std::size_t number_of(std::int32_t element, const trace::Bodies& among) {
  return static_cast<std::size_t>(element - among.first_element);
}

const Material& material_of(const World& world, std::size_t triangle) {
  return world.materials()[world.triangles().materials[triangle]];
}

}  // namespace

void write_triangle_cosines(const trace::Echoes& echoes, const BeamRun& run, const std::int32_t* elements, float* cosines) {
  HWY_DYNAMIC_DISPATCH(at_triangles)(echoes, run, elements, cosines);
}

bool read_world(const trace::Echoes& echoes, const LeastReturn& least, const Scan& scan) {
  return HWY_DYNAMIC_DISPATCH(of_world)(echoes, least, scan);
}

BeamTargets::BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in)
    : scene(scene_in), bodies(bodies_in), drones(drones_in) {
  bodies.shapes.first_element = scene.first_triangle() + static_cast<std::int32_t>(scene.num_triangles());
  drones.first_element = bodies.shapes.first_element + static_cast<std::int32_t>(bodies.shapes.count);
}

void BeamTargets::read(std::int32_t element, std::int32_t triangle, const BeamRun& run, const LeastReturn& least,
                       const Scan& outputs) const {
  alignas(64) trace::RayFloats cosines;
  if (!outputs.intensity.empty()) write_cosines(element, triangle, run, cosines);
  HWY_DYNAMIC_DISPATCH(of_run)(echo(element, triangle), cosines, least, outputs);
}

trace::Echo BeamTargets::echo(std::int32_t element, std::int32_t triangle) const {
  if (is_of_world(element)) return (*scene.echoes())[element];
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

void BeamTargets::write_cosines(std::int32_t element, std::int32_t triangle, const BeamRun& run,
                                trace::RayFloats& cosines) const {
  if (is_of_world(element)) return at_solid(scene.shape(static_cast<std::size_t>(element)), run, cosines);
  if (is_drone(element)) {
    const std::size_t number = number_of(element, drones);
    const float* const q = drones.quat_wxyz + 4 * number;
    const Mat3 to_drone = Quat(q[0], q[1], q[2], q[3]).toRotationMatrix().transpose();
    const Vec3 origin = trace::rotated(to_drone, run.origin - Vec3::Map(drones.position + 3 * number));
    for (std::size_t i = 0; i < run.count; ++i) {
      const Vec3 direction = trace::rotated(to_drone, trace::rotated(run.rotation, {run.x[i], run.y[i], run.z[i]}));
      cosines[i] = std::abs(drones.common_hull->normal_at(origin + run.ranges[i] * direction).dot(direction));
    }
    return;
  }
  const std::size_t number = number_of(element, bodies.shapes);
  if (bodies.shapes.mesh(number) == nullptr) {
    return at_solid(trace::make_shape(trace::posed_solid(bodies.shapes, number)), run, cosines);
  }
  const trace::PosedMesh mesh = trace::posed_mesh(bodies.shapes, number);
  const Vec3 normal = triangle_normal(mesh.scene->world().triangles(), static_cast<std::size_t>(triangle)).cast<float>();
  at_plane(trace::rotated(mesh.to_local.transpose(), normal), run, cosines);
}

}  // namespace flockstep::sensors
#endif
