// Path: the motion from one pose to another, in double precision.
#pragma once

#include <algorithm>
#include <cmath>

#include "flockstep/pose.hpp"

namespace flockstep::collision {

// The position moves along the segment and the rotation along the shortest arc, both uniformly over time 0 to 1. The rotation's
// axis is constant, so R(t) = R(0) exp(t angle [axis]) with the axis in the body frame.
struct Path {
  Path(const Pose& from, const Pose& to)
      : start(from.position.cast<double>()),
        velocity(to.position.cast<double>() - start),
        first(from.rotation.cast<double>().normalized()),
        first_matrix(first.toRotationMatrix()) {
    if (from.rotation.coeffs() == to.rotation.coeffs()) return;
    Eigen::Quaterniond turn = first.conjugate() * to.rotation.cast<double>().normalized();
    if (turn.w() < 0.0) {  // q and -q are the same rotation: take the shorter arc; at a half turn (w = 0) the signs decide
      turn.coeffs() = -turn.coeffs();
    }
    const double sine = turn.vec().norm();
    if (sine > kMinSine) {
      axis = turn.vec() / sine;
      angle = 2.0 * std::atan2(sine, turn.w());
    }
  }

  Eigen::Vector3d position(double time) const { return start + time * velocity; }

  Eigen::Quaterniond rotation(double time) const {
    return angle == 0.0 ? first : first * Eigen::Quaterniond(Eigen::AngleAxisd(time * angle, axis));
  }

  Eigen::Matrix3d matrix(double time) const {
    if (angle == 0.0 || time == 0.0) return first_matrix;
    return first_matrix * Eigen::AngleAxisd(time * angle, axis).toRotationMatrix();
  }

  bool turns() const { return angle != 0.0; }

  // Returns an upper bound of the speed of points at most `radius` (m) from the origin.
  double fastest(double radius) const { return velocity.norm() + angle * radius; }

  // Returns the part of the motion from one time to another, as a motion over time 0 to 1.
  Path part(double begin, double end) const {
    Path path = *this;
    path.start = position(begin);
    path.velocity = (end - begin) * velocity;
    path.first = rotation(begin);
    path.first_matrix = matrix(begin);
    path.angle = (end - begin) * angle;
    return path;
  }

  static constexpr bool kTurnsRelative = false;  // other than RelativePath
  static constexpr double kMinSine = 1e-9;       // smaller turns are below the resolution of a float

  Eigen::Vector3d start;                            // m, world frame
  Eigen::Vector3d velocity;                         // m per unit of time
  Eigen::Quaterniond first;                         // rotation at time 0
  Eigen::Matrix3d first_matrix;                     // the same as a matrix
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  // unit, body frame
  double angle = 0.0;                               // rad per unit of time, in [0, pi]
};

// RelativePath: the motion of a hull as seen from a body that turns, in double precision.
// Hull and body move along their Paths; the frame is that of the body's last pose B(1). The hull's pose H(t) is therefore
// B(1) B(t)^-1 H(t): exact at every time, and at time 1 the hull's own pose. With the body's turning axis A (world frame),
// position b, angle beta and Q(t) = exp((1 - t) beta [A]), it has the rotation Q R(t) and the position b(1) + Q (h - b).
class RelativePath {
 public:
  static constexpr bool kTurnsRelative = true;

  RelativePath(const Path& hull, const Path& body)
      : hull_(hull),
        body_start_(body.start),
        body_velocity_(body.velocity),
        body_axis_(body.first_matrix * body.axis),
        body_angle_(body.angle) {}

  bool turns() const { return true; }
  const Path& hull() const { return hull_; }
  const Eigen::Vector3d& body_axis() const { return body_axis_; }  // unit, world frame
  double body_angle() const { return body_angle_; }                // rad per unit of time

  // Q(t), which turns directions from time t to time 1.
  Eigen::Matrix3d turn(double time) const { return Eigen::AngleAxisd((1.0 - time) * body_angle_, body_axis_).toRotationMatrix(); }
  Eigen::Vector3d body(double time) const { return body_start_ + time * body_velocity_; }
  Eigen::Vector3d apart(double time) const { return hull_.position(time) - body(time); }
  Eigen::Vector3d velocity() const { return hull_.velocity - body_velocity_; }

  Eigen::Vector3d position(double time) const { return body(1.0) + turn(time) * apart(time); }
  Eigen::Matrix3d matrix(double time) const { return turn(time) * hull_.matrix(time); }

  // Returns an upper bound of the acceleration of a point of the hull at most `radius` (m) from its origin. In the body's frame
  // it is w^2 r for the hull's own turn, plus 2 beta |velocity| and beta^2 |distance from b|.
  double acceleration(double radius) const {
    const double turning = hull_.angle + body_angle_;
    const double farthest = farthest_apart();
    return turning * turning * radius + 2.0 * body_angle_ * velocity().norm() + body_angle_ * body_angle_ * farthest;
  }

  // Returns an upper bound of the speed of such a point.
  double fastest(double radius) const {
    return velocity().norm() + (hull_.angle + body_angle_) * radius + body_angle_ * farthest_apart();
  }

 private:
  double farthest_apart() const { return std::max(apart(0.0).norm(), apart(1.0).norm()); }  // the distance is convex in time

  Path hull_;
  Eigen::Vector3d body_start_;     // m, world frame
  Eigen::Vector3d body_velocity_;  // m per unit of time
  Eigen::Vector3d body_axis_;
  double body_angle_;
};

}  // namespace flockstep::collision
