// Hue, saturation and value of an image, by OpenCV.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/camera.hpp"

namespace flockstep::imaging {

// Owned by one thread; it grows to the largest image and stays.
struct HsvScratch {
  std::vector<std::uint8_t> rgb, hsv;  // (H, W, 3)
};

// Both images have 3 * width * height values in the same layout. Hue is in [0, 179], degrees / 2; saturation and value in [0,
// 255].
void rgb_to_hsv(const std::uint8_t* rgb, int width, int height, ImageLayout layout, std::uint8_t* hsv, HsvScratch& scratch);

}  // namespace flockstep::imaging
