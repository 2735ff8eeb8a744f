// Route: a polyline with rounded corners, as a function of the distance along it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "flockstep/body.hpp"

namespace flockstep::bodies {

// Each corner is an arc that is tangent to both legs and uses at most half of each, so its radius may be smaller than
// corner_radius_m. A corner where the route turns back stays sharp. A loop starts where the arc of its first point ends.
// `back_and_forth` is the loop over the points and, without the two ends, back.
class Route {
 public:
  struct Place {
    Eigen::Vector3d position;   // m
    Eigen::Vector3d direction;  // unit, of travel
    Eigen::Vector2d heading;    // unit, horizontal direction of travel; the one before where the way is vertical
    double turn;                // rad per m, of the heading
  };

  Route() = default;
  // The motion must be valid, and of the kind `waypoints`.
  explicit Route(const BodyMotion& motion);

  double length() const { return length_; }  // m, of the round trip
  // Returns an upper bound of how far (m) the route leaves the straight and uniform motion between the ends of a part this long.
  double bend(double part_m) const;
  // Distances are in [0, length()]. Allocates nothing.
  Place at(double distance_m) const;

 private:
  // A straight line, or an arc towards `inward`.
  struct Piece {
    double begin;               // m, along the route
    double radius;              // 0: a line
    Eigen::Vector3d start;      // m
    Eigen::Vector3d direction;  // unit, at the start
    Eigen::Vector3d inward;     // unit, from the start to the centre of the arc
    Eigen::Vector2d heading;    // unit; for places where the way is vertical
  };

  static Place place_on(const Piece& piece, double distance_m);
  void add_line(const Eigen::Vector3d& start, const Eigen::Vector3d& direction, double length);
  void add_arc(const Eigen::Vector3d& start, const Eigen::Vector3d& direction, const Eigen::Vector3d& inward, double radius,
               double angle);
  void set_headings(bool is_loop);

  std::vector<Piece> pieces_;
  double length_ = 0.0;
  double sharpest_ = 0.0;   // sine of half the largest turn at a corner without an arc
  double curvature_ = 0.0;  // 1/m, largest of an arc
};

}  // namespace flockstep::bodies
