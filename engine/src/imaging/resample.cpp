#include "imaging/resample.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <type_traits>

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

namespace {

// Sets into[i] = combine(into[i], from[i]) for a row. The compiler vectorises the loop.
template <class Value, class Sum, class Combine>
void combine_row(const Value* from, std::size_t count, Sum* into, const Combine& combine) {
  for (std::size_t i = 0; i < count; ++i) into[i] = combine(into[i], static_cast<Sum>(from[i]));
}

}  // namespace

Resample::Resample(int from_width, int from_height, int to_width, int to_height, Pool pool)
    : pool_(pool),
      from_width_(static_cast<std::size_t>(from_width)),
      from_height_(static_cast<std::size_t>(from_height)),
      columns_(covers(from_width_, static_cast<std::size_t>(to_width))),
      rows_(covers(from_height_, static_cast<std::size_t>(to_height))) {}

// Measures in units in which an input pixel has the length `to` and an output pixel has the length `from`. All ends are then
// integers.
std::vector<Resample::Cover> Resample::covers(std::size_t from, std::size_t to) {
  std::vector<Cover> covers;
  for (std::size_t i = 0; i < to; ++i) {
    const std::size_t begin = i * from, end = begin + from;
    const std::size_t first = begin / to, last = (end + to - 1) / to;  // last: one past the end
    covers.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last - first),
                      static_cast<std::uint32_t>(weights_.size())});
    for (std::size_t j = first; j < last; ++j) {
      weights_.push_back(static_cast<float>(std::min(end, (j + 1) * to) - std::max(begin, j * to)));
    }
  }
  return covers;
}

// Reduces the rows first, then the columns of the remaining row. Sums of uint8 values are integers. A column sum is at most
// 255 * 8192, which a float holds exactly; the total is at most 2^34, which a double holds exactly.
template <class Value, class Sum>
void Resample::run(const Value* from, Value* to, std::size_t channels, std::vector<Sum>& row) const {
  const std::size_t values = from_width_ * channels;
  row.resize(values);
  const double area = static_cast<double>(from_width_) * static_cast<double>(from_height_);
  const auto least = [](auto a, auto b) { return b < a ? b : a; };
  const auto greatest = [](auto a, auto b) { return a < b ? b : a; };
  for (const Cover& down : rows_) {
    const Value* const top = from + down.first * values;
    const float* const weights = weights_.data() + down.first_weight;
    if (pool_ == Pool::mean) {
      std::fill(row.begin(), row.end(), Sum{0});
      for (std::size_t j = 0; j < down.count; ++j) {
        const auto weight = static_cast<Sum>(weights[j]);
        combine_row(top + j * values, values, row.data(), [=](Sum sum, Sum value) { return sum + weight * value; });
      }
    } else {
      std::copy_n(top, values, row.begin());
      for (std::size_t j = 1; j < down.count; ++j) {
        const Value* const next = top + j * values;
        if (pool_ == Pool::min) {
          combine_row(next, values, row.data(), least);
        } else {
          combine_row(next, values, row.data(), greatest);
        }
      }
    }
    for (const Cover& across : columns_) {
      for (std::size_t c = 0; c < channels; ++c) {
        const Sum* const left = row.data() + across.first * channels + c;
        if (pool_ == Pool::mean) {
          const float* const shares = weights_.data() + across.first_weight;
          double sum = 0.0;
          for (std::size_t j = 0; j < across.count; ++j)
            sum += static_cast<double>(shares[j]) * static_cast<double>(left[j * channels]);
          *to++ = static_cast<Value>(sum / area + (std::is_integral_v<Value> ? 0.5 : 0.0));
        } else {
          Sum found = left[0];
          for (std::size_t j = 1; j < across.count; ++j) {
            found = pool_ == Pool::min ? least(found, left[j * channels]) : greatest(found, left[j * channels]);
          }
          *to++ = static_cast<Value>(found);
        }
      }
    }
  }
}

void Resample::operator()(const std::uint8_t* from, std::uint8_t* to, std::size_t channels, ResampleScratch& scratch) const {
  run(from, to, channels, scratch.floats);
}

void Resample::operator()(const float* from, float* to, std::size_t channels, ResampleScratch& scratch) const {
  run(from, to, channels, scratch.doubles);
}

}  // namespace flockstep::imaging
