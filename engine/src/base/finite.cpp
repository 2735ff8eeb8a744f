#include "base/finite.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/finite.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cmath>
#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A number times 0 is 0, but for an infinity and a NaN, which give a NaN, and that stays in the sum.
template <class T>
bool all_finite(std::span<const T> values) {
  const hn::ScalableTag<T> d;
  const auto zero = hn::Zero(d);
  auto sum = zero;
  std::size_t first = 0;
  for (; first + hn::Lanes(d) <= values.size(); first += hn::Lanes(d)) {
    sum = hn::MulAdd(hn::LoadU(d, values.data() + first), zero, sum);
  }
  if (first > 0) {  // some of them once more
    sum = hn::MulAdd(hn::LoadU(d, values.data() + values.size() - hn::Lanes(d)), zero, sum);
  } else {
    for (const T value : values) {
      if (!std::isfinite(value)) return false;
    }
  }
  return hn::AllTrue(d, hn::Eq(sum, zero));
}

bool floats_are_finite(std::span<const float> values) { return all_finite(values); }
bool doubles_are_finite(std::span<const double> values) { return all_finite(values); }

}  // namespace flockstep::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep {

HWY_EXPORT(floats_are_finite);
HWY_EXPORT(doubles_are_finite);

bool are_finite(std::span<const float> values) { return HWY_DYNAMIC_DISPATCH(floats_are_finite)(values); }
bool are_finite(std::span<const double> values) { return HWY_DYNAMIC_DISPATCH(doubles_are_finite)(values); }

}  // namespace flockstep
#endif
