// The connected parts of an image that have a colour, by OpenCV. For users: it allocates, so the step uses task/color_blob.hpp.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/camera.hpp"
#include "flockstep/color.hpp"

namespace flockstep::imaging {

struct ColorComponent {
  int x = 0, y = 0;                       // px, of the box's first pixel, from the upper left
  int width = 0, height = 0;              // px, of the box
  int area = 0;                           // number of pixels
  double center_x = 0.0, center_y = 0.0;  // px from the upper left corner: the mean of the pixels' centres, each at + 1/2
};

struct ColorComponents {
  std::vector<ColorComponent> list;  // in the order of their labels
  std::vector<std::int32_t> labels;  // (H, W): 0 where the colour is not, i + 1 in component i
};

// Pixels belong together where they touch, corners included. rgb has 3 * width * height values.
ColorComponents find_components(std::span<const std::uint8_t> rgb, int width, int height, ImageLayout layout,
                                const ColorRange& range);

}  // namespace flockstep::imaging
