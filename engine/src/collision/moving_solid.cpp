#include "collision/moving_solid.hpp"

#include <algorithm>
#include <cmath>

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

}  // namespace flockstep::collision
