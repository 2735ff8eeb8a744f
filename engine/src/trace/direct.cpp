#include "trace/direct.hpp"

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/direct.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {

constexpr std::size_t kMinCulled = 4;  // candidates; culling this few costs as much as testing them

using Rays = WideUpTo<kRayPadding>;
using Rays3 = Wide3<Rays>;

// A hit at exactly the range counts; a hit at infinity does not.
template <Numbers kNumbers>
HWY_INLINE void store(const Nearest<Rays, kNumbers>& nearest, Rays range, float* t_hit, std::int32_t* element) {
  const Rays metres = nearest.metres();
  const Rays::Mask hit = (metres <= range) & (metres < kInfinity);
  select(hit, metres, kInfinity).store(t_hit);
  select(hit, nearest.element, -1).store(element);
}

// Hits the first wall that a ray from inside the room reaches. Walls out of range are skipped.
template <Numbers kNumbers>
HWY_INLINE void leave_room(const Candidate& room, const Rays3& o, const Rays3& direction, Nearest<Rays, kNumbers>& nearest) {
  const float* const half = room.shape->half_extents;
  Fraction<Rays> first{kInfinity, 1.0F, 1.0F};  // cosines of walls are their denominators, so no others are selected
  if (room.walls[0]) first = min(first, slab_exit(o.x, direction.x, half[0]));
  if (room.walls[1]) first = min(first, slab_exit(o.y, direction.y, half[1]));
  if (room.walls[2]) first = min(first, slab_exit(o.z, direction.z, half[2]));
  nearest.take(first, first.num < kInfinity, room.element);
}

// Selects the candidates whose bounding boxes are in view. The minimum of n . p over a box is n . centre - |n| . half. Returns
// their number, or max_seen + 1 if there are more than max_seen.
std::size_t select_seen(std::span<const Candidate> candidates, std::size_t max_seen, const RayBundle& rays,
                        const Candidate** seen) {
  using Planes = WideOf<Frustum::kPlanes>;
  const Frustum& frustum = *rays.frustum;
  const Wide3<Planes> normal = rotate(rays.rotation, Wide3<Planes>::load(frustum.x.data(), frustum.y.data(), frustum.z.data()));
  const Planes reach = rays.range * Planes::load(frustum.reach.data());
  std::size_t count = 0;
  for (const Candidate& candidate : candidates) {
    const Vec3 center = candidate.shape->box_center - rays.origin;
    const Vec3& half = candidate.shape->box_half;
    const auto along = [&](int axis, Planes n) HWY_ATTR { return n * center[axis] - abs(n) * half[axis]; };
    const Planes nearest = along(0, normal.x) + along(1, normal.y) + along(2, normal.z);
    if (!none(nearest > reach)) continue;
    if (count == max_seen) return max_seen + 1;
    seen[count++] = &candidate;
  }
  return count;
}

// Intersects one vector of rays with a candidate.
template <Numbers kNumbers>
HWY_INLINE void intersect(const Candidate& candidate, const Rays3& direction, Rays near, Nearest<Rays, kNumbers>& nearest) {
  const Shape& shape = *candidate.shape;
  const auto& local = candidate.local_origin;
  const Rays3 o{local[0], local[1], local[2]};
  if (candidate.hint == OriginHint::in_room) {
    leave_room(candidate, o, direction, nearest);
    return;
  }
  const Rays3 dir = shape.aligned ? direction : rotate(shape.to_local, direction);
  if (candidate.hint == OriginHint::beside_cylinder) {
    nearest.meet_cylinder_side(o, dir, shape.half_extents[0], shape.half_extents[2], candidate.element);
  } else if (candidate.hint == OriginHint::outside_marker) {
    nearest.intersect_front(sphere_interval(o, dir, shape.half_extents[0]), candidate.element, near);
  } else {
    nearest.intersect(interval(shape, o, dir), candidate.element, near);
  }
}

// kNearer: only hits nearer than t_hit count.
template <Numbers kNumbers, bool kCosines, bool kNearer>
void intersect_all(std::span<const Candidate* const> seen, RayBundle& rays) {
  const Rays near = rays.near, range = rays.range;
  for (std::size_t i = 0; i < rays.count; i += Rays::kCount) {
    const Rays3 direction = rotate(rays.rotation, Rays3::load_unaligned(rays.x + i, rays.y + i, rays.z + i));
    Nearest<Rays, kNumbers> nearest;
    if constexpr (kNearer) {
      nearest = {Rays::load(rays.t_hit + i), Rays::Int::load(rays.element + i)};
      if constexpr (kCosines) nearest.distance.cosine = Rays::load(rays.cosine + i);
    }
    for (const Candidate* const candidate : seen) intersect(*candidate, direction, near, nearest);
    store(nearest, range, rays.t_hit + i, rays.element + i);
    if constexpr (kCosines) nearest.distance.cosine.store(rays.cosine + i);
  }
}

template <Numbers kNumbers, bool kNearer>
HWY_INLINE void intersect_numbered(std::span<const Candidate* const> seen, RayBundle& rays) {
  rays.has_cosines ? intersect_all<kNumbers, true, kNearer>(seen, rays) : intersect_all<kNumbers, false, kNearer>(seen, rays);
}

bool is_ascending(std::span<const Candidate* const> seen) {
  for (std::size_t i = 1; i < seen.size(); ++i) {
    if (seen[i]->element < seen[i - 1]->element) return false;
  }
  return true;
}

template <bool kNearer>
HWY_INLINE bool trace_seen(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays) {
  const Candidate* seen[kMaxCandidates];
  std::size_t count = candidates.size();
  if (count <= kMinCulled) {
    for (std::size_t i = 0; i < count; ++i) seen[i] = &candidates[i];
  } else {
    count = select_seen(candidates, max_seen, rays, seen);
    if (count > max_seen) return false;
  }
  if (!rays.numbered) {
    intersect_all<Numbers::none, false, kNearer>({seen, count}, rays);
  } else if (!kNearer && is_ascending({seen, count})) {  // as in all worlds of few shapes
    intersect_numbered<Numbers::ascending, kNearer>({seen, count}, rays);
  } else {
    intersect_numbered<Numbers::any, kNearer>({seen, count}, rays);
  }
  return true;
}

bool trace_bundle(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays) {
  return trace_seen<false>(candidates, max_seen, rays);
}

void trace_nearer_bundle(std::span<const Candidate> candidates, RayBundle& rays) {
  for (std::size_t i = 0; i < candidates.size(); i += kMaxCandidates) {
    trace_seen<true>(candidates.subspan(i, std::min(kMaxCandidates, candidates.size() - i)), kMaxCandidates, rays);
  }
}

// kFront: shapes are visible from outside only.
template <bool kFront>
HWY_INLINE void trace_block(std::span<const NumberedShape> shapes, RayBlock& rays) {
  const Rays near = rays.near;
  for (std::size_t i = 0; i < rays.count; i += Rays::kCount) {
    const Rays3 origin = Rays3::load(rays.org_x + i, rays.org_y + i, rays.org_z + i);
    const Rays3 direction = Rays3::load(rays.dir_x + i, rays.dir_y + i, rays.dir_z + i);
    Nearest<Rays> nearest(Rays::load(rays.t_hit + i), Rays::Int::load(rays.element + i));
    for (const auto& [shape, element] : shapes) {
      const Interval<Rays> inside = world_interval(shape, origin, direction);
      kFront ? nearest.intersect_front(inside, element, near) : nearest.intersect(inside, element, near);
    }
    store(nearest, Rays::load(rays.range + i), rays.t_hit + i, rays.element + i);
  }
}

void trace_shapes(std::span<const NumberedShape> shapes, RayBlock& rays) { trace_block<false>(shapes, rays); }
void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays) { trace_block<true>(markers, rays); }

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_bundle);
HWY_EXPORT(trace_nearer_bundle);
HWY_EXPORT(trace_shapes);
HWY_EXPORT(trace_markers);

bool trace_direct(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays) {
  return HWY_DYNAMIC_DISPATCH(trace_bundle)(candidates, max_seen, rays);
}

void trace_nearer(std::span<const Candidate> candidates, RayBundle& rays) {
  HWY_DYNAMIC_DISPATCH(trace_nearer_bundle)(candidates, rays);
}

void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_shapes)(shapes, rays); }
void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_markers)(markers, rays); }

}  // namespace flockstep::trace
#endif
