#include "trace/ray_block.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/ray_block.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void append(const RayBundle& bundle, std::size_t first, std::size_t count, RayBlock& block) {
  const hn::CappedTag<float, kRayPadding> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const std::size_t from = first + i;
    const std::size_t to = block.count + i;
    const Vec3V<V> direction =
        rotate(d, bundle.rotation, {hn::LoadU(d, bundle.x + from), hn::LoadU(d, bundle.y + from), hn::LoadU(d, bundle.z + from)});
    hn::StoreU(hn::Set(d, bundle.origin.x()), d, block.org_x + to);
    hn::StoreU(hn::Set(d, bundle.origin.y()), d, block.org_y + to);
    hn::StoreU(hn::Set(d, bundle.origin.z()), d, block.org_z + to);
    hn::StoreU(direction.x, d, block.dir_x + to);
    hn::StoreU(direction.y, d, block.dir_y + to);
    hn::StoreU(direction.z, d, block.dir_z + to);
    hn::StoreU(hn::Set(d, bundle.range), d, block.range + to);
    hn::StoreU(hn::LoadU(d, bundle.t_hit + from), d, block.t_hit + to);
    hn::StoreU(hn::LoadU(di, bundle.element + from), di, block.element + to);
  }
  block.count += count;
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(append);

void append(const RayBundle& bundle, std::size_t first, std::size_t count, RayBlock& block) {
  HWY_DYNAMIC_DISPATCH(append)(bundle, first, count, block);
}

}  // namespace flockstep::trace
#endif
