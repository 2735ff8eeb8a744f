// Adds the errors of RangeErrors to the ranges of a scan.
#pragma once

#include <span>

#include "base/random.hpp"
#include "flockstep/sensors/range_errors.hpp"

namespace flockstep::sensors {

// Beams 2k and 2k + 1 use draw `first` + k: its first two words for their noise, the other two for their dropouts and
// clutter. A range is negative if its surface loses the beam. A reading is negative if it is clutter.
void add_range_errors(const RangeErrors& errors, float max_range_m, const PhiloxInput& first, std::span<float> ranges);

}  // namespace flockstep::sensors
