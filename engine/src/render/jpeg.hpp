// JPEG files of frames, by libjpeg-turbo.
#pragma once

#include <cstdint>
#include <string>

#include "flockstep/config.hpp"

namespace flockstep::render {

// The file's bytes. An rgb image is laid out as the camera says. quality: in [1, 100].
std::string compress_rgb(const std::uint8_t* image, const CameraConfig& camera, int quality);
std::string compress_grey(const std::uint8_t* image, const CameraConfig& camera, int quality);

}  // namespace flockstep::render
