// The ranges of a scan over the maximum range, and how much room they show.
#pragma once

#include <span>

namespace flockstep::task {

struct Clearance {
  double nearest = 1.0;  // the smallest of the normalised ranges
  double sum = 0.0;      // of the normalised ranges
};

// Of ranges (m), inf on a miss, over max_range_m; a miss counts as 1.
Clearance clearance_of(std::span<const float> ranges, float max_range_m);

// Writes ranges (m) over max_range_m, 1 on a miss, to `normalised`, which is as long.
void normalise(std::span<const float> ranges, float max_range_m, float* normalised);

}  // namespace flockstep::task
