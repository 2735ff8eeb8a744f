#include "sensors/range_errors.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/range_errors.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "base/random-inl.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

void disturb(const RangeErrors& errors, float max_range_m, PhiloxInput draw, std::span<float> ranges) {
  using F = WideUpTo<16>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr std::size_t kBeams = 2 * F::kCount;  // beams of a vector of draws
  const bool has_noise = errors.noise_std_m > 0.0F || errors.noise_per_m > 0.0F;
  alignas(64) float normal[kBeams] = {}, uniform[kBeams], rest[kBeams];
  std::fill_n(uniform, kBeams, 1.0F);
  for (std::size_t first = 0; first < ranges.size(); first += kBeams) {
    if (has_noise || errors.dropout > 0.0F) {
      const auto words = philox_draws<WordsOf<F>>(draw);
      if (has_noise) {
        const NormalPair<F> pair = normal_pair_of<F>(words.a, words.b);
        hn::StoreInterleaved2(pair.first.part[0], pair.second.part[0], F::Tag(), normal);
      }
      hn::StoreInterleaved2(uniform_of<F>(words.c).part[0], uniform_of<F>(words.d).part[0], F::Tag(), uniform);
      draw.counter[0] += static_cast<std::uint32_t>(F::kCount);
    }
    const std::size_t count = std::min(kBeams, ranges.size() - first);
    float* values = ranges.data() + first;
    if (count < kBeams) {
      std::fill_n(std::copy_n(values, count, rest), kBeams - count, kInfinity);
      values = rest;
    }
    for (std::size_t i = 0; i < kBeams; i += F::kCount) {
      const F range = F::load_unaligned(values + i);
      const F sigma = errors.noise_std_m + errors.noise_per_m * range;
      F reading = max(range + (errors.bias_m + sigma * F::load(normal + i)), F(0.0F));
      if (errors.resolution_m > 0.0F) reading = round(reading / errors.resolution_m) * errors.resolution_m;
      const auto misses = (range == F(kInfinity)) | (reading < errors.min_range_m) | (reading > max_range_m) |
                          (F::load(uniform + i) < errors.dropout);
      select(misses, F(kInfinity), reading).store_unaligned(values + i);
    }
    if (count < kBeams) std::copy_n(rest, count, ranges.data() + first);
  }
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

HWY_EXPORT(disturb);

void add_range_errors(const RangeErrors& errors, float max_range_m, const PhiloxInput& first, std::span<float> ranges) {
  HWY_DYNAMIC_DISPATCH(disturb)(errors, max_range_m, first, ranges);
}

}  // namespace flockstep::sensors
#endif
