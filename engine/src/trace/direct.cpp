#include "trace/direct.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/direct.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <limits>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kMinCulled = 4;  // candidates; to look whether fewer are in view costs as much as to test them

// A hit at the range itself counts, at infinity none does.
template <class D, class Found, class V = hn::Vec<D>>
HWY_INLINE void store(D d, const Found& nearest, V range, float* t_hit, std::int32_t* element) {
  const hn::RebindToSigned<D> di;
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const V metres = nearest.metres();
  const auto hit = hn::And(hn::Le(metres, range), hn::Lt(metres, infinity));
  hn::Store(hn::IfThenElse(hit, metres, infinity), d, t_hit);
  hn::Store(hn::IfThenElse(hn::RebindMask(di, hit), nearest.element, hn::Set(di, -1)), di, element);
}

// The ray leaves the room through the first of the walls ahead. Those out of reach are left out.
template <class D, bool kNumbered, class V = hn::Vec<D>>
HWY_INLINE void leave_room(D d, const Candidate& room, const Vec3V<V>& o, const Vec3V<V>& direction,
                           Nearest<D, kNumbered>& nearest) {
  const float* const half = room.shape->half_extents;
  Fraction<V> first{hn::Set(d, std::numeric_limits<float>::infinity()), hn::Set(d, 1.0F)};
  if (room.walls[0]) first = earlier(first, slab_exit(d, o.x, direction.x, half[0]));
  if (room.walls[1]) first = earlier(first, slab_exit(d, o.y, direction.y, half[1]));
  if (room.walls[2]) first = earlier(first, slab_exit(d, o.z, direction.z, half[2]));
  nearest.take(d, first, hn::Lt(first.num, hn::Set(d, std::numeric_limits<float>::infinity())), room.element);
}

// The candidates whose bounding boxes are in view: of a box, the point farthest against a normal n lies at n . centre - |n| .
// half. Their number, or max_seen + 1 if there are more than max_seen.
std::size_t select_seen(std::span<const Candidate> candidates, std::size_t max_seen, const RayBundle& rays,
                        const Candidate** seen) {
  const hn::CappedTag<float, Frustum::kPlanes> d;
  using V = hn::Vec<decltype(d)>;
  alignas(16) float x[Frustum::kPlanes], y[Frustum::kPlanes], z[Frustum::kPlanes], reach[Frustum::kPlanes];  // world frame
  for (std::size_t i = 0; i < Frustum::kPlanes; i += hn::Lanes(d)) {
    const Frustum& frustum = *rays.frustum;
    const Vec3V<V> normal =
        rotate(d, rays.rotation,
               {hn::Load(d, frustum.x.data() + i), hn::Load(d, frustum.y.data() + i), hn::Load(d, frustum.z.data() + i)});
    hn::Store(normal.x, d, x + i);
    hn::Store(normal.y, d, y + i);
    hn::Store(normal.z, d, z + i);
    hn::Store(hn::Mul(hn::Set(d, rays.range), hn::Load(d, frustum.reach.data() + i)), d, reach + i);
  }
  std::size_t count = 0;
  for (const Candidate& candidate : candidates) {
    const Vec3 center = candidate.shape->box_center - rays.origin;
    const Vec3& half = candidate.shape->box_half;
    bool hidden = false;
    for (std::size_t i = 0; i < Frustum::kPlanes; i += hn::Lanes(d)) {
      const auto along = [&](int axis, const float* normal) HWY_ATTR {
        const V n = hn::Load(d, normal + i);
        return hn::Sub(hn::Mul(n, hn::Set(d, center[axis])), hn::Mul(hn::Abs(n), hn::Set(d, half[axis])));
      };
      const V nearest = hn::Add(hn::Add(along(0, x), along(1, y)), along(2, z));
      hidden |= !hn::AllFalse(d, hn::Gt(nearest, hn::Load(d, reach + i)));
    }
    if (hidden) continue;
    if (count == max_seen) return max_seen + 1;
    seen[count++] = &candidate;
  }
  return count;
}

// A candidate met by one vector of rays.
template <class D, bool kNumbered, class V = hn::Vec<D>>
HWY_INLINE void meet(D d, const Candidate& candidate, const Vec3V<V>& direction, V near, Nearest<D, kNumbered>& nearest) {
  const Shape& shape = *candidate.shape;
  const auto& local = candidate.local_origin;
  const Vec3V<V> o{hn::Set(d, local[0]), hn::Set(d, local[1]), hn::Set(d, local[2])};
  if (candidate.hint == OriginHint::in_room) {
    leave_room(d, candidate, o, direction, nearest);
    return;
  }
  const Vec3V<V> dir = shape.aligned ? direction : rotate(d, shape.to_local, direction);
  if (candidate.hint == OriginHint::beside_cylinder) {
    const auto entry = cylinder_side(d, o, dir, shape.half_extents[0], shape.half_extents[2]);
    if (!hn::AllFalse(d, entry.valid)) nearest.take(d, entry.at, entry.valid, candidate.element);
  } else if (candidate.hint == OriginHint::outside_marker) {
    nearest.meet_front(d, sphere_interval(d, o, dir, shape.half_extents[0]), candidate.element, near);
  } else {
    nearest.meet(d, interval(d, shape, o, dir), candidate.element, near);
  }
}

template <bool kNumbered>
void meet_all(std::span<const Candidate* const> seen, RayBundle& rays) {
  using D = hn::CappedTag<float, kRayPadding>;
  using V = hn::Vec<D>;
  const D d;
  const V near = hn::Set(d, rays.near);
  const V range = hn::Set(d, rays.range);
  for (std::size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
    const Vec3V<V> direction =
        rotate(d, rays.rotation, {hn::LoadU(d, rays.x + i), hn::LoadU(d, rays.y + i), hn::LoadU(d, rays.z + i)});
    Nearest<D, kNumbered> nearest(d);
    for (const Candidate* const candidate : seen) meet(d, *candidate, direction, near, nearest);
    store(d, nearest, range, rays.t_hit + i, rays.element + i);
  }
}

bool trace_bundle(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays) {
  const Candidate* seen[kMaxCandidates];
  std::size_t count = candidates.size();
  if (count <= kMinCulled) {
    for (std::size_t i = 0; i < count; ++i) seen[i] = &candidates[i];
  } else {
    count = select_seen(candidates, max_seen, rays, seen);
    if (count > max_seen) return false;
  }
  rays.numbered ? meet_all<true>({seen, count}, rays) : meet_all<false>({seen, count}, rays);
  return true;
}

// For each vector of rays, meet(nearest, origin, direction).
template <class Meet>
void trace_block(RayBlock& rays, const Meet& meet) {
  const hn::CappedTag<float, kRayPadding> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  for (std::size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
    const Vec3V<V> origin{hn::Load(d, rays.org_x + i), hn::Load(d, rays.org_y + i), hn::Load(d, rays.org_z + i)};
    const Vec3V<V> direction{hn::Load(d, rays.dir_x + i), hn::Load(d, rays.dir_y + i), hn::Load(d, rays.dir_z + i)};
    Nearest nearest(d, hn::Load(d, rays.t_hit + i), hn::Load(di, rays.element + i));
    meet(nearest, origin, direction);
    store(d, nearest, hn::Load(d, rays.range + i), rays.t_hit + i, rays.element + i);
  }
}

void trace_shapes(std::span<const NumberedShape> shapes, RayBlock& rays) {
  const hn::CappedTag<float, kRayPadding> d;
  const auto near = hn::Set(d, rays.near);
  trace_block(rays, [&](auto& nearest, const auto& origin, const auto& direction) HWY_ATTR {
    for (const auto& [shape, element] : shapes) nearest.meet(d, world_interval(d, shape, origin, direction), element, near);
  });
}

void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays) {
  const hn::CappedTag<float, kRayPadding> d;
  const auto near = hn::Set(d, rays.near);
  trace_block(rays, [&](auto& nearest, const auto& origin, const auto& direction) HWY_ATTR {
    for (const auto& [shape, element] : markers)
      nearest.meet_front(d, world_interval(d, shape, origin, direction), element, near);
  });
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_bundle);
HWY_EXPORT(trace_shapes);
HWY_EXPORT(trace_markers);

bool trace_direct(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays) {
  return HWY_DYNAMIC_DISPATCH(trace_bundle)(candidates, max_seen, rays);
}

void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_shapes)(shapes, rays); }
void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_markers)(markers, rays); }

}  // namespace flockstep::trace
#endif
