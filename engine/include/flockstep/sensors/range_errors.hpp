// RangeErrors: how the ranges of a LiDAR differ from the true ones.
#pragma once

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Errors of ranges. They apply in the order of the fields to each beam that hits, independently of other beams and readings. The
// last two depend on the exact hit.
struct RangeErrors {
  float divergence_mrad = 0.0F;
  float clutter_per_m = 0.0F;
  float noise_std_m = 0.0F;
  float noise_per_m = 0.0F;
  float bias_m = 0.0F;
  float resolution_m = 0.0F;
  float min_range_m = 0.0F;
  float dropout = 0.0F;
  float dropout_per_m = 0.0F;
  float max_incidence_deg = 90.0F;
  float min_intensity = 0.0F;

  static constexpr auto fields() {
    using C = RangeErrors;
    return field_list(
        field("divergence_mrad", &C::divergence_mrad,
              {.about =
                   "Width of a beam. If its middle and its edge hit more than 0.2 m apart, it reads a range between, at random. "
                   "Beams are then traced twice.",
               .unit = "mrad",
               .limits = between(0, 100)}),
        field("clutter_per_m", &C::clutter_per_m,
              {.about = "Density of echoes from drops or flakes. A beam reads the first one if it is nearer than the surface and "
                        "``max_range_m``. Its distance is exponentially distributed, and the beam loses its other outputs.",
               .unit = "1/m",
               .limits = between(0, 1)}),
        field("noise_std_m", &C::noise_std_m,
              {.about = "Standard deviation of Gaussian noise at range 0.", .unit = "m", .limits = between(0, 1000)}),
        field("noise_per_m", &C::noise_per_m,
              {.about = "Growth of the standard deviation with the range, in metres per metre.", .limits = between(0, 1)}),
        field("bias_m", &C::bias_m, {.about = "Constant error. A range below 0 reads 0.", .unit = "m", .limits = within(1000)}),
        field("resolution_m", &C::resolution_m,
              {.about = "Ranges are rounded to multiples of it, at most ``max_range_m``. 0: not rounded.",
               .unit = "m",
               .limits = zero_or_between(1e-6, 1000)}),
        field("min_range_m", &C::min_range_m,
              {.about = "Minimum range, less than ``max_range_m``. A nearer reading is a miss.",
               .unit = "m",
               .limits = at_least(0)}),
        field("dropout", &C::dropout, {.about = "Probability that a beam that hits reads as a miss.", .limits = between(0, 1)}),
        field(
            "dropout_per_m", &C::dropout_per_m,
            {.about = "Extinction by rain, snow or fog, there and back. A beam that hits at r metres drops out with probability "
                      "``1 - (1 - dropout) * exp(-dropout_per_m * r)``. Fog of visibility V metres: 7.8 / V. Rain of R mm/h, "
                      "by Marshall and Palmer's drops: 0.00073 R^0.63.",
             .unit = "1/m",
             .limits = between(0, 1)}),
        field("max_incidence_deg", &C::max_incidence_deg,
              {.about = "A beam at a larger angle to a surface's normal misses.", .unit = "deg", .limits = between(0, 90)}),
        field("min_intensity", &C::min_intensity, {.about = "A beam of lower intensity misses.", .limits = between(0, 1)}));
  }

  FLOCKSTEP_API void validate() const;
  bool need_surfaces() const { return max_incidence_deg < 90.0F || min_intensity > 0.0F; }  // not only ranges
  bool operator==(const RangeErrors&) const = default;
};

}  // namespace flockstep
