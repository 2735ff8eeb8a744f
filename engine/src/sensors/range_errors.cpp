#include "sensors/range_errors.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/range_errors.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <limits>

#include "base/wide-inl.hpp"
#include "sensors/disturb-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

void disturb_ranges(const RangeErrors& errors, float max_range_m, const PhiloxInput& first, std::span<float> ranges) {
  using F = WideUpTo<16>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const bool has_noise = errors.noise_std_m > 0.0F || errors.noise_per_m > 0.0F;
  disturb_each<F>(ranges, first, has_noise, errors.dropout > 0.0F, [&](F range, F normal, F uniform) HWY_ATTR {
    const F sigma = errors.noise_std_m + errors.noise_per_m * range;
    F reading = max(range + (errors.bias_m + sigma * normal), F(0.0F));
    if (errors.resolution_m > 0.0F) reading = round(reading / errors.resolution_m) * errors.resolution_m;
    const auto misses =
        (range == F(kInfinity)) | (reading < errors.min_range_m) | (reading > max_range_m) | (uniform < errors.dropout);
    return select(misses, F(kInfinity), reading);
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
