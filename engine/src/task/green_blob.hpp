// The thesis's feature of a camera image: where the green of the goal is, and how large. Found by a colour threshold and the box
// around what it leaves.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/config.hpp"

namespace flockstep::task {

struct GreenBlob {
  bool found = false;
  int x = 0, y = 0;           // px, of the box's first pixel, from the upper left
  int width = 0, height = 0;  // px
  float offset = 0.0F;  // of the box's centre from the image's in x over half the image's width, in [-1, 1], positive to the
                        // right; 0 where no green is seen
  float area = 0.0F;    // of the box over the image's
};

// A thread's own; it grows to the largest image and stays.
struct GreenBlobScratch {
  std::vector<std::uint8_t> mask;     // (H, W) of the last image: not 0 where it is green
  std::vector<std::uint8_t> columns;  // (W,) not 0 where any row is green
};

// A pixel is green where G > 1.25 * max(R, B) + 16, of values as they are written (0 to 255, gamma applied).
GreenBlob find_green(std::span<const std::uint8_t> rgb, int width_px, int height_px, ImageLayout layout,
                     GreenBlobScratch& scratch);

}  // namespace flockstep::task
