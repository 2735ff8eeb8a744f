#include "imaging/hsv.hpp"

#include <array>
#include <cstddef>

#include "imaging/opencv.hpp"

namespace flockstep::imaging {
namespace {

// Wraps the planes of a (3, H, W) image. OpenCV accepts no pointers to const.
std::array<cv::Mat, 3> planes(std::uint8_t* image, int width, int height) {
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  return {cv::Mat(height, width, CV_8UC1, image), cv::Mat(height, width, CV_8UC1, image + plane),
          cv::Mat(height, width, CV_8UC1, image + 2 * plane)};
}

}  // namespace

void rgb_to_hsv(const std::uint8_t* rgb, int width, int height, ImageLayout layout, std::uint8_t* hsv, HsvScratch& scratch) {
  prepare_opencv();
  auto* const from = const_cast<std::uint8_t*>(rgb);
  if (layout == ImageLayout::hwc) {
    cv::Mat converted(height, width, CV_8UC3, hsv);
    cv::cvtColor(cv::Mat(height, width, CV_8UC3, from), converted, cv::COLOR_RGB2HSV);
    return;
  }
  const std::size_t values = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  scratch.rgb.resize(values);
  scratch.hsv.resize(values);
  cv::Mat merged(height, width, CV_8UC3, scratch.rgb.data());
  cv::Mat converted(height, width, CV_8UC3, scratch.hsv.data());
  cv::merge(planes(from, width, height).data(), 3, merged);
  cv::cvtColor(merged, converted, cv::COLOR_RGB2HSV);
  cv::split(converted, planes(hsv, width, height).data());
}

}  // namespace flockstep::imaging
