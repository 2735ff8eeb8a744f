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

constexpr double kSlow = 0.05;  // m/s; what comes slower does not bounce, or a body at rest would hop for ever
constexpr int kMostRounds = 1000;
constexpr double kConverged = 1e-7;  // of the speed of impact: no point's changes by more in the last round
constexpr double kSettled = 1e-3;    // likewise: rounds that end before that, but with no point deeper than this, will do
constexpr double kRelaxation = 1.3;  // measured: least rounds over boxes and random faces

// A body's motion about its centre of mass, world frame.
struct Twist {
  Vec3d linear;   // m/s
  Vec3d angular;  // rad/s

  Vec3d at(const Vec3d& arm) const { return linear + angular.cross(arm); }
};

// One point of the body that touches.
struct Touching {
  Vec3d arm;      // m, from the centre of mass
  double leaves;  // m/s along the normal, at least
  double across;  // m/s that the point gains along the normal by an impulse of 1 Ns there
  double along;   // m/s, at most, likewise in the surface
  Vec3d impulse;  // Ns
};

class Impact {
 public:
  Impact(const Twist& at_hit, const Twist& at_end, const Mat3d& rotation, const Airframe& frame, const Vec3d& normal)
      : at_hit_(at_hit), at_end_(at_end), normal_(normal), inverse_mass_(1.0 / frame.mass_kg) {
    const Vec3d inverse(1.0 / frame.inertia_kgm2[0], 1.0 / frame.inertia_kgm2[1], 1.0 / frame.inertia_kgm2[2]);
    inverse_inertia_ = rotation * inverse.asDiagonal() * rotation.transpose();
  }

  void add(const Vec3d& arm) {
    const Vec3d turn = arm.cross(normal_);
    const double across = inverse_mass_ + turn.dot(inverse_inertia_ * turn);
    Mat3d cross;
    for (int axis = 0; axis < 3; ++axis) cross.col(axis) = arm.cross(Vec3d::Unit(axis));
    const double all = 3.0 * inverse_mass_ + (cross.transpose() * inverse_inertia_ * cross).trace();
    points_[count_++] = {arm, 0.0, across, all - across, Vec3d::Zero()};
  }

  // The motion after it. Aslant, restitution of each point's own can give energy, with friction or without, and strong friction
  // can keep the rounds from an end; a smooth surface that takes all speed from what comes does neither.
  Twist after(const Surface& surface) {
    for (const Surface& tried : {surface, Surface{surface.restitution, 0.0}}) {
      const Twist motion = solve(tried);
      if (is_settled_ && !gives_energy(motion)) return motion;
    }
    return solve({0.0, 0.0});
  }

 private:
  Twist solve(const Surface& surface) {
    double fastest = kSlow;
    for (Touching& point : std::span(points_).first(count_)) {
      const double came = std::min(at_hit_.at(point.arm).dot(normal_), 0.0);
      const double since = std::min((at_end_.at(point.arm) - at_hit_.at(point.arm)).dot(normal_), 0.0);
      point.leaves = std::max((came < -kSlow ? -surface.restitution * came : 0.0) + since, 0.0);
      point.impulse = Vec3d::Zero();
      fastest = std::max(fastest, at_end_.at(point.arm).norm());
    }
    Twist motion = at_end_;
    for (int round = 0; round < kMostRounds; ++round) {
      double changed = 0.0;
      for (Touching& point : std::span(points_).first(count_)) {
        changed = std::max(changed, push(point, surface.friction, motion));
      }
      if (changed <= kConverged * fastest) break;
    }
    is_settled_ = std::ranges::all_of(std::span(points_).first(count_), [&](const Touching& point) {
      return motion.at(point.arm).dot(normal_) >= point.leaves - kSettled * fastest;
    });
    return motion;
  }

  // Mends one point's impulse; returns by how much its speed changes.
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

  bool gives_energy(const Twist& after) const {
    double gained = 0.0;
    double exchanged = 0.0;
    for (const Touching& point : std::span(points_).first(count_)) {
      const double work = 0.5 * point.impulse.dot(at_end_.at(point.arm) + after.at(point.arm));
      gained += work;
      exchanged += std::abs(work);
    }
    return gained > 1e-6 * exchanged;
  }

  Twist at_hit_;
  Twist at_end_;
  Vec3d normal_;
  double inverse_mass_;
  Mat3d inverse_inertia_;  // world frame
  std::array<Touching, kMostPoints> points_;
  std::size_t count_ = 0;
  bool is_settled_ = true;
};

}  // namespace

Velocity thrown_back(const Velocity& at_hit, const Velocity& at_end, const Pose& pose, std::span<const Vec3> points,
                     const Vec3& normal, const Airframe& frame, const Surface& surface) {
  assert(points.size() <= kMostPoints);
  const Mat3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
  const auto motion = [&](const Velocity& velocity) {
    return Twist{velocity.linear.cast<double>(), rotation * velocity.angular.cast<double>()};
  };
  Impact impact(motion(at_hit), motion(at_end), rotation, frame, normal.cast<double>());
  for (const Vec3& point : points) impact.add((point - pose.position).cast<double>());
  const Twist after = impact.after(surface);
  return {after.linear.cast<float>(), (rotation.transpose() * after.angular).cast<float>()};
}

}  // namespace flockstep::dynamics
