// LeaderRoute: the smooth way of a point along a line of corners.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "flockstep/pose.hpp"

namespace flockstep::task {

// The polyline through the corners, averaged over a window: the corners are rounded, and on straight parts the point has the
// speed of the polyline. Its distance from the polyline is at most half the window. A closed one goes from the last corner back
// to the first, lap after lap; an open one ends at its last corner.
class LeaderRoute {
 public:
  // corners: (K, 3) m, kept by the caller. window: m before and after a point. reach: m before and after a point, between which
  // its heading leads.
  LeaderRoute(std::span<const float> corners, bool is_closed, double window, double reach)
      : corners_(corners), is_closed_(is_closed), window_(window), reach_(reach) {
    for (std::size_t i = 0; i < num_segments(); ++i) length_ += length_of(i);
    if (is_closed_) reach_ = std::min(reach_, length_ / 4.0);
  }

  double length() const { return length_; }

  // Position after a way along the polyline, m.
  Eigen::Vector3d position(double way) const { return (integral(way + window_) - integral(way - window_)) / (2.0 * window_); }
  // Heading there, rad.
  double heading(double way) const {
    const Eigen::Vector3d along = position(way + reach_) - position(way - reach_);
    return std::atan2(along.y(), along.x());
  }

 private:
  std::size_t num_corners() const { return corners_.size() / 3; }
  std::size_t num_segments() const { return num_corners() - (is_closed_ ? 0 : 1); }
  Eigen::Vector3d corner(std::size_t i) const { return Vec3::Map(corners_.data() + 3 * (i % num_corners())).cast<double>(); }
  double length_of(std::size_t segment) const { return (corner(segment + 1) - corner(segment)).norm(); }

  // The integral of the point on the polyline from way 0. A closed polyline adds the same for each lap.
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
  double window_, reach_;  // m
  double length_ = 0.0;    // m
};

}  // namespace flockstep::task
