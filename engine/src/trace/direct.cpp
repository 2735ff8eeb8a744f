#include "trace/direct.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/direct.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <limits>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace swiftlet::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A hit at the range itself counts, at infinity none does.
template <class D, class V = hn::Vec<D>>
HWY_INLINE void store(D d, const Nearest<D>& nearest, V range, float* t_hit, std::int32_t* element) {
  const hn::RebindToSigned<D> di;
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const V metres = nearest.metres();
  const auto hit = hn::And(hn::Le(metres, range), hn::Lt(metres, infinity));
  hn::Store(hn::IfThenElse(hit, metres, infinity), d, t_hit);
  hn::Store(hn::IfThenElse(hn::RebindMask(di, hit), nearest.element, hn::Set(di, -1)), di, element);
}

void trace_bundle(std::span<const Candidate* const> candidates, RayBundle& rays) {
  const hn::CappedTag<float, kRayPadding> d;
  using V = hn::Vec<decltype(d)>;
  const V range = hn::Set(d, rays.range);
  for (std::size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
    const Vec3V<V> direction{hn::Load(d, rays.dir_x + i), hn::Load(d, rays.dir_y + i), hn::Load(d, rays.dir_z + i)};
    Nearest nearest(d);
    for (const Candidate* candidate : candidates) {
      const Shape& shape = *candidate->shape;
      const auto& local = candidate->local_origin;
      const Vec3V<V> o{hn::Set(d, local[0]), hn::Set(d, local[1]), hn::Set(d, local[2])};
      if (candidate->from_within) {  // the ray ends at the first wall that it leaves through
        const auto always = hn::FirstN(d, hn::Lanes(d));
        if (candidate->walls[0]) nearest.take(d, slab_exit(d, o.x, direction.x, shape.half_extents[0]), always, candidate->element);
        if (candidate->walls[1]) nearest.take(d, slab_exit(d, o.y, direction.y, shape.half_extents[1]), always, candidate->element);
        if (candidate->walls[2]) nearest.take(d, slab_exit(d, o.z, direction.z, shape.half_extents[2]), always, candidate->element);
      } else {
        const Vec3V<V> dir = shape.aligned ? direction : rotate(d, shape.to_local, direction);
        nearest.meet(d, interval(d, shape, o, dir), candidate->element);
      }
    }
    store(d, nearest, range, rays.t_hit + i, rays.element + i);
  }
}

void trace_block(std::span<const NumberedShape> shapes, RayBlock& rays) {
  const hn::CappedTag<float, kRayPadding> d;
  using V = hn::Vec<decltype(d)>;
  for (std::size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
    const Vec3V<V> origin{hn::Load(d, rays.org_x + i), hn::Load(d, rays.org_y + i), hn::Load(d, rays.org_z + i)};
    const Vec3V<V> direction{hn::Load(d, rays.dir_x + i), hn::Load(d, rays.dir_y + i), hn::Load(d, rays.dir_z + i)};
    Nearest nearest(d);
    for (const auto& [shape, element] : shapes) nearest.meet(d, world_interval(d, shape, origin, direction), element);
    store(d, nearest, hn::Load(d, rays.range + i), rays.t_hit + i, rays.element + i);
  }
}

}  // namespace swiftlet::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace swiftlet::trace {

HWY_EXPORT(trace_bundle);
HWY_EXPORT(trace_block);

void trace_direct(std::span<const Candidate* const> candidates, RayBundle& rays) {
  HWY_DYNAMIC_DISPATCH(trace_bundle)(candidates, rays);
}

void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_block)(shapes, rays); }

}  // namespace swiftlet::trace
#endif
