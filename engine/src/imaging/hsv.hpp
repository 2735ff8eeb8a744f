// Converts an image to hue, saturation and value with OpenCV.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/camera.hpp"

namespace flockstep::imaging {

// Working memory of one thread. It grows to the largest image and is kept.
struct HsvScratch {
  std::vector<std::uint8_t> rgb, hsv;  // (H, W, 3)
};

// Both images have 3 * width * height values in the same layout. Hue is half the angle in degrees, in [0, 179]; saturation
// and value are in [0, 255].
void rgb_to_hsv(const std::uint8_t* rgb, int width, int height, ImageLayout layout, std::uint8_t* hsv, HsvScratch& scratch);

}  // namespace flockstep::imaging
