#include "dynamics/impact.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

namespace flockstep::dynamics {
namespace {

using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

constexpr double kSlow = 0.05;  // m/s; slower impacts do not bounce, otherwise a body at rest would hop forever
constexpr int kMostRounds = 1000;
constexpr double kConverged = 1e-7;  // largest change of a point's speed in the last round, over the impact speed
constexpr double kSettled = 1e-3;    // largest accepted speed into the surface, over the impact speed
constexpr double kRelaxation = 1.3;  // needed the fewest rounds in measurements with boxes and random faces

// A body's motion about its centre of mass, world frame.
struct Twist {
  Vec3d linear;   // m/s
  Vec3d angular;  // rad/s

  Vec3d at(const Vec3d& arm) const { return linear + angular.cross(arm); }
};

// A contact point of the body.
struct Touching {
  Vec3d arm;      // m, from the centre of mass
  double leaves;  // m/s, minimum speed along the normal after the impact
  double across;  // m/s along the normal per Ns of normal impulse at the point
  double along;   // m/s in the surface per Ns of tangential impulse, upper bound
  Vec3d impulse;  // Ns
};

class Impact {
 public:
  Impact(const Mat3d& rotation, const Airframe& frame, const Vec3d& normal)
      : normal_(normal), mass_(frame.mass_kg), inverse_mass_(1.0 / frame.mass_kg) {
    const Vec3d inertia(frame.inertia_kgm2[0], frame.inertia_kgm2[1], frame.inertia_kgm2[2]);
    inertia_ = rotation * inertia.asDiagonal() * rotation.transpose();
    inverse_inertia_ = rotation * inertia.cwiseInverse().asDiagonal() * rotation.transpose();
  }

  void add(const Vec3d& arm) {
    const Vec3d turn = arm.cross(normal_);
    const double across = inverse_mass_ + turn.dot(inverse_inertia_ * turn);
    Mat3d cross;
    for (int axis = 0; axis < 3; ++axis) cross.col(axis) = arm.cross(Vec3d::Unit(axis));
    const double all = 3.0 * inverse_mass_ + (cross.transpose() * inverse_inertia_ * cross).trace();
    points_[count_++] = {arm, 0.0, across, all - across, Vec3d::Zero()};
  }

  bool bounces(const Twist& before, double restitution) {
    return restitution > 0.0 &&
           std::ranges::any_of(points(), [&](const Touching& point) { return before.at(point.arm).dot(normal_) < -kSlow; });
  }

  // The motion after the impact. If several points touch, or one of them slides, applying restitution to each point separately
  // can add energy. If it does, the result is a blend of the solutions with and without restitution, weighted so that the
  // energy equals the energy before the impact. Such a blend exists because the solution without restitution loses energy. The
  // impulses of both solutions lie within the friction cone, so those of the blend do, too.
  Twist bounce(const Twist& before, const Surface& surface) {
    Twist hard = solve(before, surface);
    if (!is_settled_) hard = solve(before, {surface.restitution, 0.0});  // strong friction can prevent convergence
    if (!is_settled_) return press(before, surface.friction);
    if (energy(hard) <= energy(before)) return hard;
    const Twist soft = press(before, surface.friction);
    const Twist way{hard.linear - soft.linear, hard.angular - soft.angular};
    const double half = 0.5 * work(soft, way);
    const double more = std::max(energy(before) - energy(soft), 0.0);
    const double share = std::clamp((std::sqrt(half * half + energy(way) * more) - half) / energy(way), 0.0, 1.0);
    return {soft.linear + share * way.linear, soft.angular + share * way.angular};
  }

  // The motion after contact without restitution: no point moves further into the surface.
  Twist press(const Twist& before, double friction) {
    const Twist rough = solve(before, {0.0, friction});
    if (is_settled_ && energy(rough) <= energy(before)) return rough;
    return solve(before, {0.0, 0.0});
  }

  // The angular velocity at `time` after an impact that changed it from `hit` to `after`. Without the impact it would have
  // become `end`. The torques change the angular velocity as much as they would have without the impact. The gyroscopic change
  // depends on the rotation itself and adds no energy.
  Vec3d turned(const Vec3d& after, const Vec3d& hit, const Vec3d& end, double time) const {
    const Vec3d torque = end - coasted(hit, time);
    const Vec3d turned = coasted(after, time) + torque;
    const double most =
        energy({Vec3d::Zero(), after}) + std::max(energy({Vec3d::Zero(), end}) - energy({Vec3d::Zero(), hit}), 0.0);
    const double is = energy({Vec3d::Zero(), turned});
    return is > most ? Vec3d(std::sqrt(most / is) * turned) : turned;
  }

 private:
  std::span<Touching> points() { return std::span(points_).first(count_); }

  Twist solve(const Twist& before, const Surface& surface) {
    double fastest = kSlow;
    for (Touching& point : points()) {
      const Vec3d velocity = before.at(point.arm);
      const double came = velocity.dot(normal_);
      point.leaves = came < -kSlow ? -surface.restitution * came : 0.0;
      point.impulse = Vec3d::Zero();
      fastest = std::max(fastest, velocity.norm());
    }
    Twist motion = before;
    for (int round = 0; round < kMostRounds; ++round) {
      double changed = 0.0;
      for (Touching& point : points()) changed = std::max(changed, push(point, surface.friction, motion));
      if (changed <= kConverged * fastest) break;
    }
    is_settled_ = std::ranges::all_of(
        points(), [&](const Touching& point) { return motion.at(point.arm).dot(normal_) >= -kSettled * fastest; });
    return motion;
  }

  // Corrects the impulse of one point. Returns the change of its speed.
  double push(Touching& point, double friction, Twist& motion) const {
    const Vec3d velocity = motion.at(point.arm);
    const double speed = velocity.dot(normal_);
    const double before = point.impulse.dot(normal_);
    const double pressed = std::max(before + kRelaxation * (point.leaves - speed) / point.across, 0.0);
    Vec3d rubbed = point.impulse - before * normal_ - kRelaxation / point.along * (velocity - speed * normal_);
    if (!std::isinf(friction)) {
      if (const double most = friction * pressed, size = rubbed.norm(); size > most) rubbed *= most / size;
    }
    const Vec3d change = pressed * normal_ + rubbed - point.impulse;
    point.impulse += change;
    motion.linear += inverse_mass_ * change;
    motion.angular += inverse_inertia_ * point.arm.cross(change);
    return change.norm() * (point.across + point.along);
  }

  // Torque-free rotation by Euler's equations, first order, scaled to conserve the energy.
  Vec3d coasted(const Vec3d& angular, double time) const {
    const Vec3d later = angular - time * (inverse_inertia_ * angular.cross(inertia_ * angular));
    const double is = later.dot(inertia_ * later);
    return is > 0.0 ? Vec3d(std::sqrt(angular.dot(inertia_ * angular) / is) * later) : angular;
  }

  // Inner product of two motions, J: for equal motions twice the kinetic energy.
  double work(const Twist& a, const Twist& b) const {
    return mass_ * a.linear.dot(b.linear) + a.angular.dot(inertia_ * b.angular);
  }
  double energy(const Twist& motion) const { return 0.5 * work(motion, motion); }  // J

  Vec3d normal_;
  double mass_, inverse_mass_;
  Mat3d inertia_, inverse_inertia_;  // world frame
  std::array<Touching, kMostPoints> points_;
  std::size_t count_ = 0;
  bool is_settled_ = true;
};

}  // namespace

Rebound thrown_back(const Velocity& at_hit, const Velocity& at_end, double left_s, const Pose& pose, std::span<const Vec3> points,
                    const Vec3& normal, const Airframe& frame, const Surface& surface) {
  assert(points.size() <= kMostPoints);
  const Mat3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
  const auto motion = [&](const Velocity& velocity) {
    return Twist{velocity.linear.cast<double>(), rotation * velocity.angular.cast<double>()};
  };
  const auto velocity = [&](const Twist& twist) {
    return Velocity{twist.linear.cast<float>(), (rotation.transpose() * twist.angular).cast<float>()};
  };
  const Twist before = motion(at_hit);
  Impact impact(rotation, frame, normal.cast<double>());
  for (const Vec3& point : points) impact.add((point - pose.position).cast<double>());
  const Twist free = motion(at_end);
  if (!impact.bounces(before, surface.restitution)) {
    return {velocity(impact.press(before, surface.friction)), velocity(impact.press(free, surface.friction))};
  }
  const Twist after = impact.bounce(before, surface);
  const Twist end{after.linear + (free.linear - before.linear),
                  impact.turned(after.angular, before.angular, free.angular, left_s)};
  return {velocity(after), velocity(impact.press(end, surface.friction))};
}

}  // namespace flockstep::dynamics
