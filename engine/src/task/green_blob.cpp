#include "task/green_blob.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <opencv2/imgproc.hpp>

#include "render/appearance.hpp"

namespace flockstep::task {
namespace {

// Green is told by the ratio of the channels, which light scales alike. The goal, render::kGoalColor, is written with G about
// three times the larger of R and B, from (26, 120, 38) in full shade to (44, 207, 67) in full sun. White walls, the sky,
// blue-grey, red and yellow have a G no larger than R or B, the tint of the ambient light included, and no mixture of two of them
// at an edge has a ratio above 1.13 (yellow before a blue sky). With a threshold of 1.25, a pixel that shows the goal and
// something else counts if at least 43 % of it is goal before a white wall, or 47 % before a blue-grey pillar; either share
// changes by 15 % if one of the two is lit and the other in shade. So the box is the goal's to about half a pixel.
constexpr double kRatio = 1.25;
// Where it is almost dark, the ratio would be decided by rounding.
constexpr double kLeast = 16.0;

// These figures hold as long as the colours of markers are what they were derived from: with a gamma of 2.2, a ratio of 3 as
// written is one of 3^2.2 = 11.2 in linear light.
constexpr float green_ratio(const std::array<float, 3>& color) { return color[1] / std::max(color[0], color[2]); }
static_assert(green_ratio(render::kGoalColor) > 11.2F, "the goal is clearly green");
static_assert(green_ratio(render::kStartColor) < 1.0F && green_ratio(render::kWaypointColor) < 1.0F, "no other marker is");

// What goes to OpenCV at once. From 2^16 pixels on it shares its work with other threads, and while it waits for them, this one
// might be given another block of drones, with the scratch that is in use here.
constexpr std::size_t kMostPixels = 1U << 15U;

void threshold(const cv::Mat& red, const cv::Mat& green, const cv::Mat& blue, cv::Mat& larger, cv::Mat& mask) {
  cv::max(red, blue, larger);
  cv::addWeighted(green, 4.0, larger, -4.0 * kRatio, -4.0 * kLeast, mask);  // of whole numbers; below 0 it saturates
}

}  // namespace

GreenBlob find_green(std::span<const std::uint8_t> rgb, int width_px, int height_px, ImageLayout layout,
                     GreenBlobScratch& scratch) {
  const auto pixels = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  assert(rgb.size() == 3 * pixels);
  const std::size_t most = std::min(pixels, kMostPixels);
  if (scratch.planes.size() < 4 * most) scratch.planes.resize(4 * most);
  scratch.mask.resize(pixels);

  // OpenCV takes the pixels as one row: nothing here asks where a row ends, until the box.
  for (std::size_t first = 0; first < pixels; first += most) {
    const int count = static_cast<int>(std::min(most, pixels - first));
    const auto plane = [count](const std::uint8_t* values) {  // OpenCV's headers of data it only reads are not const
      return cv::Mat(1, count, CV_8UC1, const_cast<std::uint8_t*>(values));
    };
    cv::Mat larger = plane(scratch.planes.data());
    cv::Mat mask = plane(scratch.mask.data() + first);
    if (layout == ImageLayout::chw) {
      threshold(plane(rgb.data() + first), plane(rgb.data() + pixels + first), plane(rgb.data() + 2 * pixels + first), larger,
                mask);
    } else {
      std::array<cv::Mat, 3> channels;
      for (std::size_t k = 0; k < 3; ++k) channels[k] = plane(scratch.planes.data() + (k + 1) * most);
      cv::split(cv::Mat(1, count, CV_8UC3, const_cast<std::uint8_t*>(rgb.data() + 3 * first)), channels.data());
      threshold(channels[0], channels[1], channels[2], larger, mask);
    }
  }

  const cv::Rect box = cv::boundingRect(cv::Mat(height_px, width_px, CV_8UC1, scratch.mask.data()));
  GreenBlob blob;
  blob.found = box.width > 0;
  if (!blob.found) return blob;
  blob.x = box.x;
  blob.y = box.y;
  blob.width = box.width;
  blob.height = box.height;
  // Twice the centre is a whole number, so a box in the middle gives 0.
  blob.offset = static_cast<float>(2 * box.x + box.width - width_px) / static_cast<float>(width_px);
  blob.area = static_cast<float>(box.area()) / static_cast<float>(pixels);
  return blob;
}

}  // namespace flockstep::task
