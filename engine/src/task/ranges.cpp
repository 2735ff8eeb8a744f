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

constexpr std::size_t kSums = 16;

// Sixteen sums side by side on every target, the i-th of every 16th range: so the total has the same bits on all of them, and no
// addition waits for the one before.
Clearance clearance_of(std::span<const float> ranges, float max_range_m) {
  const hn::CappedTag<float, kSums> d;
  const hn::CappedTag<double, kSums / 2> dd;
  const hn::Rebind<float, decltype(dd)> df;
  alignas(64) double sums[kSums] = {};
  alignas(64) float values[kSums];
  auto nearest = hn::Set(d, 1.0F);
  const auto one = hn::Set(d, 1.0F);
  const auto divisor = hn::Set(d, max_range_m);
  std::size_t first = 0;
  for (; first + kSums <= ranges.size(); first += kSums) {
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(d)) {
      const auto value = hn::Min(hn::Div(hn::LoadU(d, ranges.data() + first + i), divisor), one);
      nearest = hn::Min(nearest, value);
      hn::Store(value, d, values + i);
    }
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(dd)) {
      const auto value = hn::PromoteTo(dd, hn::Load(df, values + i));
      hn::Store(hn::Add(hn::Load(dd, sums + i), value), dd, sums + i);
    }
  }
  Clearance clearance{static_cast<double>(hn::GetLane(hn::MinOfLanes(d, nearest))), 0.0};
  for (std::size_t i = 0; first + i < ranges.size(); ++i) {
    const double value = static_cast<double>(std::min(ranges[first + i] / max_range_m, 1.0F));
    clearance.nearest = std::min(clearance.nearest, value);
    sums[i] += value;
  }
  for (std::size_t half = kSums / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) sums[i] += sums[i + half];
  }
  clearance.sum = sums[0];
  return clearance;
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  const hn::CappedTag<float, kSums> d;
  const auto one = hn::Set(d, 1.0F);
  const auto divisor = hn::Set(d, max_range_m);
  std::size_t first = 0;
  for (; first + hn::Lanes(d) <= ranges.size(); first += hn::Lanes(d)) {
    hn::StoreU(hn::Min(hn::Div(hn::LoadU(d, ranges.data() + first), divisor), one), d, normalised + first);
  }
  for (; first < ranges.size(); ++first) normalised[first] = std::min(ranges[first] / max_range_m, 1.0F);
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {

HWY_EXPORT(clearance_of);
HWY_EXPORT(normalise);

Clearance clearance_of(std::span<const float> ranges, float max_range_m) {
  return HWY_DYNAMIC_DISPATCH(clearance_of)(ranges, max_range_m);
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  HWY_DYNAMIC_DISPATCH(normalise)(ranges, max_range_m, normalised);
}

}  // namespace flockstep::task
#endif
