// EventPixels: how the pixels of an event camera answer changes of brightness.
#pragma once

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// The pixels of the output events, after v2e (Hu et al., 2021). A pixel compares the logarithm of its grey value with a
// reference, and counts an event for each threshold between them, by which the reference follows.
struct EventPixels {
  float threshold = 0.2F;
  float threshold_std = 0.0F;
  float refractory_s = 0.0F;
  float leak_hz = 0.0F;
  float shot_hz = 0.0F;

  static constexpr auto fields() {
    using C = EventPixels;
    return field_list(
        field("threshold", &C::threshold,
              {.about = "Change of the natural logarithm that causes an event.", .limits = between(0.01, 10)}),
        field("threshold_std", &C::threshold_std,
              {.about = "Standard deviation of thresholds, at least 0.01 each, drawn per episode.", .limits = between(0, 10)}),
        field("refractory_s", &C::refractory_s,
              {.about = "Dead time of a pixel after an event.", .unit = "s", .limits = between(0, 1)}),
        field("leak_hz", &C::leak_hz,
              {.about = "Rate of ON events at constant brightness.", .unit = "Hz", .limits = between(0, 1000)}),
        field("shot_hz", &C::shot_hz,
              {.about = "Rate of random events, half ON and half OFF.", .unit = "Hz", .limits = between(0, 1000)}));
  }

  FLOCKSTEP_API void validate() const;
  bool operator==(const EventPixels&) const = default;
};

}  // namespace flockstep
