// LeaderRoute: the smooth way of a point along a line of corners.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "flockstep/pose.hpp"

namespace flockstep::task {

// The polyline through the corners, averaged over a window: the corners are rounded, and on straight parts the point has the
// speed of the polyline. A closed one goes from the last corner back to the first, lap after lap; an open one ends at its last
// corner.
class LeaderRoute {
 public:
  static constexpr double kWindow = 1.0;  // m before and after a point

  // corners: (K, 3) m, kept by the caller.
  LeaderRoute(std::span<const float> corners, bool is_closed) : corners_(corners), is_closed_(is_closed) {
    for (std::size_t i = 0; i < num_segments(); ++i) length_ += length_of(i);
  }

  double length() const { return length_; }

  // Position after a way along the polyline, m.
  Eigen::Vector3d position(double way) const { return (integral(way + kWindow) - integral(way - kWindow)) / (2.0 * kWindow); }
  // Its derivative, by the way.
  Eigen::Vector3d direction(double way) const {
    return (corner_way(way + kWindow) - corner_way(way - kWindow)) / (2.0 * kWindow);
  }

 private:
  std::size_t num_corners() const { return corners_.size() / 3; }
  std::size_t num_segments() const { return num_corners() - (is_closed_ ? 0 : 1); }
  Eigen::Vector3d corner(std::size_t i) const { return Vec3::Map(corners_.data() + 3 * (i % num_corners())).cast<double>(); }
  double length_of(std::size_t segment) const { return (corner(segment + 1) - corner(segment)).norm(); }

  // The point on the polyline.
  Eigen::Vector3d corner_way(double way) const {
    if (is_closed_) way -= length_ * std::floor(way / length_);
    if (way <= 0.0) return corner(0);
    for (std::size_t i = 0; i < num_segments(); ++i) {
      const double length = length_of(i);
      if (way < length) return corner(i) + way / length * (corner(i + 1) - corner(i));
      way -= length;
    }
    return corner(num_segments());
  }

  // The integral of corner_way from 0. A closed polyline adds the same for each lap.
  Eigen::Vector3d integral(double way) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    if (is_closed_) {
      const double laps = std::floor(way / length_);
      if (laps != 0.0) sum = laps * integral_within(length_);
      way -= laps * length_;
    }
    return sum + integral_within(way);
  }
  Eigen::Vector3d integral_within(double way) const {
    if (way < 0.0) return way * corner(0);
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < num_segments() && way > 0.0; ++i) {
      const double length = length_of(i), part = std::min(way, length);
      if (length > 0.0) sum += part * (corner(i) + part / (2.0 * length) * (corner(i + 1) - corner(i)));
      way -= part;
    }
    return way > 0.0 ? Eigen::Vector3d(sum + way * corner(num_segments())) : sum;
  }

  std::span<const float> corners_;
  bool is_closed_;
  double length_ = 0.0;  // m
};

}  // namespace flockstep::task
