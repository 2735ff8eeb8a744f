#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "trace/near_balls.hpp"

namespace flockstep::trace {
namespace {

constexpr std::size_t kMaxUnsliced = 32;      // so few balls are searched as fast without slices
constexpr float kSliceRounding = 2e-5F;       // fraction of distances; more than find_near_balls() adds
constexpr float kCoordinateRounding = 1e-6F;  // fraction of coordinates

}  // namespace

void BallSlices::sort(const Balls& balls) {
  Vec3 low = Vec3::Constant(std::numeric_limits<float>::infinity()), high = -low;
  std::size_t count = 0;
  largest_ = 0.0F;
  for (std::size_t i = 0; i < balls.count; ++i) {
    if (!(balls.radius[i] >= 0.0F)) continue;
    const Vec3 center = Vec3::Map(balls.center + 3 * i);
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
    largest_ = std::max(largest_, balls.radius[i]);
    ++count;
  }
  const std::size_t slices = count <= kMaxUnsliced ? 1 : count;
  float extent = 0.0F;
  if (count > 0) extent = (high - low).maxCoeff(&axis_);
  lowest_ = count > 0 ? low[axis_] : 0.0F;
  slices_per_m_ = slices > 1 && extent > 0.0F ? static_cast<float>(slices) / extent : 0.0F;
  last_slice_ = static_cast<float>(slices - 1);
  numbers_.resize(count);
  for (std::vector<float>& column : columns_) column.resize(count + BallColumns::kPadding);
  radii_.resize(count + BallColumns::kPadding);
  // A counting sort.
  const auto slice_of_ball = [&](std::size_t i) { return slice_of(balls.center[3 * i + static_cast<std::size_t>(axis_)]); };
  begins_.assign(slices + 1, 0);
  for (std::size_t i = 0; i < balls.count; ++i) {
    if (balls.radius[i] >= 0.0F) ++begins_[slice_of_ball(i)];
  }
  std::uint32_t end = 0;
  for (std::uint32_t& begin : begins_) begin = end += begin;  // the ends of the slices
  for (std::size_t i = balls.count; i-- > 0;) {               // from the end, so that each slice is in ascending order
    if (!(balls.radius[i] >= 0.0F)) continue;
    const std::uint32_t to = --begins_[slice_of_ball(i)];
    numbers_[to] = static_cast<std::uint32_t>(i);
    for (std::size_t axis = 0; axis < 3; ++axis) columns_[axis][to] = balls.center[3 * i + axis];
    radii_[to] = balls.radius[i];
  }
}

std::size_t BallSlices::find(const Vec3& origin, float range_m, std::uint32_t* found) const {
  if (numbers_.empty()) return 0;
  const float coordinate = origin[axis_];
  const std::size_t first = begins_[slice_of(coordinate - reach_of(coordinate, range_m))];
  return find_between(first, end_within(origin, range_m), origin, range_m, found);
}

std::size_t BallSlices::slice_of(float coordinate) const {
  return static_cast<std::size_t>(std::min(std::max(0.0F, (coordinate - lowest_) * slices_per_m_), last_slice_));
}

float BallSlices::reach_of(float coordinate, float range_m) const {
  return (range_m + largest_) * (1.0F + kSliceRounding) + kCoordinateRounding * std::abs(coordinate);
}

std::size_t BallSlices::end_within(const Vec3& origin, float range_m) const {
  const float coordinate = origin[axis_];
  return begins_[slice_of(coordinate + reach_of(coordinate, range_m)) + 1];
}

std::size_t BallSlices::find_between(std::size_t first, std::size_t end, const Vec3& origin, float range_m,
                                     std::uint32_t* found) const {
  if (first >= end) return 0;
  const BallColumns balls{columns_[0].data() + first, columns_[1].data() + first, columns_[2].data() + first,
                          radii_.data() + first, end - first};
  const std::size_t count = find_near_balls(balls, origin, range_m, found);
  for (std::uint32_t& each : std::span(found, count)) each = numbers_[first + each];
  return count;
}

}  // namespace flockstep::trace
