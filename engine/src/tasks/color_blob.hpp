// The camera feature of the thesis: position and size of a colour blob, such as the green goal. A threshold selects the pixels,
// and the blob is their bounding box.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/color.hpp"
#include "flockstep/sensors/camera.hpp"
#include "imaging/resample.hpp"

namespace flockstep::task {

struct ColorBlob {
  bool found = false;
  int x = 0, y = 0;           // px, upper left pixel of the box
  int width = 0, height = 0;  // px
  float offset = 0.0F;  // horizontal offset of the box from the image centre over half the image width, in [-1, 1], positive to
                        // the right; 0 if nothing was found
  float area = 0.0F;    // area of the box over that of the image
};

// Working memory of one thread; it grows to the largest image.
struct ColorBlobScratch {
  std::vector<std::uint8_t> mask;  // (H, W) last image: 255 if the pixel has the colour, else 0
  std::vector<std::uint8_t> hsv;   // the image in hsv, in its layout
  imaging::HsvScratch conversion;
  std::vector<std::uint8_t> columns;  // (W,) nonzero if any pixel of the column has the colour
};

// Finds the blob of a colour. With the default range a pixel counts if G > 1.25 * max(R, B) + 16, for values from 0 to 255 with
// gamma applied.
ColorBlob find_color(std::span<const std::uint8_t> rgb, int width_px, int height_px, ImageLayout layout, const ColorRange& range,
                     ColorBlobScratch& scratch);

}  // namespace flockstep::task
