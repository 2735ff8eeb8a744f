#include "task/ranges.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "task/ranges.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <array>

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Sixteen sums side by side on every target, the i-th of every 16th range: so the total has the same bits on all of them, and no
// addition waits for the one before.
Clearance normalise(std::span<const float> ranges, float max_range, float* normalised) {
  constexpr std::size_t kSums = 16;
  const hn::CappedTag<float, kSums> d;
  const hn::CappedTag<double, kSums / 2> dd;
  const hn::Rebind<float, decltype(dd)> df;
  alignas(64) double sums[kSums] = {};
  alignas(64) float values[kSums];
  auto nearest = hn::Set(d, 1.0F);
  const auto one = hn::Set(d, 1.0F);
  const auto divisor = hn::Set(d, max_range);
  std::size_t first = 0;
  for (; first + kSums <= ranges.size(); first += kSums) {
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(d)) {
      const auto value = hn::Min(hn::Div(hn::LoadU(d, ranges.data() + first + i), divisor), one);
      nearest = hn::Min(nearest, value);
      hn::StoreU(value, d, normalised + first + i);
      hn::Store(value, d, values + i);
    }
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(dd)) {
      const auto value = hn::PromoteTo(dd, hn::Load(df, values + i));
      hn::Store(hn::Add(hn::Load(dd, sums + i), value), dd, sums + i);
    }
  }
  Clearance clearance{static_cast<double>(hn::GetLane(hn::MinOfLanes(d, nearest))), 0.0};
  for (std::size_t i = 0; first + i < ranges.size(); ++i) {
    const float value = std::min(ranges[first + i] / max_range, 1.0F);
    normalised[first + i] = value;
    clearance.nearest = std::min(clearance.nearest, static_cast<double>(value));
    sums[i] += static_cast<double>(value);
  }
  for (std::size_t half = kSums / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) sums[i] += sums[i + half];
  }
  clearance.sum = sums[0];
  return clearance;
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {

HWY_EXPORT(normalise);

Clearance normalise(std::span<const float> ranges, float max_range, float* normalised) {
  return HWY_DYNAMIC_DISPATCH(normalise)(ranges, max_range, normalised);
}

}  // namespace flockstep::task
#endif
