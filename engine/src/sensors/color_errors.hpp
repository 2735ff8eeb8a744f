// Adds the errors of ColorErrors to an image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/random.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/color_errors.hpp"
#include "render/camera_optics.hpp"

namespace flockstep::sensors {

struct ColorImage {
  std::uint8_t* values;  // sRGB
  std::size_t width;     // px
  std::size_t height;    // px
  std::size_t planes;    // one after the other
  std::size_t channels;  // of a pixel in a plane
};

// Working memory of one thread. It grows to the widest image and is kept.
struct ColorScratch {
  std::vector<float> light, normal;  // of the values of a row
};

// Returns the sRGB value of each level of light.
std::vector<std::uint8_t> make_levels(const ColorErrors& errors);

// levels: make_levels(errors). Each row of each plane uses a quarter as many draws as it has values, rounded up, from `draw` on.
void add_color_errors(const ColorErrors& errors, const std::vector<std::uint8_t>& levels, const render::CameraOptics& camera,
                      const ColorImage& image, const PhiloxInput& draw, ColorScratch& scratch);

}  // namespace flockstep::sensors
