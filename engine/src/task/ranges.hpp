// The ranges of a scan as an observation has them, and what the reward wants to know of them.
#pragma once

#include <span>

namespace flockstep::task {

struct Clearance {
  double nearest = 1.0;  // the smallest of the normalised ranges
  double sum = 0.0;      // of the normalised ranges
};

// Writes ranges (m) over max_range, 1 on a miss, to `normalised`, which is as long.
Clearance normalise(std::span<const float> ranges, float max_range, float* normalised);

}  // namespace flockstep::task
