// Finds the balls within range of a point.
#pragma once

#include <cstddef>
#include <cstdint>

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

// Balls in an array for each coordinate, which the search reads faster. All arrays are readable for kPadding more elements.
struct BallColumns {
  static constexpr std::size_t kPadding = 16;  // a vector

  const float *x = nullptr, *y = nullptr, *z = nullptr, *radius = nullptr;  // (count,) m
  std::size_t count = 0;
};

// Finds the same balls. found: (count + kPadding,).
std::size_t find_near_balls(const BallColumns& balls, const Vec3& origin, float range_m, std::uint32_t* found);

}  // namespace flockstep::trace
