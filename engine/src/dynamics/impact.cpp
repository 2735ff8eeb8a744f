#include "dynamics/impact.hpp"

#include <Eigen/Dense>

namespace flockstep::dynamics {
namespace {

using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

constexpr double kSlow = 0.05;  // m/s; what comes slower does not bounce, or a body at rest would hop for ever

}  // namespace

Velocity thrown_back(const Velocity& before, const Pose& pose, const Vec3& point, const Vec3& normal, const Airframe& frame,
                     const Surface& surface) {
  const Mat3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
  const Vec3d inverse_inertia(1.0 / frame.inertia_kgm2[0], 1.0 / frame.inertia_kgm2[1], 1.0 / frame.inertia_kgm2[2]);
  const Vec3d arm = (point - pose.position).cast<double>();
  const Vec3d n = normal.cast<double>();
  Vec3d linear = before.linear.cast<double>();
  Vec3d turning = rotation * before.angular.cast<double>();  // world frame

  // The velocity that the point gains by an impulse on it.
  const auto gain = [&](const Vec3d& impulse) {
    const Vec3d turned = inverse_inertia.cwiseProduct(Vec3d(rotation.transpose() * arm.cross(impulse)));
    return Vec3d(impulse / frame.mass_kg + (rotation * turned).cross(arm));
  };
  const Vec3d at_point = linear + turning.cross(arm);
  const double approach = at_point.dot(n);
  if (approach >= 0.0) return before;
  const double restitution = approach < -kSlow ? surface.restitution : 0.0;
  const double leave = -(1.0 + restitution) * approach;  // m/s, gained along the normal in each of the cases below

  // The point sticks where that takes no more than friction has; else it slides on, friction against it; and where that would
  // give energy, as it can to what is hit aslant, it slides freely.
  Mat3d gains;
  for (int axis = 0; axis < 3; ++axis) gains.col(axis) = gain(Vec3d::Unit(axis));
  const Vec3d sliding = at_point - approach * n;
  Vec3d impulse = gains.ldlt().solve(Vec3d(leave * n - sliding));
  const double push = impulse.dot(n);
  if ((impulse - push * n).norm() > surface.friction * push) {
    const double free = leave / n.dot(gains * n);
    impulse = free * n;
    if (const double speed = sliding.norm(); speed > 1e-9) {
      const Vec3d along = n - surface.friction / speed * sliding;
      const double rubbed = leave / n.dot(gains * along);
      const Vec3d candidate = rubbed * along;
      // 2 (energy after - energy before) = J . (2 v + K J)
      const bool takes_energy = candidate.dot(2.0 * at_point + gains * candidate) <= 0.0;
      if (rubbed > 0.0 && takes_energy) impulse = candidate;
    }
  }
  linear += impulse / frame.mass_kg;
  const Vec3d turned = inverse_inertia.cwiseProduct(Vec3d(rotation.transpose() * arm.cross(impulse)));
  return {linear.cast<float>(), (before.angular.cast<double>() + turned).cast<float>()};
}

}  // namespace flockstep::dynamics
