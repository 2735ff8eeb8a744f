// Search: the first contact of one motion of the hull with the static world.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <tuple>

#include "collision/convex_distance.hpp"
#include "collision/hull.hpp"
#include "collision/mover.hpp"
#include "collision/obstacles.hpp"
#include "collision/path.hpp"
#include "collision/sweep.hpp"

namespace flockstep::collision {

inline Plane wall_plane(const RoomInterior& room, int axis, bool low) {
  return low ? Plane{Vec3d::Unit(axis), static_cast<double>(room.inside.min[axis])}
             : Plane{-Vec3d::Unit(axis), -static_cast<double>(room.inside.max[axis])};
}

// Returns the point of the wall nearest to the hull: the mean of the nearest vertices, projected onto the wall.
inline Vec3d point_on_wall(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Plane& wall) {
  const Vec3d normal = rotation.transpose() * wall.normal;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < hull.count(); ++i) least = std::min(least, normal.dot(hull.vertex(i)));
  Vec3d sum = Vec3d::Zero();
  double count = 0.0;
  for (int i = 0; i < hull.count(); ++i) {
    if (normal.dot(hull.vertex(i)) <= least + kTouching) {
      sum += hull.vertex(i);
      count += 1.0;
    }
  }
  const Vec3d point = position + rotation * (sum / count);
  return point - (wall.normal.dot(point) - wall.offset) * wall.normal;
}

// Searches for the first contact of one sweep. The result does not depend on the order of the obstacles.
class Search {
 public:
  Search(const Hull& hull, const Pose& from, const Pose& to)
      : hull_(hull),
        from_(from),
        to_(to),
        margins_(from, to),
        middle_(0.5F * (from.position + to.position)),
        reach_(hull.radius() + 0.5F * (to.position - from.position).norm() + static_cast<float>(2.0 * margins_.resting())) {}

  // The ball that contains the hull during the whole motion.
  const Vec3& middle() const { return middle_; }
  float reach() const { return reach_; }

  void test(const RoomInterior& room) {
    const Vec3 away = Vec3::Constant(hull_.radius() + static_cast<float>(margins_.resting()));
    const Vec3 low = from_.position.cwiseMin(to_.position) - away;
    const Vec3 high = from_.position.cwiseMax(to_.position) + away;
    for (int axis = 0; axis < 3; ++axis) {
      if (low[axis] <= room.inside.min[axis]) test(wall_plane(room, axis, true), room.element);
      if (high[axis] >= room.inside.max[axis]) test(wall_plane(room, axis, false), room.element);
    }
  }

  void test(const Convex& obstacle, std::uint32_t element) {
    const std::optional<Approach> approach = approach_of_ball(obstacle);
    if (!approach) return;
    const std::optional<Clearance> start = clearance_at_start(mover(), obstacle, *approach);
    if (start) take(touch(mover(), obstacle, *start, first_.time), element);
  }

  // Tests for a contact as test() does, but computes neither the contact point nor the way out of an obstacle.
  bool is_touched(const Convex& obstacle) {
    const std::optional<Approach> approach = approach_of_ball(obstacle);
    if (!approach) return false;
    const std::optional<Clearance> start = clearance_at_start(mover(), obstacle, *approach);
    if (!start) return false;
    if (start->overlapping || start->gap <= kTouching) return true;
    if (start->gap < margins_.floor()) return mover().leave(*start, kGain).hit;
    const auto clearance = [this, &obstacle](double at, const Vec3d& guess) { return mover().clearance(obstacle, at, guess); };
    return mover().first_touch(*start, clearance, margins_, first_.time).hit;
  }

  bool has_contact() const { return first_.hit || inside_.hit; }

  Contact contact() const {
    if (!has_contact()) return {};
    return contact_of(inside_.hit ? inside_ : first_, inside_.hit, flown(first_.time, least_gain_));
  }

 protected:
  // The contact with one obstacle.
  struct Found {
    Touch touch;
    // m, increase of the gap from start to end, if the gap at the start is below Margins::floor()
    double gain = std::numeric_limits<double>::infinity();
  };

  // A position of the hull's origin on its path, and the obstacle's point nearest to it.
  struct Approach {
    Vec3d center;
    Vec3d nearest;
  };

  // Returns the part of the motion that is flown if the first contact is at this time. gain: least Found::gain.
  float flown(double time, double gain) const {
    // leave() has checked the whole motion. If a contact cuts the motion short, the flown part is known to lead away only if
    // the motion is straight and the gap grows enough in this part. Otherwise the hull stays.
    const bool is_shown =
        std::isinf(gain) || time == 1.0 || (mover_->path().angle == 0.0 && time * gain >= kGain + margins_.rounding);
    if (!is_shown) time = 0.0;
    const auto fraction = static_cast<float>(time);
    return static_cast<double>(fraction) > time ? std::nextafter(fraction, 0.0F) : fraction;
  }

  static Contact contact_of(const Touch& touch, bool inside, float fraction) {
    return {true, inside, fraction, touch.point.cast<float>(), touch.normal.cast<float>().normalized()};
  }

  // Created on first use: most motions hit nothing and never need it.
  const Mover<Path>& mover() {
    if (!mover_) mover_.emplace(hull_, from_, to_);
    return *mover_;
  }

  // Returns the contact with an obstacle. start: from clearance_at_start(). Contacts after `limit` may be missed.
  template <class Track>
  Found touch(const Mover<Track>& mover, const Convex& obstacle, Clearance start, double limit) const {
    if (leads_out_ && (start.overlapping || start.gap < margins_.floor())) return {};
    if (start.overlapping || start.gap <= kTouching) {
      if (start.gap <= 0.0) start = way_out(mover, obstacle, 0.0);
      Touch touch = mover.leave(start, 0.0);
      if (touch.time == 1.0 && ends_deeper(mover, obstacle, start)) touch.time = 0.0;
      return {touch, mover.gap(start.plane, 1.0) - start.gap};
    }
    if (start.gap < margins_.floor()) return {mover.leave(start, kGain), mover.gap(start.plane, 1.0) - start.gap};
    const auto clearance = [&mover, &obstacle](double at, const Vec3d& guess) { return mover.clearance(obstacle, at, guess); };
    return {mover.first_touch(start, clearance, margins_, limit)};
  }

  void test(const Plane& wall, std::uint32_t element) {
    const auto clearance = [this, &wall](double time, const Vec3d&) {
      return Clearance{false, wall, mover().gap(wall, time), Vec3d::Zero()};
    };
    const Clearance start = clearance(0.0, wall.normal);
    const bool leaving = start.gap < margins_.floor();
    if (leaving && leads_out_) return;
    Touch touch = leaving ? mover().leave(start, 0.0) : mover().first_touch(start, clearance, margins_, first_.time);
    const double at = touch.inside ? 0.0 : touch.time;
    if (touch.hit) touch.point = point_on_wall(hull_, mover().path().matrix(at), mover().path().position(at), wall);
    Found found{touch};
    if (leaving) found.gain = mover().gap(start.plane, 1.0) - start.gap;
    take(found, element);
  }

  // Returns the depth of the hull inside the obstacle at a time, and the way out.
  template <class Track>
  Clearance way_out(const Mover<Track>& mover, const Convex& obstacle, double time) const {
    const Penetration out = penetrate(hull_, mover.path().matrix(time), mover.path().position(time), obstacle);
    const Plane plane = supporting_plane(obstacle, out.normal);
    return {true, plane, mover.gap(plane, time), out.point};
  }

  // Returns true if a motion that leads away from the plane ends deeper inside. The depth is measured by the same method as at
  // the start, so that its errors cannot add up over many motions. If the hull ends outside, there is no depth to measure.
  template <class Track>
  bool ends_deeper(const Mover<Track>& mover, const Convex& obstacle, const Clearance& start) const {
    if (mover.gap(start.plane, 1.0) > 0.0) return false;
    if (mover.clearance(obstacle, 1.0, start.plane.normal).gap > 0.0) return false;
    return way_out(mover, obstacle, 1.0).gap < start.gap;
  }

  // Returns nothing if a plane separates the ball around the hull from the obstacle during the whole motion. The search for the
  // plane alternates between the point of the path nearest to the obstacle and the point of the obstacle nearest to the path.
  std::optional<Approach> approach_of_ball(const Convex& obstacle) const {
    const Vec3d start = from_.position.cast<double>();
    return approach_of_ball(obstacle, start, to_.position.cast<double>() - start, reach_of_ball());
  }

  double reach_of_ball() const { return static_cast<double>(hull_.radius()) + margins_.resting(); }

  // The same for a ball of radius `reach` that moves from `start` by `way`.
  static std::optional<Approach> approach_of_ball(const Convex& obstacle, const Vec3d& start, const Vec3d& way, double reach) {
    const double length2 = way.squaredNorm();
    double time = 0.5;
    Approach found{start + time * way, closest_point(obstacle, start + time * way)};
    for (int turn = 0; turn < kBallTurns; ++turn) {
      const Vec3d apart = found.center - found.nearest;  // the plane's normal, not normalised
      const double before = apart.dot(start - found.nearest);
      const double after = before + apart.dot(way);
      if (std::min(before, after) > apart.norm() * reach) return std::nullopt;
      const double nearer = length2 > 0.0 ? std::clamp(way.dot(found.nearest - start) / length2, 0.0, 1.0) : time;
      if (std::abs(nearer - time) * std::sqrt(length2) < kBallStep) break;
      time = nearer;
      found = {start + time * way, closest_point(obstacle, start + time * way)};
    }
    return found;
  }

  // Searches for a plane that separates hull and obstacle for as long as possible. Returns the clearance at the start, with
  // this plane, or nothing if a plane separates them during the whole motion. Usually a few Frank-Wolfe steps find such a
  // plane, at a tenth of the cost of a full search. Each step moves a point of the hull towards the vertex that is nearest to
  // the plane (M. Frank and P. Wolfe, "An algorithm for quadratic programming", 1956).
  template <class Track>
  std::optional<Clearance> clearance_at_start(const Mover<Track>& mover, const Convex& obstacle, const Approach& approach) const {
    const Mat3d rotation = mover.path().matrix(0.0);
    Vec3d point = approach.center;  // on the hull
    Vec3d nearest = approach.nearest;
    std::optional<Clearance> best;
    double best_until = 0.0;
    for (int step = 0; step < kPlaneSteps; ++step) {
      const Vec3d apart = point - nearest;
      const double distance = apart.norm();
      if (distance <= kTouching) break;
      const Plane plane{apart / distance, apart.dot(nearest) / distance};
      const double gap = mover.gap(plane, 0.0);
      if (gap > margins_.resting()) {
        const double until = mover.clear_until(plane, 0.0, margins_.standoff);
        if (until >= 1.0) return std::nullopt;
        if (until > best_until) {
          best_until = until;
          best = Clearance{false, plane, gap, nearest};
        }
      }
      const Vec3d inwards = -(rotation.transpose() * plane.normal);
      const Vec3d along = approach.center + rotation * hull_.vertex(hull_.support(inwards.cast<float>())) - point;
      const double gain = -along.dot(apart);
      if (gain <= 0.0) break;
      point += std::min(gain / along.squaredNorm(), 1.0) * along;
      nearest = closest_point(obstacle, point);
    }
    if (best) return best;
    const Vec3d guess = point - nearest;
    const Vec3d outwards = mover.path().position(0.0) - obstacle.center + kTouching * Vec3d::Ones();  // never quite zero
    return mover.clearance(obstacle, 0.0, guess.norm() > kTouching ? guess : outwards);
  }

  // The same for the convex hull of corners, whose nearest points are not known. The steps move a difference of a point of the
  // hull and a point of the obstacle towards the difference that is nearest to the plane.
  template <class Track>
  std::optional<Clearance> clearance_from_corners(const Mover<Track>& mover, const Convex& obstacle) const {
    const Mat3d rotation = mover.path().matrix(0.0);
    const Vec3d position = mover.path().position(0.0);
    Vec3d on_obstacle = obstacle.center;
    Vec3d apart = position - on_obstacle;
    std::optional<Clearance> best;
    double best_until = 0.0;
    for (int step = 0; step < kDifferenceSteps; ++step) {
      const double distance = apart.norm();
      if (distance <= kTouching) break;
      const Vec3d normal = apart / distance;
      const Vec3d outer = obstacle.center + obstacle.rotation * support(obstacle, obstacle.rotation.transpose() * normal);
      const Vec3d inner = position + rotation * hull_.vertex(hull_.support(-(rotation.transpose() * normal).cast<float>()));
      const double gap = normal.dot(inner - outer);
      if (gap > margins_.resting()) {
        const Plane plane{normal, normal.dot(outer)};
        const double until = mover.clear_until(plane, 0.0, margins_.standoff);
        if (until >= 1.0) return std::nullopt;
        if (until > best_until) {
          best_until = until;
          best = Clearance{false, plane, gap, on_obstacle};
        }
      }
      const Vec3d along = inner - outer - apart;
      const double gain = -along.dot(apart);
      if (gain <= 0.0) break;
      const double part = std::min(gain / along.squaredNorm(), 1.0);
      apart += part * along;
      on_obstacle += part * (outer - on_obstacle);
    }
    if (best) return best;
    return mover.clearance(obstacle, 0.0, apart.norm() > kTouching ? apart : Vec3d(kTouching * Vec3d::Ones()));
  }

  void take(const Found& found, std::uint32_t element) {
    least_gain_ = std::min(least_gain_, found.gain);
    const Touch& touch = found.touch;
    if (!touch.hit) return;
    if (touch.inside && (!inside_.hit || element < inside_element_)) {
      inside_ = touch;
      inside_element_ = element;
    }
    if (touch.time < 1.0 && std::tuple(touch.time, element) < std::tuple(first_.time, element_)) {
      first_ = touch;
      element_ = element;
    }
  }

  const Hull& hull_;
  const Pose& from_;
  const Pose& to_;
  Margins margins_;
  Vec3 middle_;
  float reach_;             // m
  bool leads_out_ = false;  // obstacles that the hull begins inside of do not end the motion
  std::optional<Mover<Path>> mover_;
  Touch first_;  // ends the motion
  std::uint32_t element_ = 0;
  // The smallest increase of the gap (m) from start to end of the motion, among the obstacles whose gap at the start is below
  // Margins::floor().
  double least_gain_ = std::numeric_limits<double>::infinity();
  Touch inside_;  // lowest element among the obstacles that contain the hull at the start
  std::uint32_t inside_element_ = 0;
};

}  // namespace flockstep::collision
