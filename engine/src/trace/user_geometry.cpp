#include "trace/user_geometry.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/user_geometry.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {

// The fields of RTCRayHitN are arrays of N; these are their places in it, in units of N.
enum Field : std::size_t { org_x, org_y, org_z, t_near, dir_x, dir_y, dir_z, time, t_far, mask, id, flags };
enum HitField : std::size_t { normal_x = 12, normal_y, normal_z, u, v, prim_id, geom_id };

template <class D>
HWY_INLINE void intersect_lanes(D d, const RTCIntersectFunctionNArguments* args, const Shape& shape, std::size_t first) {
  const hn::RebindToSigned<D> di;
  const std::size_t n = args->N;
  float* const rays = reinterpret_cast<float*>(args->rayhit) + first;
  std::int32_t* const ids = reinterpret_cast<std::int32_t*>(args->rayhit) + first;
  const auto load = [&](std::size_t field) HWY_ATTR { return hn::LoadU(d, rays + field * n); };

  Nearest<D> found(d);
  found.meet(d, world_interval(d, shape, {load(org_x), load(org_y), load(org_z)}, {load(dir_x), load(dir_y), load(dir_z)}), 0,
             load(t_near));
  const auto distance = found.metres();
  // Of two primitives at the same distance the one of the lower index is taken, whichever Embree visits first.
  const auto nearest = load(t_far);
  const auto prim = hn::Set(di, static_cast<std::int32_t>(args->primID));
  const auto geom = hn::LoadU(di, ids + geom_id * n);
  const auto before =
      hn::And(hn::Eq(geom, hn::Set(di, static_cast<std::int32_t>(args->geomID))), hn::Lt(prim, hn::LoadU(di, ids + prim_id * n)));
  const auto active = hn::RebindMask(d, hn::Ne(hn::LoadU(di, args->valid + first), hn::Zero(di)));
  const auto nearer = hn::Or(hn::Lt(distance, nearest), hn::And(hn::Eq(distance, nearest), hn::RebindMask(d, before)));
  const auto take = hn::And(active, hn::And(nearer, hn::RebindMask(d, hn::Eq(found.element, hn::Zero(di)))));
  const auto take_ids = hn::RebindMask(di, take);
  hn::StoreU(hn::IfThenElse(take, distance, nearest), d, rays + t_far * n);
  hn::StoreU(hn::IfThenElse(take_ids, prim, hn::LoadU(di, ids + prim_id * n)), di, ids + prim_id * n);
  hn::StoreU(hn::IfThenElse(take_ids, hn::Set(di, static_cast<std::int32_t>(args->geomID)), geom), di, ids + geom_id * n);
}

void intersect_primitive(const RTCIntersectFunctionNArguments* args) {
  const Shape& shape = static_cast<const Shape*>(args->geometryUserPtr)[args->primID];
  const hn::CappedTag<float, 16> wide;
  const std::size_t lanes = hn::Lanes(wide);
  std::size_t first = 0;
  for (; first + lanes <= args->N; first += lanes) intersect_lanes(wide, args, shape, first);
  for (; first < args->N; ++first) intersect_lanes(hn::CappedTag<float, 1>(), args, shape, first);
}

RTCIntersectFunctionN select_intersect_function() { return intersect_primitive; }
const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(select_intersect_function);
HWY_EXPORT(target_name);

RTCIntersectFunctionN primitive_intersect_function() { return HWY_DYNAMIC_DISPATCH(select_intersect_function)(); }
const char* simd_target() { return HWY_DYNAMIC_DISPATCH(target_name)(); }

}  // namespace flockstep::trace
#endif
