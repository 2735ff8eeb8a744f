// Adds the errors of DepthErrors to a depth image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/random.hpp"
#include "flockstep/sensors/depth_errors.hpp"

namespace flockstep::sensors {

struct DepthImage {
  std::span<float> depths;  // m, row by row, inf if nothing is seen
  std::size_t width;        // px
  float fx;                 // px
  float far_m;
};

// An interpolation between the nodes `node` and `node + 1` of a grid. The squares of the weights sum to 1, so the interpolation
// of independent standard normal numbers is standard normal.
struct NodeWeights {
  std::uint32_t node;
  float first, second;
};

// Working memory of one thread. It grows to the widest image and is kept.
struct DepthScratch {
  std::vector<float> columns;             // px, of surfaces in the other eye's image
  std::vector<NodeWeights> across, down;  // of each column and row
  std::vector<float> above, below, line;  // numbers of two rows of nodes, and between them
};

// Returns the number that a standard normal number is below with this probability.
float blotch_threshold(float probability);

// threshold: blotch_threshold(errors.blotches). Pixels 2k and 2k + 1 use draw `noise` + k, blotches the draws from `blotches` on.
void add_depth_errors(const DepthErrors& errors, float threshold, const DepthImage& image, const PhiloxInput& noise,
                      const PhiloxInput& blotches, DepthScratch& scratch);

}  // namespace flockstep::sensors
