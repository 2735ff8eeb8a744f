// Resample: makes an image smaller. Each pixel of the small image is the mean, least or greatest value of the pixels that it
// covers. OpenCV's resize with INTER_AREA computes the same means and is the test's oracle; it is not called here because it
// builds tables on the heap in every call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/camera.hpp"

namespace flockstep::imaging {

// Owned by one thread; it grows to the widest image and stays.
struct ResampleScratch {
  std::vector<float> floats;    // a row of uint8 pixels, reduced over the rows that a small pixel covers
  std::vector<double> doubles;  // the same of float pixels
};

class Resample {
 public:
  // From a size in pixels to one that is no larger along either axis.
  Resample(int from_width, int from_height, int to_width, int to_height, Pool pool);

  // Images (H, W, channels). Means of uint8 are rounded to the nearest, halves up. An infinite value makes the mean infinite.
  void operator()(const std::uint8_t* from, std::uint8_t* to, std::size_t channels, ResampleScratch& scratch) const;
  void operator()(const float* from, float* to, std::size_t channels, ResampleScratch& scratch) const;

 private:
  // The pixels of the large image that one of the small covers along an axis. Weights are their overlaps, whole numbers that sum
  // to the large image's length.
  struct Cover {
    std::uint32_t first;
    std::uint32_t count;
    std::uint32_t first_weight;  // into weights_
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
