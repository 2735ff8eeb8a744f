// An independent reference for the nearest hit of a ray in double precision: closed forms and all triangles. It shares no code
// with the engine's tracing or its library.
#pragma once

#include <Eigen/Dense>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "standard.hpp"

namespace flockstep::oracle {

using Vec3d = Eigen::Vector3d;

constexpr double kNever = std::numeric_limits<double>::infinity();

struct Interval {
  double enter = -kNever;
  double exit = kNever;
};

inline Interval both(const Interval& a, const Interval& b) { return {std::max(a.enter, b.enter), std::min(a.exit, b.exit)}; }

inline Interval slab(double origin, double direction, double half) {
  if (direction == 0.0) return std::abs(origin) <= half ? Interval{} : Interval{kNever, -kNever};
  const double a = (-half - origin) / direction;
  const double b = (half - origin) / direction;
  return {std::min(a, b), std::max(a, b)};
}

// Returns the interval in which |o + t d| <= r, in the subspace of the given vectors.
inline Interval ball(const Vec3d& o, const Vec3d& d, double radius) {
  const double a = d.squaredNorm();
  if (a == 0.0) return o.norm() <= radius ? Interval{} : Interval{kNever, -kNever};
  const double b = o.dot(d);
  const double discriminant = b * b - a * (o.squaredNorm() - radius * radius);
  if (discriminant < 0.0) return {kNever, -kNever};
  return {(-b - std::sqrt(discriminant)) / a, (-b + std::sqrt(discriminant)) / a};
}

struct Hit {
  double t = kNever;             // m
  int element = -1;              // numbered as in World::raycast
  Vec3d normal = Vec3d::Zero();  // facing the origin
};

// Returns the interval of a line in a capsule. Its surface is a tube between two hemispheres; the interval spans the first and
// last crossing.
inline Interval capsule(const Vec3d& o, const Vec3d& d, double radius, double half_height) {
  const double middle = half_height - radius;
  Interval inside{kNever, -kNever};
  const auto cross = [&](const Interval& solid, const auto& is_surface) {
    if (solid.enter > solid.exit) return;
    for (const double t : {solid.enter, solid.exit}) {
      if (std::isfinite(t) && is_surface(o.z() + t * d.z())) inside = {std::min(inside.enter, t), std::max(inside.exit, t)};
    }
  };
  cross(ball({o.x(), o.y(), 0.0}, {d.x(), d.y(), 0.0}, radius), [&](double z) { return std::abs(z) <= middle; });
  cross(ball(o - Vec3d(0, 0, middle), d, radius), [&](double z) { return z >= middle; });
  cross(ball(o + Vec3d(0, 0, middle), d, radius), [&](double z) { return z <= -middle; });
  return inside;
}

// Returns where a line crosses a flat sheet at z = 0, whose points satisfy holds(x, y). A line within the sheet never crosses
// it.
template <class Holds>
Interval sheet(const Vec3d& o, const Vec3d& d, const Holds& holds) {
  if (d.z() == 0.0) return {kNever, -kNever};
  const double t = -o.z() / d.z();
  return holds(o.x() + t * d.x(), o.y() + t * d.y()) ? Interval{t, t} : Interval{kNever, -kNever};
}

inline Hit hit_primitive(const Primitive& shape, const Vec3d& origin, const Vec3d& direction) {
  const Eigen::Matrix3d rotation = shape.rotation.cast<double>().normalized().toRotationMatrix();
  const Vec3d o = rotation.transpose() * (origin - shape.center.cast<double>());
  const Vec3d d = rotation.transpose() * direction;
  const Vec3d half = shape.half_extents.cast<double>();
  const auto flat = [](const Vec3d& v) { return Vec3d(v.x(), v.y(), 0.0); };
  Interval inside;
  if (shape.kind == PrimitiveKind::sphere) {
    inside = ball(o, d, half.x());
  } else if (shape.kind == PrimitiveKind::cylinder) {
    inside = both(ball(flat(o), flat(d), half.x()), slab(o.z(), d.z(), half.z()));
  } else if (shape.kind == PrimitiveKind::capsule) {
    inside = capsule(o, d, half.x(), half.z());
  } else if (shape.kind == PrimitiveKind::plane) {
    inside = sheet(o, d, [&](double x, double y) { return std::abs(x) <= half.x() && std::abs(y) <= half.y(); });
  } else if (shape.kind == PrimitiveKind::disc) {
    inside = sheet(o, d, [&](double x, double y) { return std::hypot(x, y) <= half.x(); });
  } else {
    for (int axis = 0; axis < 3; ++axis) inside = both(inside, slab(o[axis], d[axis], half[axis]));
  }
  if (inside.enter > inside.exit || inside.exit < 0.0) return {};
  const double t = inside.enter >= 0.0 ? inside.enter : inside.exit;
  const Vec3d point = o + t * d;
  Vec3d normal = point.normalized();
  if (shape.kind == PrimitiveKind::cylinder) {
    const bool cap = std::abs(std::abs(point.z()) - half.z()) < std::abs(flat(point).norm() - half.x());
    normal = cap ? Vec3d(0, 0, std::copysign(1.0, point.z())) : Vec3d(flat(point).normalized());
  } else if (shape.kind == PrimitiveKind::capsule) {
    const double middle = half.z() - half.x();
    normal = (point - Vec3d(0, 0, std::clamp(point.z(), -middle, middle))).normalized();
  } else if (shape.kind == PrimitiveKind::plane || shape.kind == PrimitiveKind::disc) {
    normal = Vec3d::UnitZ();
  } else if (shape.kind != PrimitiveKind::sphere) {
    int face = 0;
    (point.cwiseAbs() - half).cwiseAbs().minCoeff(&face);
    normal = std::copysign(1.0, point[face]) * Vec3d::Unit(face);
  }
  return {t, 0, rotation * normal};
}

// Moeller and Trumbore (1997), two-sided.
inline Hit hit_triangle(const TriangleMesh& mesh, std::size_t index, const Vec3d& origin, const Vec3d& direction) {
  const auto corner = [&](std::size_t k) {
    return Vec3d(mesh.vertices[static_cast<std::size_t>(mesh.triangles[index][k])].cast<double>());
  };
  const Vec3d a = corner(0);
  const Vec3d ab = corner(1) - a;
  const Vec3d ac = corner(2) - a;
  const Vec3d p = direction.cross(ac);
  const double determinant = ab.dot(p);
  if (determinant == 0.0) return {};
  const Vec3d s = (origin - a) / determinant;
  const double u = s.dot(p);
  const Vec3d q = s.cross(ab);
  const double v = direction.dot(q);
  const double t = ac.dot(q);
  if (u < 0.0 || v < 0.0 || u + v > 1.0 || t < 0.0) return {};
  return {t, 0, ab.cross(ac).normalized()};
}

// counts(triangle, point): whether a hit on a triangle at a point is valid.
template <class Counts>
Hit nearest(const World& world, const Vec3d& origin, const Vec3d& direction, double max_range, const Counts& counts) {
  Hit found;
  const auto take = [&](Hit hit, std::size_t element) {
    if (hit.t > max_range || hit.t >= found.t) return;
    hit.element = static_cast<int>(element);
    found = hit;
  };
  const auto primitives = world.primitives();
  for (std::size_t i = 0; i < primitives.size(); ++i) take(hit_primitive(primitives[i], origin, direction), i);
  for (std::size_t i = 0; i < world.triangles().triangles.size(); ++i) {
    const Hit hit = hit_triangle(world.triangles(), i, origin, direction);
    if (hit.t < kNever && counts(i, Vec3d(origin + hit.t * direction))) take(hit, primitives.size() + i);
  }
  if (found.normal.dot(direction) > 0.0) found.normal = -found.normal;
  return found;
}

inline Hit nearest(const World& world, const Vec3d& origin, const Vec3d& direction, double max_range) {
  return nearest(world, origin, direction, max_range, [](std::size_t, const Vec3d&) { return true; });
}

// Returns how much the hit moves along the ray when the ray is offset by `offset` m, relative to the offset. This is the
// magnification of an error across the ray. It is infinite if an offset ray hits another element or face, which means that an
// edge, a silhouette or the end of the range is near.
inline double steepness(const World& world, const Hit& hit, const Vec3d& origin, const Vec3d& direction, double max_range,
                        double offset = 1e-5) {
  if (hit.element >= 0 && std::abs(hit.t - max_range) <= offset) return kNever;
  const Vec3d u = direction.unitOrthogonal();
  const Vec3d v = direction.cross(u);
  double steepest = 0.0;
  for (const Vec3d& aside : {u, Vec3d(-u), v, Vec3d(-v)}) {
    const Hit other = nearest(world, origin + offset * aside, direction, max_range);
    if (other.element != hit.element) return kNever;
    if (hit.element < 0) continue;
    if (other.normal.dot(hit.normal) < 0.999) return kNever;
    steepest = std::max(steepest, std::abs(other.t - hit.t) / offset);
  }
  return steepest;
}

// Returns whether no edge, silhouette or end of the range is near, and the hit is not at a grazing angle.
inline bool is_clear_cut(const World& world, const Hit& hit, const Vec3d& origin, const Vec3d& direction, double max_range) {
  return steepness(world, hit, origin, direction, max_range) <= 5.0;
}

// A convex hull: clips each ray to the half spaces below all planes through three of its points.
class Hull {
 public:
  explicit Hull(std::span<const Vec3> points) {
    std::vector<Vec3d> exact;
    for (const Vec3& point : points) exact.emplace_back(point.cast<double>());
    double size = 0.0;
    for (const Vec3d& point : exact) size = std::max(size, point.norm());
    for (std::size_t i = 0; i < exact.size(); ++i) {
      for (std::size_t j = 0; j < exact.size(); ++j) {
        for (std::size_t k = j + 1; k < exact.size(); ++k) {
          if (i == j || i == k) continue;
          const Vec3d across = (exact[j] - exact[i]).cross(exact[k] - exact[i]);
          if (across.norm() < 1e-6 * size * size) continue;  // nearly on one line: the plane is uncertain
          for (const Vec3d& normal : {Vec3d(across.normalized()), Vec3d(-across.normalized())}) {
            double farthest = -kNever;
            for (const Vec3d& point : exact) farthest = std::max(farthest, normal.dot(point));
            if (farthest <= normal.dot(exact[i]) + 1e-7 * size) planes_.push_back({normal, farthest});
          }
        }
      }
    }
  }

  // Returns the nearest hit from outside or inside; the normal is that of the face, outwards.
  Hit hit(const Pose& pose, const Vec3d& origin, const Vec3d& direction) const {
    const Eigen::Matrix3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
    const Vec3d o = rotation.transpose() * (origin - pose.position.cast<double>());
    const Vec3d d = rotation.transpose() * direction;
    Hit enter, leave;
    enter.t = -kNever;
    for (const Plane& plane : planes_) {
      const double ahead = plane.offset - plane.normal.dot(o), speed = plane.normal.dot(d);
      if (speed == 0.0 && ahead < 0.0) return {};
      if (speed < 0.0 && ahead / speed > enter.t) enter = {ahead / speed, 0, plane.normal};
      if (speed > 0.0 && ahead / speed < leave.t) leave = {ahead / speed, 0, plane.normal};
    }
    if (enter.t > leave.t || leave.t < 0.0) return {};
    Hit& found = enter.t >= 0.0 ? enter : leave;
    found.normal = rotation * found.normal;
    return found;
  }

 private:
  struct Plane {
    Vec3d normal;
    double offset;
  };
  std::vector<Plane> planes_;
};

}  // namespace flockstep::oracle
