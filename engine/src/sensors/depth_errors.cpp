#include "sensors/depth_errors.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/depth_errors.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <numbers>

#include "base/random-inl.hpp"
#include "base/wide-inl.hpp"
#include "sensors/disturb-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

// Pixels that the other eye does not see become inf. Its column of a surface is less by the disparity, which is
// depth_px / depth. A surface hides all others between its column and its pixel's.
void cut_shadows(const DepthImage& image, float depth_px, std::span<float> columns) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (std::size_t first = 0; first < image.depths.size(); first += image.width) {
    float* const row = image.depths.data() + first;
    for (std::size_t u = 0; u < image.width; ++u) {
      columns[u] = static_cast<float>(static_cast<int>(u)) + 0.5F - depth_px / row[u];
    }
    float border = kInfinity;  // left border, in the other eye's image, of the surfaces to the right
    for (std::size_t u = image.width; u-- > 0;) {
      if (columns[u] < 0.0F || columns[u] > border) row[u] = kInfinity;
      border = std::min(border, columns[u] - 0.5F);
    }
  }
}

// Pixels become inf where a field of normal numbers, independent at the nodes of a grid and interpolated between them, is below
// the threshold.
void cut_blotches(const DepthImage& image, float threshold, const PhiloxInput& draw, DepthScratch& scratch) {
  const std::size_t nodes = scratch.line.size();
  std::uint32_t next = 0;  // row of nodes
  float* depth = image.depths.data();
  for (const NodeWeights& down : scratch.down) {
    for (; next < down.node + 2; ++next) {
      scratch.above.swap(scratch.below);
      PhiloxInput of_row = draw;
      of_row.counter[0] += next * static_cast<std::uint32_t>((nodes + 3) / 4);
      write_normals<WideUpTo<16>>(of_row, scratch.below);
    }
    for (std::size_t i = 0; i < nodes; ++i) scratch.line[i] = down.first * scratch.above[i] + down.second * scratch.below[i];
    for (const NodeWeights& across : scratch.across) {
      const float field = across.first * scratch.line[across.node] + across.second * scratch.line[across.node + 1];
      if (field < threshold) *depth = std::numeric_limits<float>::infinity();
      ++depth;
    }
  }
}

void disturb_depths(const DepthErrors& errors, float threshold, const DepthImage& image, const PhiloxInput& noise,
                    const PhiloxInput& blotches, DepthScratch& scratch) {
  using F = WideUpTo<16>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  if (errors.edge_shadow) cut_shadows(image, image.fx * errors.baseline_m, scratch.columns);
  if (errors.blotches > 0.0F) cut_blotches(image, threshold, blotches, scratch);
  const float step = errors.disparity_step_px > 0.0F ? errors.disparity_step_px : 1.0F;  // unit of disparities, px
  const float depth_steps = errors.focal_px.value_or(image.fx) * errors.baseline_m / step;
  const float noise_steps = errors.disparity_noise_px / step;
  const float hole = errors.hole_m.value_or(kInfinity);
  const bool has_disparity = errors.disparity_noise_px > 0.0F || errors.disparity_step_px > 0.0F;
  const bool has_noise = errors.disparity_noise_px > 0.0F || errors.noise_std_m > 0.0F || errors.noise_per_m > 0.0F;
  disturb_each<F>(image.depths, noise, has_noise, errors.dropout > 0.0F, [&](F depth, F normal, F uniform) HWY_ATTR {
    F reading = depth;
    if (has_disparity) {
      F disparity = depth_steps / depth - noise_steps * normal;  // subtracted, so that both noises lengthen the depth
      if (errors.disparity_step_px > 0.0F) disparity = round(disparity);
      reading = depth_steps / disparity;
    }
    reading = reading + (errors.noise_std_m + errors.noise_per_m * depth) * normal;
    const auto holes =
        (depth == F(kInfinity)) | (reading < errors.min_range_m) | (reading > image.far_m) | (uniform < errors.dropout);
    return select(holes, F(hole), reading);
  });
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

float blotch_threshold(float probability) {
  double low = -20.0, high = 20.0;  // beyond any interpolation
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < static_cast<double>(probability) ? low : high) = middle;
  }
  return static_cast<float>(high);
}

namespace {

// Writes the weights of each pixel along an axis.
void write_weights(std::size_t pixels, float cell_px, std::vector<NodeWeights>& weights) {
  weights.resize(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float at = (static_cast<float>(i) + 0.5F) / cell_px, node = std::floor(at), rest = at - node;
    const float norm = std::sqrt((1.0F - rest) * (1.0F - rest) + rest * rest);
    weights[i] = {static_cast<std::uint32_t>(node), (1.0F - rest) / norm, rest / norm};
  }
}

}  // namespace

HWY_EXPORT(disturb_depths);

void add_depth_errors(const DepthErrors& errors, float threshold, const DepthImage& image, const PhiloxInput& noise,
                      const PhiloxInput& blotches, DepthScratch& scratch) {
  if (errors.edge_shadow) scratch.columns.resize(image.width);
  if (errors.blotches > 0.0F) {
    const float cell_px = std::max(errors.blotch_size_px * image.fx / errors.focal_px.value_or(image.fx), 1.0F);
    write_weights(image.width, cell_px, scratch.across);
    write_weights(image.depths.size() / image.width, cell_px, scratch.down);
    const std::size_t nodes = scratch.across.back().node + std::size_t{2};
    for (std::vector<float>* const list : {&scratch.above, &scratch.below, &scratch.line}) list->resize(nodes);
  }
  HWY_DYNAMIC_DISPATCH(disturb_depths)(errors, threshold, image, noise, blotches, scratch);
}

}  // namespace flockstep::sensors
#endif
