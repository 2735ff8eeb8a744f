#include "sensors/range_errors.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/range_errors.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <limits>

#include "base/random-inl.hpp"
#include "base/wide-inl.hpp"
#include "sensors/disturb-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

void disturb_ranges(const RangeErrors& errors, float max_range_m, const PhiloxInput& first, std::span<float> ranges) {
  using F = WideUpTo<16>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const bool has_noise = errors.noise_std_m > 0.0F || errors.noise_per_m > 0.0F;
  const bool has_weather = errors.clutter_per_m > 0.0F || errors.dropout_per_m > 0.0F;
  const bool has_dropout = errors.dropout > 0.0F || has_weather;
  disturb_each<F>(ranges, first, has_noise, has_dropout, [&](F signed_range, F normal, F uniform) HWY_ATTR {
    F range = abs(signed_range), sign = 1.0F;
    F::Mask misses = (bit_cast<F::Int>(signed_range) < 0) | (range == F(kInfinity));
    if (has_weather) {
      // For beams that do not drop out the quotient is uniform, so the optical depth at which they end is exponentially
      // distributed. That has no memory: what exceeds the depth of the clutter has the same distribution, for the extinction.
      const F depth = -log_of_31_bits((1.0F - uniform) / (1.0F - errors.dropout) * 0x1p31F);
      const F::Mask clutter = depth < errors.clutter_per_m * min(range, F(max_range_m));
      misses = without(misses | (depth < (errors.clutter_per_m + errors.dropout_per_m) * range), clutter);
      range = select(clutter, depth / errors.clutter_per_m, range);
      sign = select(clutter, F(-1.0F), sign);
    }
    const F sigma = errors.noise_std_m + errors.noise_per_m * range;
    F reading = max(range + (errors.bias_m + sigma * normal), F(0.0F));
    if (errors.resolution_m > 0.0F) reading = round(reading / errors.resolution_m) * errors.resolution_m;
    misses = misses | (reading < errors.min_range_m) | (reading > max_range_m) | (uniform < errors.dropout);
    return select(misses, F(kInfinity), copy_sign(reading, sign));
  });
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

HWY_EXPORT(disturb_ranges);

void add_range_errors(const RangeErrors& errors, float max_range_m, const PhiloxInput& first, std::span<float> ranges) {
  HWY_DYNAMIC_DISPATCH(disturb_ranges)(errors, max_range_m, first, ranges);
}

}  // namespace flockstep::sensors
#endif
