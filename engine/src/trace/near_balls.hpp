// Finds the balls within range of a point. Balls move in each tick: one search reads the rows of the arrays that hold them, and
// BallSlices copies them for many. The shapes of a world stay in place, and a ShapeTree finds them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep::trace {

struct Balls {
  const float* center = nullptr;  // (count, 3) m, world frame
  const float* radius = nullptr;  // (count,) m; negative: this ball is never found
  std::size_t count = 0;
};

// Writes the numbers of the balls that reach into a ball of range_m around the origin to found, in ascending order, and returns
// how many there are. found: (count,).
std::size_t find_near_balls(const Balls& balls, const Vec3& origin, float range_m, std::uint32_t* found);

// Balls in an array for each coordinate. A search in such copies is faster, because it may read and write beyond the last ball:
// all arrays are readable for kPadding more elements. In rows, another thread may be writing there.
struct BallColumns {
  static constexpr std::size_t kPadding = 16;  // a vector

  const float *x = nullptr, *y = nullptr, *z = nullptr, *radius = nullptr;  // (count,) m
  std::size_t count = 0;
};

// Finds the same balls. found: (count + kPadding,).
std::size_t find_near_balls(const BallColumns& balls, const Vec3& origin, float range_m, std::uint32_t* found);

// BallSlices: balls in slices across the axis along which they spread the most, for many searches among the same balls. A
// search tests only the slices that it reaches.
class BallSlices {
 public:
  // Takes the balls whose radius is not negative. Allocates only if there are more than ever before.
  void sort(const Balls& balls);

  // Finds the same balls as find_near_balls(), in the order of their slices. found: has room for all balls and
  // BallColumns::kPadding more.
  std::size_t find(const Vec3& origin, float range_m, std::uint32_t* found) const;

  // Calls f(a, b) once for each pair of balls that overlap.
  template <class F>
  void for_each_pair(const F& f) {
    found_.resize(numbers_.size() + BallColumns::kPadding);
    for (std::size_t i = 0; i < numbers_.size(); ++i) {
      const Vec3 center(columns_[0][i], columns_[1][i], columns_[2][i]);
      const std::size_t count = find_between(i + 1, end_within(center, radii_[i]), center, radii_[i], found_.data());
      for (std::size_t k = 0; k < count; ++k) f(std::size_t{numbers_[i]}, std::size_t{found_[k]});
    }
  }

 private:
  std::size_t slice_of(float coordinate) const;  // monotone
  // Returns how far from a coordinate a ball's centre can be if the ball reaches into a range, with rounding.
  float reach_of(float coordinate, float range_m) const;
  std::size_t end_within(const Vec3& origin, float range_m) const;
  std::size_t find_between(std::size_t first, std::size_t end, const Vec3& origin, float range_m, std::uint32_t* found) const;

  int axis_ = 0;
  float lowest_ = 0.0F;  // m, smallest coordinate along the axis
  float slices_per_m_ = 0.0F;
  float last_slice_ = 0.0F;            // its number
  float largest_ = 0.0F;               // m, largest radius
  std::vector<std::uint32_t> begins_;  // (slices + 1,) index of the first ball of each slice
  // the balls, slice by slice, and in a slice in ascending order of their numbers
  std::vector<std::uint32_t> numbers_;
  std::array<std::vector<float>, 3> columns_;  // x, y and z of the centres, m; padded
  std::vector<float> radii_;                   // m; padded
  std::vector<std::uint32_t> found_;           // for one search
};

}  // namespace flockstep::trace
