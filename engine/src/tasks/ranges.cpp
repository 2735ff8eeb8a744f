#include "tasks/ranges.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/ranges.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <limits>

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
  constexpr std::size_t kVectors = kSums / hn::MaxLanes(dd);
  hn::Vec<decltype(dd)> sums[kVectors];
  for (auto& sum : sums) sum = hn::Zero(dd);
  const auto one = hn::Set(d, 1.0F);
  const auto divisor = hn::Set(d, max_range_m);
  auto nearest = one;
  alignas(64) float values[kSums];  // normalised ranges, 0 where there is none
  const auto add = [&] {
    for (std::size_t i = 0; i < kVectors; ++i) {
      sums[i] = hn::Add(sums[i], hn::PromoteTo(dd, hn::Load(df, values + i * hn::Lanes(dd))));
    }
  };
  std::size_t first = 0;
  for (; first + kSums <= ranges.size(); first += kSums) {
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(d)) {
      const auto value = hn::Min(hn::Div(hn::LoadU(d, ranges.data() + first + i), divisor), one);
      nearest = hn::Min(nearest, value);
      hn::Store(value, d, values + i);
    }
    add();
  }
  if (const std::size_t left = ranges.size() - first; left > 0) {
    alignas(64) float rest[kSums];
    std::fill_n(rest, kSums, std::numeric_limits<float>::infinity());
    std::copy_n(ranges.data() + first, left, rest);
    for (std::size_t i = 0; i < kSums; i += hn::Lanes(d)) {
      const auto value = hn::Min(hn::Div(hn::Load(d, rest + i), divisor), one);
      nearest = hn::Min(nearest, value);
      hn::Store(hn::IfThenElseZero(hn::FirstN(d, std::max(left, i) - i), value), d, values + i);
    }
    add();
  }
  for (std::size_t half = kVectors / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) sums[i] = hn::Add(sums[i], sums[i + half]);
  }
  alignas(64) double lanes[hn::MaxLanes(dd)];
  hn::Store(sums[0], dd, lanes);
  for (std::size_t half = hn::MaxLanes(dd) / 2; half > 0; half /= 2) {
    for (std::size_t i = 0; i < half; ++i) lanes[i] += lanes[i + half];
  }
  return {static_cast<double>(hn::GetLane(hn::MinOfLanes(d, nearest))), lanes[0]};
}

void normalise(std::span<const float> ranges, float max_range_m, float* normalised) {
  const hn::CappedTag<float, kSums> d;
  const auto one = hn::Set(d, 1.0F);
  const auto divisor = hn::Set(d, max_range_m);
  std::size_t first = 0;
  const auto write = [&](std::size_t at) {
    hn::StoreU(hn::Min(hn::Div(hn::LoadU(d, ranges.data() + at), divisor), one), d, normalised + at);
  };
  for (; first + hn::Lanes(d) <= ranges.size(); first += hn::Lanes(d)) write(first);
  if (first > 0) return write(ranges.size() - hn::Lanes(d));  // some of them once more
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
