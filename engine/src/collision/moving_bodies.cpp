#include "collision/moving_bodies.hpp"

#include <algorithm>
#include <cmath>

#include "collision/moving_sweep.hpp"
#include "trace/near_balls.hpp"

namespace flockstep::collision {

namespace {

double radius_of(const Convex& convex) {
  const Vec3d& h = convex.half_extents;
  switch (convex.kind) {
    case Convex::Kind::cylinder:
      return std::hypot(h.x(), h.z());
    case Convex::Kind::capsule:
      return std::max(h.x(), h.z());
    case Convex::Kind::sphere:
      return h.x();
    case Convex::Kind::hull:
      return convex.hull->radius();
    case Convex::Kind::box:
    case Convex::Kind::triangle:
      break;
  }
  return h.norm();
}

}  // namespace

MovingSolid::MovingSolid(PrimitiveKind kind, const Vec3& half_extents, const Pose& from, const Pose& to, int index)
    : MovingSolid(make_convex({.kind = kind, .center = to.position, .rotation = to.rotation, .half_extents = half_extents}), from,
                  to, index) {}

MovingSolid::MovingSolid(const Corners& corners, const Pose& from, const Pose& to, int index)
    : MovingSolid(make_hull(corners, to), from, to, index) {}

MovingSolid::MovingSolid(const Convex& end, const Pose& from, const Pose& to, int index)
    : radius_(radius_of(end)), index_(index), path_(from, to), end_(end) {
  turning_ = path_.angle * (path_.first_matrix * path_.axis);
  if (end.kind == Convex::Kind::sphere) path_.angle = 0.0;
}

Convex MovingSolid::at(double time) const {
  if (time == 1.0) return end_;
  Convex convex = end_;
  convex.center = path_.position(time);
  if (path_.turns()) convex.rotation = path_.matrix(time);
  return convex;
}

Vec3d MovingSolid::point_after(const Vec3d& point, double time, double later) const {
  const Vec3d local = path_.matrix(time).transpose() * (point - path_.position(time));
  return path_.position(later) + path_.matrix(later) * local;
}

Vec3d MovingSolid::velocity(const Vec3d& point, double time) const {
  if (turning_.isZero(0.0)) return path_.velocity;
  return path_.velocity + turning_.cross(point - path_.position(time));
}

namespace {

Pose pose_in(const float* position, const float* quat_wxyz, std::size_t number) {
  const float *const p = position + 3 * number, *const q = quat_wxyz + 4 * number;
  return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
}

// Calls f(solid) for each convex part of a body.
template <class Function>
void for_each_part(const MovingBodies& bodies, std::size_t number, const Pose& from, const Pose& to, const Function& f) {
  const auto index = static_cast<int>(number);
  if (const auto* const parts = bodies.parts == nullptr ? nullptr : bodies.parts[number]) {
    for (const Corners& corners : *parts) f(MovingSolid(corners, from, to, index));
  } else {
    const Primitive& solid = *bodies.solids[number];
    f(MovingSolid(solid.kind, solid.half_extents, from, to, index));
  }
}

}  // namespace

bool overlaps_body(const MovingBodies& bodies, const Obstacles& obstacles, const Hull& hull, const Pose& pose) {
  for (std::size_t number = 0; number < bodies.count; ++number) {
    if (bodies.reach[number] < 0.0F) continue;
    const Pose there = pose_in(bodies.position, bodies.quat_wxyz, number);
    const float reach = bodies.reach[number] + hull.radius();
    if ((there.position - pose.position).squaredNorm() > reach * reach) continue;
    bool is_met = false;
    for_each_part(bodies, number, there, there, [&](const MovingSolid& standing) {
      is_met = is_met || first_contact(obstacles, {&standing, 1}, hull, pose, pose).body >= 0;
    });
    if (is_met) return true;
  }
  return false;
}

std::span<const MovingSolid> NearSolids::gather(const MovingBodies& bodies, const Vec3& origin, float range_m) {
  solids_.clear();
  if (bodies.count == 0) return {};
  if (found_.size() < bodies.count) {
    found_.resize(bodies.count);
    solids_.reserve(bodies.count);
  }
  const trace::Balls balls{bodies.position, bodies.reach, bodies.count};
  const std::size_t count = trace::find_near_balls(balls, origin, range_m, found_.data());
  for (const std::uint32_t number : std::span(found_).first(count)) {
    for_each_part(bodies, number, pose_in(bodies.from_position, bodies.from_quat, number),
                  pose_in(bodies.position, bodies.quat_wxyz, number),
                  [this](const MovingSolid& solid) { solids_.push_back(solid); });
  }
  return solids_;
}

}  // namespace flockstep::collision
