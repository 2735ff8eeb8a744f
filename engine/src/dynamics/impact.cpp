#include "dynamics/impact.hpp"

#include <Eigen/Dense>
#include <algorithm>

namespace flockstep::dynamics {
namespace {

using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

constexpr double kSlow = 0.05;  // m/s; what comes slower does not bounce, or a body at rest would hop for ever

}  // namespace

Velocity thrown_back(const Velocity& at_hit, const Velocity& at_end, const Pose& pose, const Vec3& point, const Vec3& normal,
                     const Airframe& frame, const Surface& surface) {
  const Mat3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
  const Vec3d inverse_inertia(1.0 / frame.inertia_kgm2[0], 1.0 / frame.inertia_kgm2[1], 1.0 / frame.inertia_kgm2[2]);
  const Vec3d arm = (point - pose.position).cast<double>();
  const Vec3d n = normal.cast<double>();
  const auto at_point = [&](const Velocity& velocity) {
    return Vec3d(velocity.linear.cast<double>() + (rotation * velocity.angular.cast<double>()).cross(arm));
  };
  const Vec3d velocity = at_point(at_end);
  const double came = std::min(at_point(at_hit).dot(n), 0.0);
  const double since = std::min((velocity - at_point(at_hit)).dot(n), 0.0);
  const double goes = std::max((came < -kSlow ? -surface.restitution * came : 0.0) + since, 0.0);
  const double leave = goes - velocity.dot(n);  // m/s, to be gained along the normal
  if (leave <= 0.0) return at_end;

  // The velocity that the point gains by an impulse on it.
  const auto gain = [&](const Vec3d& impulse) {
    const Vec3d turned = inverse_inertia.cwiseProduct(Vec3d(rotation.transpose() * arm.cross(impulse)));
    return Vec3d(impulse / frame.mass_kg + (rotation * turned).cross(arm));
  };
  Mat3d gains;
  for (int axis = 0; axis < 3; ++axis) gains.col(axis) = gain(Vec3d::Unit(axis));
  // 2 (energy after - energy before) = J . (2 v + K J)
  const auto gives_energy = [&](const Vec3d& impulse) { return impulse.dot(2.0 * velocity + gains * impulse) > 0.0; };

  // The point sticks where that takes no more than friction has; else it slides on, friction against it; and where either would
  // give energy, as it can to what is hit aslant, it slides freely.
  const Vec3d sliding = velocity - velocity.dot(n) * n;
  Vec3d impulse = gains.ldlt().solve(Vec3d(leave * n - sliding));
  const double push = impulse.dot(n);
  if ((impulse - push * n).norm() > surface.friction * push || gives_energy(impulse)) {
    impulse = leave / n.dot(gains * n) * n;
    if (const double speed = sliding.norm(); speed > 1e-9) {
      const Vec3d along = n - surface.friction / speed * sliding;
      const double rubbed = leave / n.dot(gains * along);
      if (rubbed > 0.0 && !gives_energy(rubbed * along)) impulse = rubbed * along;
    }
  }
  const Vec3d turned = inverse_inertia.cwiseProduct(Vec3d(rotation.transpose() * arm.cross(impulse)));
  return {(at_end.linear.cast<double>() + impulse / frame.mass_kg).cast<float>(),
          (at_end.angular.cast<double>() + turned).cast<float>()};
}

}  // namespace flockstep::dynamics
