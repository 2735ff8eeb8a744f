// ColorErrors: how the colours of a camera differ from the true ones.
#pragma once

#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Errors of colour images, in linear light from 0 to 1, which is then rounded to 12 bits. They apply in the order of the fields
// to the rendered image, before it is resized. Noise is independent in each pixel, channel and image.
struct ColorErrors {
  float vignetting = 0.0F;
  std::optional<float> auto_exposure;
  float exposure = 1.0F;
  float shot_noise = 0.0F;
  float read_noise = 0.0F;
  float gamma = 1.0F;

  static constexpr auto fields() {
    using C = ColorErrors;
    return field_list(
        field("vignetting", &C::vignetting,
              {.about = "Share of the natural fall-off: the light times the 4th power of the cosine to the optical axis.",
               .limits = between(0, 1)}),
        field("auto_exposure", &C::auto_exposure,
              {.about = "Mean light that each image is scaled to, without its vignetting.", .limits = above_up_to(0, 1)}),
        field("exposure", &C::exposure, {.about = "Factor of the light.", .limits = between(0, 1000)}),
        field("shot_noise", &C::shot_noise,
              {.about = "Standard deviation of Gaussian noise at light 1. It grows with the light's root.",
               .limits = between(0, 1)}),
        field("read_noise", &C::read_noise,
              {.about = "Standard deviation of Gaussian noise at any light.", .limits = between(0, 1)}),
        field("gamma", &C::gamma, {.about = "Exponent of the sRGB values that result.", .limits = between(0.1, 10)}));
  }

  FLOCKSTEP_API void validate() const;
  bool operator==(const ColorErrors&) const = default;
};

}  // namespace flockstep
