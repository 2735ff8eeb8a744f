// DepthErrors: how the depth images of a camera differ from the true ones.
#pragma once

#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Errors of planar depths. They apply in the order of the fields to the rendered image, before it is resized. Except for
// blotches, they are independent in each pixel and image.
struct DepthErrors {
  float baseline_m = 0.05F;
  std::optional<float> focal_px;
  bool edge_shadow = false;
  float blotches = 0.0F;
  float blotch_size_px = 8.0F;
  float disparity_noise_px = 0.0F;
  float disparity_step_px = 0.0F;
  float noise_std_m = 0.0F;
  float noise_per_m = 0.0F;
  float min_range_m = 0.0F;
  float dropout = 0.0F;
  std::optional<float> hole_m;

  static constexpr auto fields() {
    using C = DepthErrors;
    return field_list(
        field("baseline_m", &C::baseline_m,
              {.about = "Distance to the other eye, to the right. Disparities are ``focal_px * baseline_m / depth``.",
               .unit = "m",
               .limits = above_up_to(0, 10)}),
        field("focal_px", &C::focal_px,
              {.about = "Focal length of the device, whose pixels these fields count. None: the rendered image's.",
               .unit = "px",
               .limits = between(1, 1e6)}),
        field("edge_shadow", &C::edge_shadow,
              {.about = "Makes holes where the other eye sees no surface: left of nearer surfaces and at the left border."}),
        field("blotches", &C::blotches,
              {.about = "Share of the image in blotches, holes of random shapes.", .limits = between(0, 1)}),
        field("blotch_size_px", &C::blotch_size_px,
              {.about = "Their approximate size.", .unit = "px", .limits = above_up_to(0, 8192)}),
        field("disparity_noise_px", &C::disparity_noise_px,
              {.about = "Standard deviation of Gaussian noise of disparities.", .unit = "px", .limits = between(0, 100)}),
        field("disparity_step_px", &C::disparity_step_px,
              {.about = "Step to which disparities are rounded. 0: none.", .unit = "px", .limits = zero_or_between(1e-4, 100)}),
        field("noise_std_m", &C::noise_std_m,
              {.about = "Standard deviation of Gaussian noise of depths, at depth 0.", .unit = "m", .limits = between(0, 1000)}),
        field("noise_per_m", &C::noise_per_m,
              {.about = "Growth of the same with the depth, in metres per metre.", .limits = between(0, 1)}),
        field("min_range_m", &C::min_range_m,
              {.about = "Minimum depth, less than ``far_m``. Readings outside are holes.", .unit = "m", .limits = at_least(0)}),
        field("dropout", &C::dropout, {.about = "Probability that a pixel is a hole.", .limits = between(0, 1)}),
        field("hole_m", &C::hole_m,
              {.about = "Value of holes and of pixels that see nothing. None: inf.", .unit = "m", .limits = between(0, 1e6)}));
  }

  FLOCKSTEP_API void validate() const;
  bool operator==(const DepthErrors&) const = default;
};

}  // namespace flockstep
