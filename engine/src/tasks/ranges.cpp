#include "tasks/ranges.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/ranges.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <limits>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

constexpr std::size_t kSums = 16;

// Sixteen sums side by side on every target, the i-th of every 16th range: so the total has the same bits on all of them, and no
// addition waits for the one before.
Clearance clearance_of(std::span<const float> ranges, float max_range_m) {
  using F = WideOf<kSums>;
  using DoubleTag = hn::CappedTag<double, kSums / 2>;
  using Double = Wide<DoubleTag, kSums / hn::MaxLanes(DoubleTag())>;
  using Halves = Wide<hn::Rebind<float, DoubleTag>, Double::kParts>;
  F nearest = 1.0F;
  Double sum = 0.0;
  alignas(64) float values[kSums];
  const auto add = [&](const float* from, std::size_t count) HWY_ATTR {
    const F value = min(F::load_unaligned(from) / max_range_m, 1.0F);
    nearest = min(nearest, value);
    (count == kSums ? value : value_if(F::Int::iota() < static_cast<std::int32_t>(count), value)).store(values);
    sum = sum + convert<Double>(Halves::load(values));
  };
  std::size_t first = 0;
  for (; first + kSums <= ranges.size(); first += kSums) add(ranges.data() + first, kSums);
  if (const std::size_t left = ranges.size() - first; left > 0) {
    float rest[kSums];
    std::fill_n(rest, kSums, std::numeric_limits<float>::infinity());
    std::copy_n(ranges.data() + first, left, rest);
    add(rest, left);
  }
  alignas(64) double sums[kSums];
  sum.store(sums);
  for (std::size_t half = kSums / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) sums[i] += sums[i + half];
  }
  return {static_cast<double>(min_of_lanes(nearest)), sums[0]};
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  using F = WideUpTo<kSums>;
  std::size_t first = 0;
  const auto write = [&](std::size_t at) HWY_ATTR {
    min(F::load_unaligned(ranges.data() + at) / max_range_m, 1.0F).store_unaligned(normalised + at);
  };
  for (; first + F::kCount <= ranges.size(); first += F::kCount) write(first);
  if (first > 0) return write(ranges.size() - F::kCount);  // some of them once more
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
