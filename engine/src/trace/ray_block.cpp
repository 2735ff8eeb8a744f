#include "trace/ray_block.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/ray_block.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

void append(const RayBundle& bundle, std::size_t first, std::size_t count, RayBlock& block) {
  using F = WideUpTo<kRayPadding>;
  for (std::size_t i = 0; i < count; i += F::kCount) {
    const std::size_t from = first + i;
    const std::size_t to = block.count + i;
    const auto store = [&](F value, float* values) HWY_ATTR { value.store_unaligned(values + to); };
    const auto direction = rotate(bundle.rotation, Wide3<F>::load_unaligned(bundle.x + from, bundle.y + from, bundle.z + from));
    store(bundle.origin.x(), block.org_x);
    store(bundle.origin.y(), block.org_y);
    store(bundle.origin.z(), block.org_z);
    store(direction.x, block.dir_x);
    store(direction.y, block.dir_y);
    store(direction.z, block.dir_z);
    store(bundle.range, block.range);
    store(F::load_unaligned(bundle.t_hit + from), block.t_hit);
    F::Int::load_unaligned(bundle.element + from).store_unaligned(block.element + to);
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
