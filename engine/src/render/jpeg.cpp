#include "render/jpeg.hpp"

#include <turbojpeg.h>

#include <memory>
#include <stdexcept>
#include <vector>

namespace flockstep::render {
namespace {

std::string compress(const std::uint8_t* pixels, const CameraConfig& camera, int format, int subsampling, int quality) {
  const std::unique_ptr<void, decltype(&tjDestroy)> compressor(tjInitCompress(), tjDestroy);
  if (!compressor) throw std::runtime_error(std::string("libjpeg-turbo: ") + tjGetErrorStr2(nullptr));
  std::vector<unsigned char> file(tjBufSize(camera.image_width_px(), camera.image_height_px(), subsampling));
  unsigned char* out = file.data();
  unsigned long size = file.size();
  const int status = tjCompress2(compressor.get(), pixels, camera.image_width_px(), 0, camera.image_height_px(), format, &out,
                                 &size, subsampling, quality, TJFLAG_NOREALLOC);
  if (status != 0) throw std::runtime_error(std::string("libjpeg-turbo: ") + tjGetErrorStr2(compressor.get()));
  return {reinterpret_cast<const char*>(out), size};
}

}  // namespace

std::string compress_rgb(const std::uint8_t* image, const CameraConfig& camera, int quality) {
  if (camera.layout == ImageLayout::hwc) return compress(image, camera, TJPF_RGB, TJSAMP_420, quality);
  const std::size_t plane =
      static_cast<std::size_t>(camera.image_width_px()) * static_cast<std::size_t>(camera.image_height_px());
  std::vector<std::uint8_t> pixels(3 * plane);
  for (std::size_t i = 0; i < plane; ++i) {
    for (std::size_t c = 0; c < 3; ++c) pixels[3 * i + c] = image[c * plane + i];
  }
  return compress(pixels.data(), camera, TJPF_RGB, TJSAMP_420, quality);
}

std::string compress_grey(const std::uint8_t* image, const CameraConfig& camera, int quality) {
  return compress(image, camera, TJPF_GRAY, TJSAMP_GRAY, quality);
}

}  // namespace flockstep::render
