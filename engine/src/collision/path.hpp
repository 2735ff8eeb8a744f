// Path: the motion from one pose to another, in double precision.
#pragma once

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

}  // namespace flockstep::collision
