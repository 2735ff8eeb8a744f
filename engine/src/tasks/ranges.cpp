#include "tasks/terms.hpp"

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

// Keeps sixteen partial sums on every target; sum i adds every 16th range from the i-th on. The total then has the same bits on
// all targets, and no addition waits for the one before.
ScanClearance clearance_of(std::span<const float> ranges, float max_range_m) {
  using F = WideUpTo<kSums>;
  using Double = Wide<hn::CappedTag<double, kSums / 2>>;
  using Float = Wide<hn::Rebind<float, Double::Tag>>;  // same lane count
  constexpr std::size_t kVectors = kSums / Double::kCount;
  Double sums[kVectors];
  for (Double& sum : sums) sum = 0.0;
  F nearest = 1.0F;
  alignas(64) float values[kSums];  // normalised ranges, padded with 0
  const auto add = [&]() HWY_ATTR {
    for (std::size_t i = 0; i < kVectors; ++i) {
      sums[i] = sums[i] + convert<Double>(Float::load(values + i * Double::kCount));
    }
  };
  std::size_t first = 0;
  for (; first + kSums <= ranges.size(); first += kSums) {
    for (std::size_t i = 0; i < kSums; i += F::kCount) {
      const F value = min(F::load_unaligned(ranges.data() + first + i) / max_range_m, 1.0F);
      nearest = min(nearest, value);
      value.store(values + i);
    }
    add();
  }
  if (const std::size_t left = ranges.size() - first; left > 0) {
    alignas(64) float rest[kSums];
    std::fill_n(rest, kSums, std::numeric_limits<float>::infinity());
    std::copy_n(ranges.data() + first, left, rest);
    for (std::size_t i = 0; i < kSums; i += F::kCount) {
      const F value = min(F::load(rest + i) / max_range_m, 1.0F);
      nearest = min(nearest, value);
      value_if(F::Int::iota() < static_cast<std::int32_t>(std::max(left, i) - i), value).store(values + i);
    }
    add();
  }
  for (std::size_t half = kVectors / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) sums[i] = sums[i] + sums[i + half];
  }
  alignas(64) double lanes[Double::kCount];
  sums[0].store(lanes);
  for (std::size_t half = Double::kCount / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) lanes[i] += lanes[i + half];
  }
  return {static_cast<double>(min_of_lanes(nearest)), lanes[0]};
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  using F = WideUpTo<kSums>;
  std::size_t first = 0;
  const auto write = [&](std::size_t at) HWY_ATTR {
    min(F::load_unaligned(ranges.data() + at) / max_range_m, 1.0F).store_unaligned(normalised + at);
  };
  for (; first + F::kCount <= ranges.size(); first += F::kCount) write(first);
  if (first > 0) return write(ranges.size() - F::kCount);  // overlaps the previous vector
  for (; first < ranges.size(); ++first) normalised[first] = std::min(ranges[first] / max_range_m, 1.0F);
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {

HWY_EXPORT(clearance_of);
HWY_EXPORT(normalise);

ScanClearance clearance_of(std::span<const float> ranges, float max_range_m) {
  return HWY_DYNAMIC_DISPATCH(clearance_of)(ranges, max_range_m);
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  HWY_DYNAMIC_DISPATCH(normalise)(ranges, max_range_m, normalised);
}

}  // namespace flockstep::task
#endif
