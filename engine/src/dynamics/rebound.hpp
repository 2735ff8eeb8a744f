// Parts of a rebound: the points that touch, the surface, and the motion in the rest of the tick.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <span>

#include "collision/hull.hpp"
#include "collision/moving_solid.hpp"
#include "collision/sweep.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/impact.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

static_assert(kMostPoints == 2 * kMaxHullVertices + 1);

// Points of hulls that touch at a contact, m, world frame. If a face lies flat, these are all its corners.
class ContactPoints {
 public:
  // Takes the contact point and the touching vertices of a hull. Inside an obstacle the points are the deepest vertices. All
  // points are projected onto the hit surface and deduplicated: points off its plane, or a millimetre apart, would act as tiny
  // levers that keep the body from turning. touches(point, reach): whether the point is nearer than reach to the obstacle.
  ContactPoints(const auto& touches, const collision::Hull& hull, const Pose& pose, const collision::Contact& contact) {
    if (!contact.inside) add(contact.point);
    add_vertices(touches, hull, pose, contact, 1.0F);
  }

  // Takes the touching vertices of another hull, on the other side of the surface (side -1), except near known points.
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
      const auto is_here = [&](const Vec3& known) { return (on_surface - known).norm() < near; };
      if (side < 0.0F) {
        if (std::ranges::none_of(points(), is_here)) add(on_surface);
      } else if (count_ > 0 && is_here(points_[0])) {
        points_[0] = on_surface;
      } else {
        add(on_surface);
      }
    }
  }

  std::span<const Vec3> points() const { return std::span(points_).first(count_); }

 private:
  void add(const Vec3& point) { points_[count_++] = point; }

  std::array<Vec3, kMostPoints> points_;
  std::size_t count_ = 0;
};

inline Surface surface_of(const DynamicsConfig& config) {
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
