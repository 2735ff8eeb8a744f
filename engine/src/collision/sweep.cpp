#include "collision/sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include "collision/convex_distance.hpp"
#include "collision/path.hpp"

namespace flockstep::collision {

namespace {

constexpr double kTouching = 1e-6;      // m; hulls closer than this count as overlapping
constexpr double kResolution = 2e-6;    // m; tolerance of the gap at which an advance stops
constexpr double kSlack = 1e-5;         // m; a hull at rest may come this much nearer before a contact is reported
constexpr double kGain = 2e-6;          // m; two searches for the same gap differ by less
constexpr double kFloatStep = 0x1p-23;  // fraction of a coordinate
constexpr int kBallTurns = 4;
constexpr double kBallStep = 0.1;  // m; the path's nearest point is good enough if it moves by less
constexpr int kPlaneSteps = 4;
constexpr int kMaxAdvances = 1000;
constexpr int kRewinds = 24;  // halvings of the time; they resolve a motion of 10 m to a micrometre

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

// The moving hull.
class Mover {
 public:
  Mover(const Hull& hull, const Pose& from, const Pose& to) : hull_(hull), path_(from, to) {}

  const Path& path() const { return path_; }

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
  // For a vertex x, let a be its gap beyond the target and b its current speed along the normal n. A point that turns at rate w
  // about an axis at distance d accelerates by w^2 d. With k = w^2 d |cross(n, axis)|, the gap beyond the target is therefore
  // at least a + b t - k t^2 / 2 after a time t. This bound is linear in x, so one support query finds the vertex with the
  // lowest bound at t. The bound is concave in t, so a vertex that is clear now and at t is clear in between. Therefore shorten
  // t to the root of the lowest bound, and repeat until the lowest bound at t is not negative. Each vertex shortens t at most
  // once.
  double clear_until(const Plane& plane, double time, double target) const {
    const Vec3d normal = path_.matrix(time).transpose() * plane.normal;
    const Vec3d turning = path_.angle * normal.cross(path_.axis);
    const double k = path_.angle * turning.norm() * static_cast<double>(hull_.radius());
    const double base = plane.normal.dot(path_.position(time)) - plane.offset - target;
    const double speed = plane.normal.dot(path_.velocity);
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
    const double target = resting ? std::max(first.gap - margins.slack, margins.floor()) : margins.standoff;
    double time = 0.0;
    for (int advance = 0; advance < kMaxAdvances; ++advance) {
      const double clear = clear_until(now.plane, time, target);
      if (clear >= 1.0 || (!resting && clear > limit)) {
        return {};
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
    if (path_.angle == 0.0) return {true, false, 0.0, first.plane.normal, first.point};
    Touch touch{true, false, 0.0, first.plane.normal, now.point};
    for (int halving = 0; halving < kRewinds; ++halving) {
      const double middle = 0.5 * (touch.time + time);
      const Clearance there = clearance(middle, now.plane.normal);
      if (!there.overlapping && there.gap >= first.gap) {
        touch = {true, false, middle, there.plane.normal, now.point};
      } else {
        time = middle;
      }
    }
    return touch;
  }

  const Hull& hull_;
  Path path_;
};

Plane wall_plane(const Room& room, int axis, bool low) {
  return low ? Plane{Vec3d::Unit(axis), static_cast<double>(room.inside.min[axis])}
             : Plane{-Vec3d::Unit(axis), -static_cast<double>(room.inside.max[axis])};
}

// Returns the point of the wall nearest to the hull: the mean of the nearest vertices, projected onto the wall.
Vec3d point_on_wall(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Plane& wall) {
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

  void meet(const Room& room) {
    const Vec3 away = Vec3::Constant(hull_.radius() + static_cast<float>(margins_.resting()));
    const Vec3 low = from_.position.cwiseMin(to_.position) - away;
    const Vec3 high = from_.position.cwiseMax(to_.position) + away;
    for (int axis = 0; axis < 3; ++axis) {
      if (low[axis] <= room.inside.min[axis]) meet(wall_plane(room, axis, true), room.element);
      if (high[axis] >= room.inside.max[axis]) meet(wall_plane(room, axis, false), room.element);
    }
  }

  void meet(const Convex& obstacle, std::uint32_t element) {
    const std::optional<Approach> approach = approach_of_ball(obstacle);
    if (!approach) return;
    std::optional<Clearance> start = clearance_at_start(obstacle, *approach);
    if (!start) return;
    if (start->overlapping || start->gap <= kTouching) {
      if (start->gap <= 0.0) start = way_out(obstacle, 0.0);
      Touch touch = mover().leave(*start, 0.0);
      if (touch.time == 1.0 && ends_deeper(obstacle, *start)) touch.time = 0.0;
      take_leaving(touch, *start, element);
      return;
    }
    if (start->gap < margins_.floor()) {
      take_leaving(mover().leave(*start, kGain), *start, element);
      return;
    }
    const auto clearance = [this, &obstacle](double at, const Vec3d& guess) { return mover().clearance(obstacle, at, guess); };
    take(mover().first_touch(*start, clearance, margins_, first_.time), element);
  }

  // Tests for a contact as meet() does, but computes neither the contact point nor the way out of an obstacle.
  bool is_touched(const Convex& obstacle) {
    const std::optional<Approach> approach = approach_of_ball(obstacle);
    if (!approach) return false;
    const std::optional<Clearance> start = clearance_at_start(obstacle, *approach);
    if (!start) return false;
    if (start->overlapping || start->gap <= kTouching) return true;
    if (start->gap < margins_.floor()) return mover().leave(*start, kGain).hit;
    const auto clearance = [this, &obstacle](double at, const Vec3d& guess) { return mover().clearance(obstacle, at, guess); };
    return mover().first_touch(*start, clearance, margins_, first_.time).hit;
  }

  bool has_contact() const { return first_.hit || inside_.hit; }

  Contact contact() const {
    Contact contact;
    if (!has_contact()) return contact;
    const Touch& shown = inside_.hit ? inside_ : first_;
    contact.hit = true;
    contact.inside = inside_.hit;
    // leave() has checked the whole motion. If a contact cuts the motion short, the flown part is known to lead away only if
    // the motion is straight and the gap grows enough in this part. Otherwise the hull stays.
    const bool is_shown = std::isinf(least_gain_) || first_.time == 1.0 ||
                          (mover_->path().angle == 0.0 && first_.time * least_gain_ >= kGain + margins_.rounding);
    const double time = is_shown ? first_.time : 0.0;
    contact.fraction = static_cast<float>(time);
    if (static_cast<double>(contact.fraction) > time) contact.fraction = std::nextafter(contact.fraction, 0.0F);
    contact.point = shown.point.cast<float>();
    contact.normal = shown.normal.cast<float>().normalized();
    return contact;
  }

 private:
  // Created on first use: most motions hit nothing and never need it.
  const Mover& mover() {
    if (!mover_) mover_.emplace(hull_, from_, to_);
    return *mover_;
  }

  void meet(const Plane& wall, std::uint32_t element) {
    const auto clearance = [this, &wall](double time, const Vec3d&) {
      return Clearance{false, wall, mover().gap(wall, time), Vec3d::Zero()};
    };
    const Clearance start = clearance(0.0, wall.normal);
    const bool leaving = start.gap < margins_.floor();
    Touch touch = leaving ? mover().leave(start, 0.0) : mover().first_touch(start, clearance, margins_, first_.time);
    const double at = touch.inside ? 0.0 : touch.time;
    if (touch.hit) touch.point = point_on_wall(hull_, mover().path().matrix(at), mover().path().position(at), wall);
    if (leaving) {
      take_leaving(touch, start, element);
    } else {
      take(touch, element);
    }
  }

  // Returns the depth of the hull inside the obstacle at a time, and the way out.
  Clearance way_out(const Convex& obstacle, double time) {
    const Path& path = mover().path();
    const Penetration out = penetrate(hull_, path.matrix(time), path.position(time), obstacle);
    const Plane plane = supporting_plane(obstacle, out.normal);
    return {true, plane, mover().gap(plane, time), out.point};
  }

  // Returns true if a motion that leads away from the plane ends deeper inside. The depth is measured by the same method as at
  // the start, so that its errors cannot add up over many motions. If the hull ends outside, there is no depth to measure.
  bool ends_deeper(const Convex& obstacle, const Clearance& start) {
    if (mover().gap(start.plane, 1.0) > 0.0) return false;
    if (mover().clearance(obstacle, 1.0, start.plane.normal).gap > 0.0) return false;
    return way_out(obstacle, 1.0).gap < start.gap;
  }

  // A position of the body's origin on its path, and the obstacle's point nearest to it.
  struct Approach {
    Vec3d center;
    Vec3d nearest;
  };

  // Returns nothing if a plane separates the ball around the hull from the obstacle during the whole motion. The search for the
  // plane alternates between the point of the path nearest to the obstacle and the point of the obstacle nearest to the path.
  std::optional<Approach> approach_of_ball(const Convex& obstacle) const {
    const Vec3d start = from_.position.cast<double>();
    const Vec3d way = to_.position.cast<double>() - start;
    const double length2 = way.squaredNorm();
    double time = 0.5;
    Approach found{start + time * way, closest_point(obstacle, start + time * way)};
    for (int turn = 0; turn < kBallTurns; ++turn) {
      const Vec3d apart = found.center - found.nearest;  // the plane's normal, not normalised
      const double before = apart.dot(start - found.nearest);
      const double after = before + apart.dot(way);
      if (std::min(before, after) > apart.norm() * (static_cast<double>(hull_.radius()) + margins_.resting())) {
        return std::nullopt;
      }
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
  std::optional<Clearance> clearance_at_start(const Convex& obstacle, const Approach& approach) {
    const Mat3d rotation = mover().path().matrix(0.0);
    Vec3d point = approach.center;  // on the hull
    Vec3d nearest = approach.nearest;
    std::optional<Clearance> best;
    double best_until = 0.0;
    for (int step = 0; step < kPlaneSteps; ++step) {
      const Vec3d apart = point - nearest;
      const double distance = apart.norm();
      if (distance <= kTouching) break;
      const Plane plane{apart / distance, apart.dot(nearest) / distance};
      const double gap = mover().gap(plane, 0.0);
      if (gap > margins_.resting()) {
        const double until = mover().clear_until(plane, 0.0, margins_.standoff);
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
    const Vec3d outwards = mover().path().start - obstacle.center + kTouching * Vec3d::Ones();  // never quite zero
    return mover().clearance(obstacle, 0.0, guess.norm() > kTouching ? guess : outwards);
  }

  void take_leaving(const Touch& touch, const Clearance& start, std::uint32_t element) {
    least_gain_ = std::min(least_gain_, mover().gap(start.plane, 1.0) - start.gap);
    take(touch, element);
  }

  void take(const Touch& touch, std::uint32_t element) {
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
  float reach_;  // m
  std::optional<Mover> mover_;
  Touch first_;  // ends the motion
  std::uint32_t element_ = 0;
  // The smallest increase of the gap (m) from start to end of the motion, among the obstacles whose gap at the start is below
  // Margins::floor().
  double least_gain_ = std::numeric_limits<double>::infinity();
  Touch inside_;  // lowest element among the obstacles that contain the hull at the start
  std::uint32_t inside_element_ = 0;
};

}  // namespace

Pose interpolate(const Pose& from, const Pose& to, float fraction) {
  if (fraction <= 0.0F) return from;
  if (fraction >= 1.0F) return to;
  const Path path(from, to);
  const double time = static_cast<double>(fraction);
  return {path.position(time).cast<float>(), path.rotation(time).normalized().cast<float>()};
}

Contact sweep(const Obstacles& obstacles, const Hull& hull, const Pose& from, const Pose& to) {
  Search search(hull, from, to);
  for (const Room& room : obstacles.rooms()) search.meet(room);
  obstacles.for_each_near(search.middle(), search.reach(),
                          [&](std::uint32_t element) { search.meet(obstacles.convex(element), element); });
  return search.contact();
}

bool is_clear(const Obstacles& obstacles, std::span<const std::uint32_t> elements, const Hull& hull, const Pose& from,
              const Pose& to) {
  Search search(hull, from, to);
  for (const Room& room : obstacles.rooms()) search.meet(room);
  return !search.has_contact() && std::none_of(elements.begin(), elements.end(), [&](std::uint32_t element) {
    return search.is_touched(obstacles.convex(element));
  });
}

bool overlaps(const Obstacles& obstacles, const Hull& hull, const Pose& pose) {
  return sweep(obstacles, hull, pose, pose).inside;
}

}  // namespace flockstep::collision
