// Mover: a moving hull and its gap from planes and convex obstacles over time.
#pragma once

#include <algorithm>
#include <cmath>

#include "collision/convex_distance.hpp"
#include "collision/hull.hpp"
#include "collision/path.hpp"
#include "collision/sweep.hpp"

namespace flockstep::collision {

inline constexpr double kTouching = 1e-6;      // m; hulls closer than this count as overlapping
inline constexpr double kResolution = 2e-6;    // m; tolerance of the gap at which an advance stops
inline constexpr double kSlack = 1e-5;         // m; a hull at rest may come this much nearer before a contact is reported
inline constexpr double kGain = 2e-6;          // m; two searches for the same gap differ by less
inline constexpr double kFloatStep = 0x1p-23;  // fraction of a coordinate
inline constexpr int kBallTurns = 4;
inline constexpr double kBallStep = 0.1;  // m; the path's nearest point is good enough if it moves by less
inline constexpr int kPlaneSteps = 4;
inline constexpr int kDifferenceSteps = 12;  // each is cheaper than one of the others
inline constexpr int kMaxAdvances = 1000;
inline constexpr double kNearest = 0.25;    // fraction of the standoff; see Mover::first_touch()
inline constexpr int kRewinds = 24;         // halvings of the time; they resolve a motion of 10 m to a micrometre
inline constexpr double kMinRewind = 5e-6;  // m; between hulls that turn, the way to which a contact is resolved

// The distances that the hull keeps in one motion. They grow with its coordinates, because rounding errors do.
struct Margins {
  double rounding;  // m, error of a pose rounded to float32
  double standoff;  // m
  double slack;     // m

  explicit Margins(const Pose& from, const Pose& to) {
    const float largest = std::max(from.position.cwiseAbs().maxCoeff(), to.position.cwiseAbs().maxCoeff());
    rounding = 4.0 * kFloatStep * static_cast<double>(largest);
    standoff = kStandoff + rounding;
    slack = kSlack + rounding;
  }

  double resting() const { return standoff + slack; }  // a hull with a smaller gap at the start is at rest
  // No sequence of motions ends nearer than this, because rounding a pose at the standoff reduces the gap by less than half the
  // standoff.
  double floor() const { return 0.5 * standoff; }
};

// The separation of hull and obstacle at one time.
struct Clearance {
  bool overlapping = false;
  Plane plane;
  double gap = 0.0;             // m, from the plane to the hull; negative if the hull reaches through it
  Vec3d point = Vec3d::Zero();  // m, on the obstacle
};

// The first contact with one obstacle or one wall of a room.
struct Touch {
  bool hit = false;
  bool inside = false;
  double time = 1.0;
  Vec3d normal = Vec3d::Zero();
  Vec3d point = Vec3d::Zero();
};

// The gap between a plane and the points x of the hull, from one time on: after a time t it is at least
// base + normal . x + t (speed + turning . x) - bend t^2 / 2.
struct GapOverTime {
  Vec3d normal = Vec3d::Zero();   // normal of the plane, hull frame
  Vec3d turning = Vec3d::Zero();  // change of the normal per unit of time, hull frame
  double base = 0.0;              // m, gap of the hull's origin
  double speed = 0.0;             // m per unit of time, change of that gap
  double bend = 0.0;              // upper bound of a point's acceleration towards the plane
};

inline GapOverTime gap_over_time(const Path& path, double radius, const Plane& plane, double time) {
  GapOverTime a;
  a.normal = path.matrix(time).transpose() * plane.normal;
  a.turning = path.angle * a.normal.cross(path.axis);
  a.bend = path.angle * a.turning.norm() * radius;  // a point at distance d from the axis accelerates by angle^2 d
  a.base = plane.normal.dot(path.position(time)) - plane.offset;
  a.speed = plane.normal.dot(path.velocity);
  return a;
}

// With N = Q^T n, the normal at the current time, a point y = h + R x of the hull has the speed
// N . (v - beta A x (h - b)) + (angle N x W - beta N x A) . R x, with the hull's axis W.
inline GapOverTime gap_over_time(const RelativePath& path, double radius, const Plane& plane, double time) {
  const Vec3d now = path.turn(time).transpose() * plane.normal;
  const Vec3d apart = path.apart(time);
  const Mat3d rotation = path.hull().matrix(time);
  GapOverTime a;
  a.normal = rotation.transpose() * now;
  a.turning = path.hull().angle * a.normal.cross(path.hull().axis) -
              path.body_angle() * (rotation.transpose() * now.cross(path.body_axis()));
  a.base = plane.normal.dot(path.body(1.0)) + now.dot(apart) - plane.offset;
  a.speed = now.dot(path.velocity() - path.body_angle() * path.body_axis().cross(apart));
  a.bend = path.acceleration(radius);
  return a;
}

// The moving hull. Track: Path or RelativePath.
template <class Track>
class Mover {
 public:
  Mover(const Hull& hull, const Track& path) : hull_(hull), path_(path) {}
  Mover(const Hull& hull, const Pose& from, const Pose& to) : hull_(hull), path_(from, to) {}

  const Track& path() const { return path_; }

  double gap(const Plane& plane, double time) const {
    const Vec3d normal = path_.matrix(time).transpose() * plane.normal;
    const int nearest = hull_.support(-normal.cast<float>());
    return plane.normal.dot(path_.position(time)) - plane.offset + normal.dot(hull_.vertex(nearest));
  }

  Clearance clearance(const Convex& obstacle, double time, const Vec3d& guess) const {
    const Separation s = separate(hull_, path_.matrix(time), path_.position(time), obstacle, guess);
    return {s.overlapping, s.plane, s.gap, s.point};
  }

  // Returns a time, at most 1. From `time` until the returned time, the hull is certain to stay at least `target` (m) from the
  // plane.
  //
  // For a vertex x, let a be its gap beyond the target, b its current speed along the normal, and k an upper bound of its
  // acceleration. The gap beyond the target is therefore at least a + b t - k t^2 / 2 after a time t. This bound is linear in x,
  // so one support query finds the vertex with the lowest bound at t. The bound is concave in t, so a vertex that is clear now
  // and at t is clear in between. Therefore shorten t to the root of the lowest bound, and repeat until the lowest bound at t is
  // not negative. Each vertex shortens t at most once.
  double clear_until(const Plane& plane, double time, double target) const {
    const GapOverTime at = gap_over_time(path_, static_cast<double>(hull_.radius()), plane, time);
    const Vec3d& normal = at.normal;
    const Vec3d& turning = at.turning;
    const double base = at.base - target;
    const double speed = at.speed;
    const double k = at.bend;
    double t = 1.0 - time;
    for (int cut = 0; cut <= kMaxHullVertices; ++cut) {
      const Vec3d x = hull_.vertex(hull_.support(-(normal + t * turning).cast<float>()));
      const double a = base + normal.dot(x);
      const double b = speed + turning.dot(x);
      if (a + t * (b - 0.5 * k * t) >= 0.0) return time + t;
      if (a <= 0.0) return time;
      const double root = std::sqrt(b * b + 2.0 * k * a);
      const double reached = b < 0.0 ? 2.0 * a / (root - b) : (b + root) / k;
      if (!(reached < t)) return time + t;
      t = reached;
    }
    return time + t;
  }

  // Conservative advancement (B. Mirtich, "Impulse-based Dynamic Simulation of Rigid Body Systems", 1996, 2.3), over separating
  // planes. `now` is the clearance at the start, with a gap of at least Margins::floor(). clearance(time, guess) returns the
  // clearance at a time. Contacts after `limit` may be missed.
  template <class ClearanceAt>
  Touch first_touch(Clearance now, const ClearanceAt& clearance, const Margins& margins, double limit) const {
    // A hull may start at the standoff, where an earlier motion left it. It may stay there, but must not come much nearer. Its
    // gap never falls below Margins::floor(), however many motions follow.
    const Clearance first = now;
    const bool resting = first.gap < margins.resting();
    double target = resting ? std::max(first.gap - margins.slack, margins.floor()) : margins.standoff;
    bool ends_near = false;
    if (resting && Track::kTurnsRelative) {
      // If edges of two hulls cross, a plane separates them only for a moment. Such a hull may come nearer on its way, so that
      // fewer planes are needed, but not at its end.
      if (clear_until(first.plane, 0.0, target) >= 1.0) return {};
      const Clearance last = clearance(1.0, first.plane.normal);
      ends_near = last.overlapping || last.gap < target;
      if (ends_near && !is_as_far(clearance(std::min(first_step(), 1.0), first.plane.normal), first)) {
        return {true, false, 0.0, first.plane.normal, last.overlapping ? first.point : last.point};
      }
      target = std::min(target, kNearest * margins.standoff);
    }
    double time = 0.0;
    for (int advance = 0; advance < kMaxAdvances; ++advance) {
      const double clear = clear_until(now.plane, time, target);
      if (clear >= 1.0 || (!resting && clear > limit)) {
        if (!ends_near) return {};
        time = 1.0;
        break;
      }
      const bool stuck = clear <= time;
      time = clear;
      const Clearance next = clearance(time, now.plane.normal);
      if (next.overlapping) break;
      now = next;
      if (stuck || now.gap <= target + kResolution) break;
    }
    if (!resting) {
      return {true, false, time, now.plane.normal, now.point};
    }
    return rewind(clearance, first, now, time);
  }

  // Returns the contact of a hull that starts inside the obstacle or with a gap below Margins::floor(). The hull flies the
  // whole motion if it ends at least `gain` farther from the plane than it starts and never comes nearer on the way. Otherwise
  // it stays.
  Touch leave(const Clearance& first, double gain) const {
    const bool inside = first.overlapping || first.gap <= kTouching;
    Touch touch{true, inside, 0.0, first.plane.normal, first.point};
    if (gap(first.plane, 1.0) < first.gap + gain) return touch;
    double time = 0.0;
    for (int advance = 0; advance < kMaxAdvances && time < 1.0; ++advance) {
      const double clear = clear_until(first.plane, time, first.gap - kResolution);
      if (clear <= time) return touch;
      time = clear;
    }
    if (time < 1.0) return touch;
    touch.hit = inside;
    touch.time = 1.0;
    return touch;
  }

 private:
  // Returns the contact of a hull that was at rest at the start. The time of the contact is at most `time`, and at that time
  // the gap is at least as large as at the start. Between convex bodies that only translate, the gap is a convex function of
  // time. If the hull comes nearer at all, it therefore does so from time 0 on, and the time of the contact is 0. A hull that
  // turns may rest on a line or a face whose points are all equally near. Therefore the contact point is taken from `now`, when
  // the hull has turned and one point is nearest.
  template <class ClearanceAt>
  Touch rewind(const ClearanceAt& clearance, const Clearance& first, const Clearance& now, double time) const {
    if (!path_.turns()) return {true, false, 0.0, first.plane.normal, first.point};
    Touch touch{true, false, 0.0, first.plane.normal, now.point};
    const double least = Track::kTurnsRelative ? first_step() : 0.0;
    for (int halving = 0; halving < kRewinds && time - touch.time > least; ++halving) {
      const double middle = 0.5 * (touch.time + time);
      const Clearance there = clearance(middle, now.plane.normal);
      if (is_as_far(there, first)) {
        touch = {true, false, middle, there.plane.normal, now.point};
      } else {
        time = middle;
      }
    }
    return touch;
  }

  static bool is_as_far(const Clearance& there, const Clearance& first) { return !there.overlapping && there.gap >= first.gap; }

  // A time in which no point of the hull moves farther than kMinRewind.
  double first_step() const { return kMinRewind / path_.fastest(static_cast<double>(hull_.radius())); }

  const Hull& hull_;
  Track path_;
};

}  // namespace flockstep::collision
