#include "trace/hulls.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "world/hull_faces.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/hulls.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;

using HullRays = WideUpTo<kRayPadding>;
using HullRays3 = Wide3<HullRays>;

constexpr float kFarthest = std::numeric_limits<float>::infinity();

// The planes of a hull as seen from the origin of the rays: n / (offset - n . origin), with n in the world frame. The dot product
// with a direction is the inverse of the distance at which a ray crosses the plane.
struct SeenPlanes {
  alignas(64) float x[HullPlanes::kMost], y[HullPlanes::kMost], z[HullPlanes::kMost];
  std::uint64_t front;  // planes with the origin outside, one bit for each
  std::uint64_t back;   // the others

  // origin: m, from the hull's position.
  HWY_INLINE void see(const HullPlanes& planes, const Vec3& origin, const Mat3& to_world) {
    using F = WideUpTo<16>;
    front = 0;
    const Wide3<F> o{origin.x(), origin.y(), origin.z()};
    for (std::size_t i = 0; i < planes.count; i += F::kCount) {
      const Wide3<F> normal = rotate(to_world, Wide3<F>::load(planes.x.data() + i, planes.y.data() + i, planes.z.data() + i));
      const F inside = F::load(planes.offset.data() + i) - dot(normal, o);  // m, distance of the origin
      constexpr float kLeast = 1e-30F;                                      // from a plane; its inverse is finite
      const F inverse = F(1.0F) / select(abs(inside) < kLeast, F(kLeast), inside);
      (normal * inverse).store(x + i, y + i, z + i);
      front |= std::uint64_t{bits(inside <= -kLeast)} << i;
    }
    const std::uint64_t all = planes.count == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << planes.count) - 1;
    back = all & ~front;
    front &= all;
  }

  HWY_INLINE HullRays along(std::size_t plane, const HullRays3& direction) const {
    return dot(HullRays3{x[plane], y[plane], z[plane]}, direction);
  }

  // A ray enters the hull at its last crossing of a front plane, and leaves it at its first crossing of a back plane.
  HWY_INLINE void meet(const HullRays3& direction, std::int32_t number, HullRays near, HullRays range, float* t_hit,
                       std::int32_t* element) const {
    HullRays enter = kFarthest, leave = 0.0F;  // inverse distances
    for (std::uint64_t left = front; left != 0; left &= left - 1) {
      enter = min(enter, along(static_cast<std::size_t>(std::countr_zero(left)), direction));
    }
    if (none(enter > 0.0F)) return;
    for (std::uint64_t left = back; left != 0; left &= left - 1) {
      leave = max(leave, along(static_cast<std::size_t>(std::countr_zero(left)), direction));
    }
    const HullRays::Mask starts_outside(front != 0);
    const HullRays enter_m = HullRays(1.0F) / enter, leave_m = HullRays(1.0F) / leave;
    const HullRays hit = select(starts_outside & (enter_m >= near), enter_m, leave_m);
    const HullRays before = HullRays::load(t_hit);
    const HullRays::Mask valid =
        (enter > 0.0F) & (enter >= leave) & (hit >= near) & (hit <= range) & (hit < before);
    if (none(valid)) return;
    select(valid, hit, before).store(t_hit);
    select(valid, HullRays::Int(number), HullRays::Int::load(element)).store(element);
  }
};

// The directions of a bundle in the world frame, and their squared lengths.
struct WorldDirections {
  alignas(64) RayFloats x, y, z, squared;

  HWY_INLINE void compute(const RayBundle& rays) {
    for (std::size_t i = 0; i < rays.count; i += HullRays::kCount) {
      const HullRays3 direction = rotate(rays.rotation, HullRays3::load_unaligned(rays.x + i, rays.y + i, rays.z + i));
      direction.store(x + i, y + i, z + i);
      dot(direction, direction).store(squared + i);
    }
  }
};

void meet_hulls(std::span<const PosedHull> hulls, RayBundle& rays) {
  using Planes = WideOf<Frustum::kPlanes>;
  const Frustum& frustum = *rays.frustum;
  const Wide3<Planes> normal = rotate(rays.rotation, Wide3<Planes>::load(frustum.x.data(), frustum.y.data(), frustum.z.data()));
  const Planes reach = rays.range * Planes::load(frustum.reach.data());
  const HullRays near = rays.near, range = rays.range;
  WorldDirections directions;
  SeenPlanes planes;
  bool has_directions = false;
  for (const PosedHull& hull : hulls) {
    const Vec3 center = hull.position - rays.origin;
    const float squared = center.squaredNorm();
    const float radius = hull.radius * 1.0001F + 1e-5F * (hull.radius + std::sqrt(squared));  // wider than rounding errors
    const Wide3<Planes> to_center{center.x(), center.y(), center.z()};
    if (!none(dot(normal, to_center) - radius > reach)) continue;
    const float least = squared - radius * radius;  // <= 0: the origin is in the ball
    if (!has_directions) directions.compute(rays);
    has_directions = true;
    bool has_planes = false;
    for (std::size_t i = 0; i < rays.count; i += HullRays::kCount) {
      const HullRays3 direction = HullRays3::load(directions.x + i, directions.y + i, directions.z + i);
      if (least > 0.0F) {
        const HullRays along = dot(HullRays3{center.x(), center.y(), center.z()}, direction);
        const HullRays enough = HullRays(least) * HullRays::load(directions.squared + i);
        if (none((along > 0.0F) & (along * along * (1.0F + 1e-5F) >= enough))) continue;
      }
      if (!has_planes) planes.see(*hull.planes, -center, hull.rotation.toRotationMatrix());
      has_planes = true;
      planes.meet(direction, hull.element, near, range, rays.t_hit + i, rays.element + i);
    }
  }
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(meet_hulls);

HullPlanes::HullPlanes(std::span<const Vec3> points) {
  const std::vector<HullFace> faces = hull_faces(points, kMost);
  count = faces.size();
  offset.fill(1.0F);
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = static_cast<float>(faces[i].normal.x());
    y[i] = static_cast<float>(faces[i].normal.y());
    z[i] = static_cast<float>(faces[i].normal.z());
    offset[i] = static_cast<float>(faces[i].offset);
  }
}

void trace_hulls(std::span<const PosedHull> hulls, RayBundle& rays) { HWY_DYNAMIC_DISPATCH(meet_hulls)(hulls, rays); }

}  // namespace flockstep::trace
#endif
