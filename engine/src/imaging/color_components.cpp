#include "imaging/color_components.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/color.hpp"
#include "imaging/opencv.hpp"

namespace flockstep::imaging {
namespace {

cv::Scalar scalar(const std::array<int, 3>& values) { return {double(values[0]), double(values[1]), double(values[2])}; }

// Returns by how much each channel exceeds 1.25 times the larger of the other two, rounded up; 0 if it does not.
cv::Mat excess_of(const cv::Mat& rgb) {
  std::array<std::uint8_t, 256> bounds{};
  for (std::size_t i = 0; i < bounds.size(); ++i) bounds[i] = static_cast<std::uint8_t>(std::min<std::size_t>(i + i / 4, 255));
  const cv::Mat table(1, 256, CV_8UC1, bounds.data());
  std::array<cv::Mat, 3> channels, excess;
  cv::split(rgb, channels.data());
  for (std::size_t k = 0; k < 3; ++k) {
    cv::Mat larger, bound;
    cv::max(channels[(k + 1) % 3], channels[(k + 2) % 3], larger);
    cv::LUT(larger, table, bound);
    cv::subtract(channels[k], bound, excess[k]);
  }
  cv::Mat merged;
  cv::merge(excess.data(), 3, merged);
  return merged;
}

cv::Mat mask_of(const cv::Mat& rgb, const ColorRange& range) {
  cv::Mat image = rgb;
  if (range.space == ColorSpace::hsv) cv::cvtColor(rgb, image = cv::Mat(), cv::COLOR_RGB2HSV);
  if (range.space == ColorSpace::excess) image = excess_of(rgb);
  cv::Mat mask;
  if (range.space != ColorSpace::hsv || range.low[0] <= range.high[0]) {
    cv::inRange(image, scalar(range.low), scalar(range.high), mask);
    return mask;
  }
  cv::Mat other;  // the hue wraps around: [low, 255] or [0, high]
  cv::inRange(image, scalar(range.low), scalar({255, range.high[1], range.high[2]}), mask);
  cv::inRange(image, scalar({0, range.low[1], range.low[2]}), scalar(range.high), other);
  cv::bitwise_or(mask, other, mask);
  return mask;
}

}  // namespace

ColorComponents find_components(std::span<const std::uint8_t> rgb, int width, int height, ImageLayout layout,
                                const ColorRange& range) {
  prepare_opencv();
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  auto* const pixels = const_cast<std::uint8_t*>(rgb.data());  // OpenCV accepts no pointers to const
  cv::Mat image(height, width, CV_8UC3, pixels);
  if (layout == ImageLayout::chw) {
    const std::array<cv::Mat, 3> planes{cv::Mat(height, width, CV_8UC1, pixels), cv::Mat(height, width, CV_8UC1, pixels + plane),
                                        cv::Mat(height, width, CV_8UC1, pixels + 2 * plane)};
    cv::merge(planes.data(), 3, image = cv::Mat());
  }
  ColorComponents found;
  found.labels.resize(plane);
  cv::Mat labels(height, width, CV_32SC1, found.labels.data());
  cv::Mat stats, centroids;
  const int count = cv::connectedComponentsWithStats(mask_of(image, range), labels, stats, centroids, 8, CV_32S);
  for (int i = 1; i < count; ++i) {  // label 0 is the background
    found.list.push_back({.x = stats.at<int>(i, cv::CC_STAT_LEFT),
                          .y = stats.at<int>(i, cv::CC_STAT_TOP),
                          .width = stats.at<int>(i, cv::CC_STAT_WIDTH),
                          .height = stats.at<int>(i, cv::CC_STAT_HEIGHT),
                          .area = stats.at<int>(i, cv::CC_STAT_AREA),
                          .center_x = centroids.at<double>(i, 0) + 0.5,
                          .center_y = centroids.at<double>(i, 1) + 0.5});
  }
  return found;
}

}  // namespace flockstep::imaging

namespace flockstep {

void ColorRange::validate() const {
  const auto text = [](const std::array<int, 3>& values) {
    return "(" + std::to_string(values[0]) + ", " + std::to_string(values[1]) + ", " + std::to_string(values[2]) + ")";
  };
  check_fields(*this, "color.");
  for (std::size_t k = space == ColorSpace::hsv ? 1 : 0; k < 3; ++k) {
    require(low[k] <= high[k], "color.low", "no channel above high, which is " + text(high) + " (only a hue wraps around)",
            text(low));
  }
}

}  // namespace flockstep
