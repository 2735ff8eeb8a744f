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
constexpr int kMaxRounds = 1000;
constexpr double kConverged = 1e-7;    // largest change of a point's speed in the last round, over the impact speed
constexpr double kMaxApproach = 1e-3;  // largest accepted speed into the surface, over the impact speed
constexpr double kRelaxation = 1.3;    // needed the fewest rounds in measurements with boxes and random faces

// A body's motion about its centre of mass, world frame.
struct Twist {
  Vec3d linear = Vec3d::Zero();   // m/s
  Vec3d angular = Vec3d::Zero();  // rad/s

  Vec3d at(const Vec3d& arm) const { return linear + angular.cross(arm); }
};

// The motions of the bodies: two that collide, or one that hits a surface, which never moves.
template <std::size_t kBodies>
using Twists = std::array<Twist, kBodies>;

// Mass and inertia of a body.
struct Inertia {
  Inertia(const Mat3d& rotation, const Airframe& frame) : mass(frame.mass_kg), inverse_mass(1.0 / frame.mass_kg) {
    const Vec3d inertia(frame.inertia_kgm2[0], frame.inertia_kgm2[1], frame.inertia_kgm2[2]);
    tensor = rotation * inertia.asDiagonal() * rotation.transpose();
    inverse = rotation * inertia.cwiseInverse().asDiagonal() * rotation.transpose();
  }

  // Inner product of two motions, J: for equal motions twice the kinetic energy.
  double work(const Twist& a, const Twist& b) const { return mass * a.linear.dot(b.linear) + a.angular.dot(tensor * b.angular); }

  double mass, inverse_mass;
  Mat3d tensor, inverse;  // world frame
};

// A contact point of the bodies.
template <std::size_t kBodies>
struct Touching {
  std::array<Vec3d, kBodies> arms;  // m, from the centres of mass
  Vec3d normal;                     // unit, towards the first body
  double leaves;                    // m/s, minimum speed along the normal after the impact
  double across;                    // m/s along the normal per Ns of normal impulse at the point
  double along;                     // m/s in the surface per Ns of tangential impulse, upper bound
  Vec3d impulse;                    // Ns, on the first body

  Vec3d velocity(const Twists<kBodies>& motions) const {
    const Vec3d first = motions[0].at(arms[0]);
    if constexpr (kBodies == 1) return first;
    return first - motions.back().at(arms.back());
  }
};

template <std::size_t kBodies>
class Impact {
 public:
  using Twists = dynamics::Twists<kBodies>;
  using Touching = dynamics::Touching<kBodies>;

  explicit Impact(const std::array<Inertia, kBodies>& bodies) : bodies_(bodies) {}

  void add(const std::array<Vec3d, kBodies>& arms, const Vec3d& normal) {
    double across = 0.0, all = 0.0;
    for (std::size_t body = 0; body < kBodies; ++body) {
      const Vec3d turn = arms[body].cross(normal);
      across += bodies_[body].inverse_mass + turn.dot(bodies_[body].inverse * turn);
      Mat3d cross;
      for (int axis = 0; axis < 3; ++axis) cross.col(axis) = arms[body].cross(Vec3d::Unit(axis));
      all += 3.0 * bodies_[body].inverse_mass + (cross.transpose() * bodies_[body].inverse * cross).trace();
    }
    points_[count_++] = {arms, normal, 0.0, across, all - across, Vec3d::Zero()};
  }

  bool bounces(const Twists& before, double restitution) {
    return restitution > 0.0 && std::ranges::any_of(points(), [&](const Touching& point) {
             return point.velocity(before).dot(point.normal) < -kSlow;
           });
  }

  // The motion after the impact. If several points touch, or one of them slides, applying restitution to each point separately
  // can add energy. If it does, the result is a blend of the solutions with and without restitution, weighted so that the
  // energy equals the energy before the impact. Such a blend exists because the solution without restitution loses energy. The
  // impulses of both solutions lie within the friction cone, so those of the blend do, too.
  Twists bounce(const Twists& before, const ContactMaterial& surface) {
    Twists hard = solve(before, surface);
    if (!has_converged_) hard = solve(before, {surface.restitution, 0.0});  // strong friction can prevent convergence
    if (!has_converged_) return press(before, surface.friction);
    if (energy(hard) <= energy(before)) return hard;
    const Twists soft = press(before, surface.friction);
    Twists way;
    for (std::size_t body = 0; body < kBodies; ++body) {
      way[body] = {hard[body].linear - soft[body].linear, hard[body].angular - soft[body].angular};
    }
    const double half = 0.5 * work(soft, way);
    const double more = std::max(energy(before) - energy(soft), 0.0);
    const double share = std::clamp((std::sqrt(half * half + energy(way) * more) - half) / energy(way), 0.0, 1.0);
    Twists blend;
    for (std::size_t body = 0; body < kBodies; ++body) {
      blend[body] = {soft[body].linear + share * way[body].linear, soft[body].angular + share * way[body].angular};
    }
    return blend;
  }

  // The motion after contact without restitution: no point moves further into the surface.
  Twists press(const Twists& before, double friction) {
    const Twists rough = solve(before, {0.0, friction});
    if (has_converged_ && energy(rough) <= energy(before)) return rough;
    return solve(before, {0.0, 0.0});
  }

  // The angular velocity of a body at `time` after an impact that changed it from `hit` to `after`. Without the impact it would
  // have become `end`. The torques change the angular velocity as much as they would have without the impact. The gyroscopic
  // change depends on the rotation itself and adds no energy.
  Vec3d turned(std::size_t body, const Vec3d& after, const Vec3d& hit, const Vec3d& end, double time) const {
    const Inertia& inertia = bodies_[body];
    const auto energy_of = [&](const Vec3d& turn) { return 0.5 * turn.dot(inertia.tensor * turn); };
    const Vec3d torque = end - coasted(inertia, hit, time);
    const Vec3d turned = coasted(inertia, after, time) + torque;
    const double most = energy_of(after) + std::max(energy_of(end) - energy_of(hit), 0.0);
    const double is = energy_of(turned);
    return is > most ? Vec3d(std::sqrt(most / is) * turned) : turned;
  }

 private:
  std::span<Touching> points() { return std::span(points_).first(count_); }

  Twists solve(const Twists& before, const ContactMaterial& surface) {
    double fastest = kSlow;
    for (Touching& point : points()) {
      const Vec3d velocity = point.velocity(before);
      const double came = velocity.dot(point.normal);
      point.leaves = came < -kSlow ? -surface.restitution * came : 0.0;
      point.impulse = Vec3d::Zero();
      fastest = std::max(fastest, velocity.norm());
    }
    Twists motion = before;
    for (int round = 0; round < kMaxRounds; ++round) {
      double changed = 0.0;
      for (Touching& point : points()) changed = std::max(changed, push(point, surface.friction, motion));
      if (changed <= kConverged * fastest) break;
    }
    has_converged_ = std::ranges::all_of(
        points(), [&](const Touching& point) { return point.velocity(motion).dot(point.normal) >= -kMaxApproach * fastest; });
    return motion;
  }

  // Corrects the impulse of one point. Returns the change of its speed.
  double push(Touching& point, double friction, Twists& motion) const {
    const Vec3d velocity = point.velocity(motion);
    const double speed = velocity.dot(point.normal);
    const double before = point.impulse.dot(point.normal);
    const double pressed = std::max(before + kRelaxation * (point.leaves - speed) / point.across, 0.0);
    Vec3d rubbed = point.impulse - before * point.normal - kRelaxation / point.along * (velocity - speed * point.normal);
    if (!std::isinf(friction)) {
      if (const double most = friction * pressed, size = rubbed.norm(); size > most) rubbed *= most / size;
    }
    const Vec3d change = pressed * point.normal + rubbed - point.impulse;
    point.impulse += change;
    for (std::size_t body = 0; body < kBodies; ++body) {
      const Vec3d on_body = body == 0 ? change : Vec3d(-change);
      motion[body].linear += bodies_[body].inverse_mass * on_body;
      motion[body].angular += bodies_[body].inverse * point.arms[body].cross(on_body);
    }
    return change.norm() * (point.across + point.along);
  }

  // Torque-free rotation by Euler's equations, first order, scaled to conserve the energy.
  static Vec3d coasted(const Inertia& inertia, const Vec3d& angular, double time) {
    const Vec3d later = angular - time * (inertia.inverse * angular.cross(inertia.tensor * angular));
    const double is = later.dot(inertia.tensor * later);
    return is > 0.0 ? Vec3d(std::sqrt(angular.dot(inertia.tensor * angular) / is) * later) : angular;
  }

  double work(const Twists& a, const Twists& b) const {
    double sum = bodies_[0].work(a[0], b[0]);
    if constexpr (kBodies == 2) sum += bodies_[1].work(a[1], b[1]);
    return sum;
  }
  double energy(const Twists& motions) const { return 0.5 * work(motions, motions); }  // J

  std::array<Inertia, kBodies> bodies_;
  std::array<Touching, kMaxPoints> points_;
  std::size_t count_ = 0;
  bool has_converged_ = true;
};

Mat3d rotation_of(const Pose& pose) { return pose.rotation.cast<double>().normalized().toRotationMatrix(); }

Twist twist_of(const Velocity& velocity, const Mat3d& rotation) {
  return {velocity.linear.cast<double>(), rotation * velocity.angular.cast<double>()};
}

Velocity velocity_of(const Twist& twist, const Mat3d& rotation) {
  return {twist.linear.cast<float>(), (rotation.transpose() * twist.angular).cast<float>()};
}

// The motions right after the impact and at the end of the tick.
template <std::size_t kBodies>
std::array<Twists<kBodies>, 2> rebound(Impact<kBodies>& impact, const Twists<kBodies>& before, const Twists<kBodies>& free,
                                       double left_s, const ContactMaterial& surface) {
  if (!impact.bounces(before, surface.restitution)) {
    return {impact.press(before, surface.friction), impact.press(free, surface.friction)};
  }
  const Twists<kBodies> after = impact.bounce(before, surface);
  Twists<kBodies> end;
  for (std::size_t body = 0; body < kBodies; ++body) {
    end[body] = {after[body].linear + (free[body].linear - before[body].linear),
                 impact.turned(body, after[body].angular, before[body].angular, free[body].angular, left_s)};
  }
  return {after, impact.press(end, surface.friction)};
}

}  // namespace

Rebound thrown_back(const Velocity& at_hit, const Velocity& at_end, double left_s, const Pose& pose,
                    std::span<const ContactPoint> points, const Airframe& frame, const ContactMaterial& surface) {
  assert(points.size() <= kMaxPoints);
  const Mat3d rotation = rotation_of(pose);
  Impact<1> impact({Inertia(rotation, frame)});
  for (const auto& [position, normal] : points) impact.add({(position - pose.position).cast<double>()}, normal.cast<double>());
  const auto [after, end] = rebound<1>(impact, {twist_of(at_hit, rotation)}, {twist_of(at_end, rotation)}, left_s, surface);
  return {velocity_of(after[0], rotation), velocity_of(end[0], rotation)};
}

std::array<Rebound, 2> thrown_apart(const Colliding& first, const Colliding& second, double left_s,
                                    std::span<const ContactPoint> points, const ContactMaterial& surface) {
  assert(points.size() <= kMaxPoints);
  const std::array rotations{rotation_of(first.pose), rotation_of(second.pose)};
  Impact<2> impact({Inertia(rotations[0], first.frame), Inertia(rotations[1], second.frame)});
  for (const auto& [position, normal] : points) {
    impact.add({(position - first.pose.position).cast<double>(), (position - second.pose.position).cast<double>()},
               normal.cast<double>());
  }
  const Twists<2> before{twist_of(first.at_hit, rotations[0]), twist_of(second.at_hit, rotations[1])};
  const Twists<2> free{twist_of(first.at_end, rotations[0]), twist_of(second.at_end, rotations[1])};
  const auto [after, end] = rebound(impact, before, free, left_s, surface);
  std::array<Rebound, 2> result;
  for (std::size_t body = 0; body < 2; ++body) {
    result[body] = {velocity_of(after[body], rotations[body]), velocity_of(end[body], rotations[body])};
  }
  return result;
}

std::array<Velocity, 2> moved_together(const Colliding& first, const Colliding& second) {
  const std::array bodies{&first, &second};
  const std::array rotations{rotation_of(first.pose), rotation_of(second.pose)};
  const std::array inertias{Inertia(rotations[0], first.frame), Inertia(rotations[1], second.frame)};
  const std::array twists{twist_of(first.at_hit, rotations[0]), twist_of(second.at_hit, rotations[1])};
  const double mass = inertias[0].mass + inertias[1].mass;
  Vec3d center = Vec3d::Zero(), velocity = Vec3d::Zero();
  for (std::size_t i = 0; i < 2; ++i) {
    center += inertias[i].mass / mass * bodies[i]->pose.position.cast<double>();
    velocity += inertias[i].mass / mass * twists[i].linear;
  }
  Mat3d inertia = Mat3d::Zero();  // kg m^2, both bodies about the common centre
  Vec3d spin = Vec3d::Zero();     // angular momentum about it
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3d arm = bodies[i]->pose.position.cast<double>() - center;
    inertia += inertias[i].tensor + inertias[i].mass * (arm.squaredNorm() * Mat3d::Identity() - arm * arm.transpose());
    spin += inertias[i].tensor * twists[i].angular + inertias[i].mass * arm.cross(twists[i].linear);
  }
  const Vec3d turn = inertia.ldlt().solve(spin);
  std::array<Velocity, 2> result;
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3d arm = bodies[i]->pose.position.cast<double>() - center;
    result[i] = velocity_of({velocity + turn.cross(arm), turn}, rotations[i]);
  }
  return result;
}

}  // namespace flockstep::dynamics
