// JPEG compression of images, with libjpeg-turbo.
#pragma once

#include <cstdint>
#include <string>

#include "flockstep/config.hpp"

namespace flockstep::render {

// Returns the bytes of a JPEG file. An rgb image has the layout of the camera. quality: in [1, 100].
std::string compress_rgb(const std::uint8_t* image, const CameraConfig& camera, int quality);
std::string compress_grey(const std::uint8_t* image, const CameraConfig& camera, int quality);

}  // namespace flockstep::render
