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

// A number times 0 is 0, but for an infinity and a NaN, which give a NaN, and that stays in the sum. Two sums, since each waits
// for its last.
template <class T>
bool all_finite(std::span<const T> values) {
  const hn::ScalableTag<T> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto zero = hn::Zero(d);
  auto sum = zero, other_sum = zero;
  const auto add = [&](std::size_t first, auto& to) HWY_ATTR { to = hn::MulAdd(hn::LoadU(d, values.data() + first), zero, to); };
  if (values.size() < lanes) {
    for (const T value : values) {
      if (!std::isfinite(value)) return false;
    }
    return true;
  }
  std::size_t first = 0;
  for (; first + 2 * lanes <= values.size(); first += 2 * lanes) {
    add(first, sum);
    add(first + lanes, other_sum);
  }
  if (first + lanes <= values.size()) add(first, sum);
  add(values.size() - lanes, other_sum);  // the rest, and some once more
  return hn::AllTrue(d, hn::Eq(hn::Add(sum, other_sum), zero));
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
