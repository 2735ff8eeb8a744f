// RelativePath: the motion of a hull as seen from a body that turns, in double precision.
#pragma once

#include <algorithm>

#include "collision/path.hpp"

namespace flockstep::collision {

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
