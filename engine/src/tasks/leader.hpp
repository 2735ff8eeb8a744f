// Leader: the moving point of a formation, and the places of the drones relative to it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/tasks/formation.hpp"

namespace flockstep::task {

// LeaderRoute: the smooth way of a point along a line of corners.
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

// Places of M drones in a shape that turns with the leader, and in the column on its route that replaces the shape where there
// is no room for it.
struct FormationPlaces {
  bool is_column = false;      // the shape is the column
  std::vector<Vec3> shape;     // (M,) m, relative to the leader
  std::vector<double> column;  // (M,) m, along the route from the leader

  FormationPlaces() = default;
  // The column has the order of the shape from front to back, and the same middle.
  FormationPlaces(FormationShape kind, std::size_t count, float spacing_m)
      : is_column(kind == FormationShape::column), shape(formation_places(kind, count, spacing_m)), column(count) {
    const std::vector<Vec3> in_a_row = formation_places(FormationShape::column, count, spacing_m);
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return shape[a].x() > shape[b].x(); });
    double shift = 0.0;
    for (std::size_t i = 0; i < count; ++i) shift += static_cast<double>(shape[i].x()) - static_cast<double>(in_a_row[i].x());
    for (std::size_t i = 0; i < count; ++i) {
      column[order[i]] = static_cast<double>(in_a_row[i].x()) + shift / static_cast<double>(count);
    }
  }

  // m, distance from the leader of the farthest place that turns with it.
  double radius() const {
    double farthest = 0.0;
    if (is_column) return farthest;
    for (const Vec3& place : shape) farthest = std::max(farthest, static_cast<double>(place.norm()));
    return farthest;
  }
};

class Leader {
 public:
  // share: of the shape in the places; the rest is that of the column.
  Leader(const LeaderRoute& route, double way, double share)
      : route_(route), way_(way), share_(share), position_(route.position(way)), heading_(route.heading(way)) {}

  Quat rotation() const {
    return {static_cast<float>(std::cos(heading_ / 2.0)), 0.0F, 0.0F, static_cast<float>(std::sin(heading_ / 2.0))};
  }
  Eigen::Vector3d in_shape(const Vec3& offset) const {
    const Eigen::Vector3d o = offset.cast<double>();
    const double c = std::cos(heading_), s = std::sin(heading_);
    return position_ + Eigen::Vector3d(c * o.x() - s * o.y(), s * o.x() + c * o.y(), o.z());
  }
  Eigen::Vector3d in_column(double offset) const { return route_.position(way_ + offset); }
  Eigen::Vector3d place(const FormationPlaces& places, std::size_t drone) const {
    if (share_ == 1.0) return in_shape(places.shape[drone]);
    const Eigen::Vector3d column = in_column(places.column[drone]);
    return share_ == 0.0 ? column : Eigen::Vector3d(column + share_ * (in_shape(places.shape[drone]) - column));
  }

 private:
  LeaderRoute route_;
  double way_, share_;
  Eigen::Vector3d position_;  // m
  double heading_;            // rad
};

}  // namespace flockstep::task
