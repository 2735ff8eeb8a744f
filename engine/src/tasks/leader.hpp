// Leader: the moving point of a formation, and the places of the drones relative to it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

#include "flockstep/tasks/formation.hpp"
#include "flockstep/pose.hpp"
#include "tasks/route.hpp"

namespace flockstep::task {

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
