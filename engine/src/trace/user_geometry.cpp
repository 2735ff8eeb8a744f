#include "trace/user_geometry.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/user_geometry.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {

// The fields of RTCRayHitN are arrays of N; these are their offsets, in units of N.
enum Field : std::size_t { org_x, org_y, org_z, t_near, dir_x, dir_y, dir_z, time, t_far, mask, id, flags };
enum HitField : std::size_t { normal_x = 12, normal_y, normal_z, u, v, prim_id, geom_id };

template <class F>
HWY_INLINE void intersect_lanes(const RTCIntersectFunctionNArguments* args, const Shape& shape, std::size_t first) {
  using I = typename F::Int;
  const std::size_t n = args->N;
  float* const rays = reinterpret_cast<float*>(args->rayhit) + first;
  std::int32_t* const ids = reinterpret_cast<std::int32_t*>(args->rayhit) + first;
  const auto load = [&](std::size_t field) HWY_ATTR { return F::load_unaligned(rays + field * n); };

  Nearest<F> found;
  found.intersect(world_interval<F>(shape, {load(org_x), load(org_y), load(org_z)}, {load(dir_x), load(dir_y), load(dir_z)}), 0,
                  load(t_near));
  const F distance = found.metres();
  // If two primitives are at the same distance, the lower index wins, in any order of Embree's visits.
  const F nearest = load(t_far);
  const auto own_prim = static_cast<std::int32_t>(args->primID), own_geom = static_cast<std::int32_t>(args->geomID);
  const I prim = I::load_unaligned(ids + prim_id * n), geom = I::load_unaligned(ids + geom_id * n);
  const auto active = I::load_unaligned(args->valid + first) != 0;
  const auto nearer = (distance < nearest) | ((distance == nearest) & (geom == own_geom) & (own_prim < prim));
  const auto take = active & nearer & (found.element == 0);
  select(take, distance, nearest).store_unaligned(rays + t_far * n);
  select(take, own_prim, prim).store_unaligned(ids + prim_id * n);
  select(take, own_geom, geom).store_unaligned(ids + geom_id * n);
}

void intersect_primitive(const RTCIntersectFunctionNArguments* args) {
  const Shape& shape = static_cast<const Shape*>(args->geometryUserPtr)[args->primID];
  using F = WideUpTo<16>;
  std::size_t first = 0;
  for (; first + F::kCount <= args->N; first += F::kCount) intersect_lanes<F>(args, shape, first);
  for (; first < args->N; ++first) intersect_lanes<WideUpTo<1>>(args, shape, first);
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
