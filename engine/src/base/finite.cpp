#include "base/finite.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/finite.cpp"
#include <hwy/foreach_target.h>
// Highway requires its other headers after foreach_target.
#include <hwy/highway.h>

#include <cmath>
#include <cstddef>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {

// A finite number times 0 is 0; an infinity or a NaN times 0 is NaN, and a NaN stays in the sum. Two sums are kept because each
// addition waits for the previous one.
template <class T>
bool all_finite(std::span<const T> values) {
  using F = Wide<hn::ScalableTag<T>>;
  if (values.size() < F::kCount) {
    for (const T value : values) {
      if (!std::isfinite(value)) return false;
    }
    return true;
  }
  F sum = T{0}, other_sum = T{0};
  const auto add = [&](std::size_t first, F& to) HWY_ATTR { to = to + F::load_unaligned(values.data() + first) * T{0}; };
  std::size_t first = 0;
  for (; first + 2 * F::kCount <= values.size(); first += 2 * F::kCount) {
    add(first, sum);
    add(first + F::kCount, other_sum);
  }
  if (first + F::kCount <= values.size()) add(first, sum);
  add(values.size() - F::kCount, other_sum);  // the remaining values; overlaps values already added
  return all(sum + other_sum == T{0});
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
