// Connected components of one colour in an image, found with OpenCV. They are meant for users: the search allocates memory,
// so the step uses tasks/color_blob.hpp instead.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/color.hpp"
#include "flockstep/sensors/camera.hpp"

namespace flockstep::imaging {

struct ColorComponent {
  int x = 0, y = 0;                       // px, upper left pixel of the bounding box
  int width = 0, height = 0;              // px, size of the bounding box
  int area = 0;                           // number of pixels
  double center_x = 0.0, center_y = 0.0;  // px from the upper left corner, mean of the pixel centres, which lie at + 1/2
};

struct ColorComponents {
  std::vector<ColorComponent> list;  // in label order
  std::vector<std::int32_t> labels;  // (H, W), i + 1 in component i, 0 outside the colour
};

// Finds 8-connected components: pixels that touch at a corner belong together. rgb has 3 * width * height values.
ColorComponents find_components(std::span<const std::uint8_t> rgb, int width, int height, ImageLayout layout,
                                const ColorRange& range);

}  // namespace flockstep::imaging
