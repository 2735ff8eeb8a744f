// Resample: shrinks an image. Each output pixel is the mean, minimum or maximum of the input pixels that it covers. OpenCV's
// resize with INTER_AREA computes the same means and is the reference in the test. We do not call it here because it
// allocates tables on the heap in every call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/sensors/camera.hpp"

namespace flockstep::imaging {

// Working memory of one thread. It grows to the largest image and is kept.
struct HsvScratch {
  std::vector<std::uint8_t> rgb, hsv;  // (H, W, 3)
};

// Both images have 3 * width * height values in the same layout. Hue is half the angle in degrees, in [0, 179]; saturation
// and value are in [0, 255].
void rgb_to_hsv(const std::uint8_t* rgb, int width, int height, ImageLayout layout, std::uint8_t* hsv, HsvScratch& scratch);

// Working memory of one thread. It grows to the widest image and is kept.
struct ResampleScratch {
  std::vector<float> floats;    // a row of uint8 pixels, reduced over the rows that an output pixel covers
  std::vector<double> doubles;  // the same for float pixels
};

class Resample {
 public:
  // The output size in pixels must not exceed the input size along either axis.
  Resample(int from_width, int from_height, int to_width, int to_height, Pool pool);

  // Resamples an image (H, W, channels). Means of uint8 are rounded to nearest, halves up. An infinite value makes the mean
  // infinite.
  void operator()(const std::uint8_t* from, std::uint8_t* to, std::size_t channels, ResampleScratch& scratch) const;
  void operator()(const float* from, float* to, std::size_t channels, ResampleScratch& scratch) const;

 private:
  // The input pixels that one output pixel covers along an axis. The weights are the overlaps, integers that sum to the
  // length of the input image.
  struct Cover {
    std::uint32_t first;
    std::uint32_t count;
    std::uint32_t first_weight;  // index into weights_
  };
  template <class Value, class Sum>
  void run(const Value* from, Value* to, std::size_t channels, std::vector<Sum>& row) const;
  std::vector<Cover> covers(std::size_t from, std::size_t to);

  Pool pool_;
  std::size_t from_width_, from_height_;
  std::vector<float> weights_;
  std::vector<Cover> columns_, rows_;
};

}  // namespace flockstep::imaging
