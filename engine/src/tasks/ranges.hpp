// Normalises the ranges of a scan, and measures the free space that they show.
#pragma once

#include <span>

namespace flockstep::task {

struct Clearance {
  double nearest = 1.0;  // smallest normalised range
  double sum = 0.0;      // sum of the normalised ranges
};

// Computes the clearance of ranges (m). Each is divided by max_range_m; a miss, inf, counts as 1.
Clearance clearance_of(std::span<const float> ranges, float max_range_m);

// Writes ranges (m) over max_range_m to `normalised`, which has the same length; a miss is written as 1.
void normalise(std::span<const float> ranges, float max_range_m, float* normalised);

}  // namespace flockstep::task
