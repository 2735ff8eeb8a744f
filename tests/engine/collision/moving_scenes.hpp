// Bodies that move, and their oracle.
#pragma once

#include "collide.hpp"
#include "collision/mover.hpp"
#include "collision/moving_sweep.hpp"
#include "convex_oracle.hpp"
#include "random.hpp"

namespace flockstep::collision::moving {

using namespace testing;

inline const Hull& quadrotor_hull() {
  static const Hull body(quadrotor());
  return body;
}

inline Quat rotated(float degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisf(degrees * std::numbers::pi_v<float> / 180.0F, axis.normalized()));
}

// A static world with its collision data.
struct Surroundings {
  explicit Surroundings(std::vector<Primitive> primitives)
      : world(SceneDescription{.primitives = std::move(primitives)}), scene(world), obstacles(world, scene) {}
  World world;
  trace::Scene scene;
  Obstacles obstacles;
};

inline const Surroundings& open_air() {
  static const Surroundings nothing({{.kind = PrimitiveKind::sphere, .center = {1000, 0, 0}}});
  return nothing;
}

// A body and its motion, from which both the solid and the oracle are made.
struct MovingBody {
  PrimitiveKind kind = PrimitiveKind::box;
  Vec3 half_extents = Vec3::Constant(0.5F);
  Pose from;
  Pose to;

  MovingSolid solid(int index) const { return {kind, half_extents, from, to, index}; }
};

inline oracle::Support body_at(const MovingBody& body, double time) {
  const oracle::Support local = oracle::solid({.kind = body.kind, .half_extents = body.half_extents});
  const Eigen::Vector3d position = oracle::Way{body.from, body.to}.position(time);
  const Eigen::Matrix3d rotation = oracle::Way{body.from, body.to}.rotation(time).toRotationMatrix();
  return [=](const Eigen::Vector3d& d) -> Eigen::Vector3d { return position + rotation * local(rotation.transpose() * d); };
}

// Returns the hull's distance from a body at one time, or a lower bound of it that exceeds `enough`.
inline double distance_at(const MovingBody& body, double time, const Eigen::Vector3d& position,
                          const Eigen::Quaterniond& rotation, double enough) {
  const double reach = body.half_extents.cast<double>().norm() + static_cast<double>(quadrotor().radius());
  const double bound = (position - oracle::Way{body.from, body.to}.position(time)).norm() - reach;
  if (bound > enough) return bound;
  return oracle::distance(oracle::hull_at(quadrotor(), position, rotation), body_at(body, time)).lower;
}

inline double distance_at(const MovingBody& body, double time, const Pose& pose, double enough) {
  return distance_at(body, time, pose.position.cast<double>(), pose.rotation.cast<double>(), enough);
}

// A whole motion: first_contact(), and from the contact on, push().
struct MovingSweep {
  MovingContact contact;
  Push end;
};
inline MovingSweep sweep(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& from,
                         const Pose& to) {
  MovingSweep result{first_contact(obstacles, bodies, hull, from, to), {.pose = to}};
  const float fraction = result.contact.fraction;
  if (result.contact.hit) {
    result.end = push(obstacles, bodies, hull, interpolate(from, to, fraction), static_cast<double>(fraction));
  }
  return result;
}

inline bool same_bits(const Contact& a, const Contact& b) {
  return a.hit == b.hit && a.inside == b.inside && a.fraction == b.fraction && a.point == b.point && a.normal == b.normal;
}

inline bool same_bits(const MovingSweep& a, const MovingSweep& b) {
  return same_bits(a.contact, b.contact) && a.contact.body == b.contact.body && a.contact.velocity == b.contact.velocity &&
         a.end.pose.position == b.end.pose.position && a.end.pose.rotation.coeffs() == b.end.pose.rotation.coeffs() &&
         a.end.pushed == b.end.pushed && a.end.jammed == b.end.jammed;
}

inline MovingBody random_body(Random& random, float spread, float length, float most_degrees) {
  using enum PrimitiveKind;
  const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere}[static_cast<std::size_t>(random.within(0, 3.999F))];
  const auto size = [&] { return random.within(0, 1) < 0.3F ? random.within(0.0025F, 0.01F) : random.within(0.05F, 0.8F); };
  const float a = size();
  Vec3 half(a, a, kind == capsule ? a + size() : size());
  if (kind == box) half.y() = size();
  if (kind == sphere) half.setConstant(a);
  MovingBody body{kind, half, {random.point(spread), random.rotation()}, {}};
  body.to.position = body.from.position + random.point(length);
  body.to.rotation = body.from.rotation;
  if (random.within(0, 1) < 0.7F && most_degrees > 0.0F) {
    body.to.rotation = (rotated(random.within(0, most_degrees), random.direction()) * body.from.rotation).normalized();
  }
  return body;
}

inline Pose random_target(Random& random, const Pose& from, float length, float most_degrees) {
  Pose to{from.position + random.point(length), from.rotation};
  if (random.within(0, 1) < 0.6F && most_degrees > 0.0F) {
    to.rotation = (rotated(random.within(0, most_degrees), random.direction()) * from.rotation).normalized();
  }
  return to;
}

// The hull is 0.93 x 0.59 x 0.2 m.
inline constexpr float kFront = 0.465F;  // m, extent of the hull along x

// A plate of 5 mm that moves along x, at most 0.5 m in a motion of 10 ms: 50 m/s.
inline MovingBody plate(float from, float to) {
  return {PrimitiveKind::box, {0.0025F, 3, 3}, {.position = {from, 0, 0}}, {.position = {to, 0, 0}}};
}

}  // namespace flockstep::collision::moving
