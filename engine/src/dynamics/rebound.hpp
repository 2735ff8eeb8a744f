// Parts of a rebound: the points that touch, the surface, and the motion in the rest of the tick.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "collision/hull.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/path.hpp"
#include "collision/sweep.hpp"
#include "dynamics/impact.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// A distance (m) larger than the standoff that a sweep keeps at this coordinate, plus a few float32 steps of the coordinate.
inline float margin(float coordinate) {
  constexpr float kClearance = 1e-3F;  // m
  constexpr float kFloatSteps = 0x1p-18F;
  return kClearance + kFloatSteps * coordinate;
}

// The motion of a drone in a tick without any contact.
struct TickMotion {
  Pose from, to;
  Velocity begin, end;
  double duration_s;
};

static_assert(kMaxPoints == 2 * (2 * kMaxHullVertices + 1));

// Points of hulls that touch. If a face lies flat, these are all its corners. If a drone has several contacts at one place, as in
// a corner, their points are kept, so that the impulses at one do not push the drone into another.
class ContactPoints {
 public:
  std::span<const ContactPoint> points() const { return std::span(points_).first(count_); }
  void clear() { count_ = 0; }
  // As the other body sees them.
  void turn_round() {
    for (std::size_t i = 0; i < count_; ++i) points_[i].normal = -points_[i].normal;
  }

  // Adds the contact point and the touching vertices of a hull. Inside an obstacle the points are the deepest vertices. All
  // points are projected onto the hit surface and deduplicated: points off its plane, or a millimetre apart, would act as tiny
  // levers that keep the body from turning. touches(point, reach): whether the point is nearer than reach to the obstacle.
  void add(const auto& touches, const collision::Hull& hull, const Pose& pose, const collision::Contact& contact) {
    if (count_ > kMaxPoints / 2) clear();
    first_ = count_;
    if (!contact.inside) add(contact.point, contact.normal);
    add_vertices(touches, hull, pose, contact, 1.0F);
  }

  // Adds the touching vertices of another hull, on the other side of the surface (side -1), except near known points.
  void add_vertices(const auto& touches, const collision::Hull& hull, const Pose& pose, const collision::Contact& contact,
                    float side) {
    const auto vertex = [&](int i) { return Vec3(hull.vertex(i).cast<float>()); };
    const auto above_surface = [&](int i) {
      return side * contact.normal.dot(pose.position + pose.rotation * vertex(i) - contact.point);
    };
    float level = 0.0F;
    if (contact.inside) {
      for (int i = 0; i < hull.count(); ++i) level = std::min(level, above_surface(i));
    }
    const float near = margin(pose.position.cwiseAbs().maxCoeff());
    for (int i = 0; i < hull.count(); ++i) {
      const float above = above_surface(i) - level;
      if (above >= near) continue;
      const Vec3 point = pose.position + pose.rotation * vertex(i);
      if (!contact.inside && !touches(point, near)) continue;
      const Vec3 on_surface = point - side * above * contact.normal;
      const auto is_here = [&](const ContactPoint& known) { return (on_surface - known.position).norm() < near; };
      if (side < 0.0F) {
        if (std::ranges::none_of(points().subspan(first_), is_here)) add(on_surface, contact.normal);
      } else if (count_ > first_ && is_here(points_[first_])) {
        points_[first_].position = on_surface;
      } else {
        add(on_surface, contact.normal);
      }
    }
    forget_same(near);
  }

 private:
  void add(const Vec3& position, const Vec3& normal) { points_[count_++] = {position, normal}; }

  // Removes points of earlier contacts that the last one has, too.
  void forget_same(float near) {
    const auto last = points().subspan(first_);
    const auto is_known = [&](const ContactPoint& point) {
      return std::ranges::any_of(last, [&](const ContactPoint& known) {
        return (point.position - known.position).norm() < near && point.normal.dot(known.normal) > kSameNormal;
      });
    };
    const auto end = points_.begin() + static_cast<std::ptrdiff_t>(first_);
    const auto kept = std::remove_if(points_.begin(), end, is_known);
    if (kept == end) return;
    count_ =
        static_cast<std::size_t>(std::move(end, points_.begin() + static_cast<std::ptrdiff_t>(count_), kept) - points_.begin());
    first_ = static_cast<std::size_t>(kept - points_.begin());
  }

  static constexpr float kSameNormal = 0.999F;  // cosine
  std::array<ContactPoint, kMaxPoints> points_;
  std::size_t count_ = 0;
  std::size_t first_ = 0;  // index of the last contact's first point
};

inline ContactMaterial surface_of(const DynamicsConfig& config) {
  if (config.on_contact == OnContact::stop) return {0.0, std::numeric_limits<double>::infinity()};
  return {static_cast<double>(config.restitution), static_cast<double>(config.friction)};
}

// Velocity at a share of the time between two velocities.
inline Velocity velocity_between(const Velocity& begin, const Velocity& end, float share) {
  return {begin.linear + share * (end.linear - begin.linear), begin.angular + share * (end.angular - begin.angular)};
}

// Pose after time_s with a velocity that changes uniformly.
inline Pose pose_after(const Pose& from, const Velocity& begin, const Velocity& end, double time_s) {
  const auto time = static_cast<float>(0.5 * time_s);
  const Vec3 turn = time * (begin.angular + end.angular);
  const float angle = turn.norm();
  return {from.position + time * (begin.linear + end.linear),
          angle > 0.0F ? (from.rotation * Quat(Eigen::AngleAxisf(angle, turn / angle))).normalized() : from.rotation};
}

inline constexpr int kMaxContacts = 3;    // per drone and tick: two walls and their corner
inline constexpr double kSpeedOut = 2.5;  // m/s, of a drone that is moved out of what it is inside of

inline bool is_same(const Pose& a, const Pose& b) {
  return a.position == b.position && a.rotation.coeffs() == b.rotation.coeffs();
}

// Returns an upper bound of how far (m) a point of the hull moves.
inline double largest_move(const collision::Hull& hull, const Pose& from, const Pose& to) {
  return collision::Path(from, to).fastest(static_cast<double>(hull.radius()));
}

// Kinetic energy, J/kg.
inline double energy_of(const Velocity& velocity, const Airframe& frame) {
  const auto square = [](const Vec3& v) { return v.cast<double>().cwiseAbs2(); };
  const collision::Vec3d inertia(frame.inertia_kgm2[0], frame.inertia_kgm2[1], frame.inertia_kgm2[2]);
  return 0.5 * (square(velocity.linear).sum() + square(velocity.angular).dot(inertia) / frame.mass_kg);
}

// Returns the velocity at the end of a motion aside, of which a share was flown. The surface does no work, so the energy changes
// by the climb (m) and by the work of the other forces, which act for left_s. begin, end: velocities after the last impact and at
// the end of the tick. motion: of the tick without obstacles.
inline Velocity velocity_aside(const Velocity& begin, const Velocity& end, float share, float climb, const TickMotion& motion,
                               double left_s, const Airframe& frame) {
  const auto potential = [](float height) { return kGravity * static_cast<double>(height); };
  const double work = energy_of(motion.end, frame) - energy_of(motion.begin, frame) +
                      potential(motion.to.position.z() - motion.from.position.z());
  const double most = energy_of(begin, frame) - potential(climb) + std::max(work, 0.0) * left_s / motion.duration_s;
  const Velocity& velocity = share < 1.0F ? begin : end;
  const double is = energy_of(velocity, frame);
  if (!(is > most)) return velocity;
  const auto kept = static_cast<float>(std::sqrt(std::max(most, 0.0) / is));
  return {kept * velocity.linear, kept * velocity.angular};
}

// Returns a bound of the speeds (m per motion) of all points of bodies.
inline double fastest_of(std::span<const collision::MovingSolid> solids) {
  double speed = 0.0;
  for (const collision::MovingSolid& solid : solids) {
    speed = std::max(speed, solid.path().velocity.norm() + solid.path().angle * solid.radius());
  }
  return speed;
}

// Velocity of a drone that was pushed along a way in the last left_s: it gets at least the speed of the push, so that it does
// not fall back into the body. most: m, that the body may have advanced.
inline Vec3 pushed_along(const Vec3& velocity, const Vec3& way, double most, double left_s) {
  const auto left = static_cast<float>(left_s);
  const float length = way.norm();
  if (!(left > 0.0F && length > 0.0F)) return velocity;
  const float speed = std::min(length, static_cast<float>(most)) / left;
  const Vec3 along = way / length;
  return velocity + std::max(0.0F, speed - velocity.dot(along)) * along;
}

}  // namespace flockstep::dynamics
