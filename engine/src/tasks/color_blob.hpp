// The thesis's feature of a camera image: where a colour is, such as the green of the goal, and how large. Found by a colour
// threshold and the box around the pixels that pass it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/camera.hpp"
#include "flockstep/color.hpp"
#include "imaging/hsv.hpp"

namespace flockstep::task {

struct ColorBlob {
  bool found = false;
  int x = 0, y = 0;           // px, of the box's first pixel, from the upper left
  int width = 0, height = 0;  // px
  float offset = 0.0F;  // of the box's centre from the image's in x over half the image's width, in [-1, 1], positive to the
                        // right; 0 where the colour is not seen
  float area = 0.0F;    // of the box over the image's
};

// A thread's own; it grows to the largest image and stays.
struct ColorBlobScratch {
  std::vector<std::uint8_t> mask;  // (H, W) of the last image: 255 where the colour is, else 0
  std::vector<std::uint8_t> hsv;   // of the image, in its layout
  imaging::HsvScratch conversion;
  std::vector<std::uint8_t> columns;  // (W,) not 0 where any row has the colour
};

// By default a pixel is green where G > 1.25 * max(R, B) + 16, of values as they are written (0 to 255, gamma applied).
ColorBlob find_color(std::span<const std::uint8_t> rgb, int width_px, int height_px, ImageLayout layout, const ColorRange& range,
                     ColorBlobScratch& scratch);

}  // namespace flockstep::task
