#include "collision/sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include "collision/convex_distance.hpp"
#include "collision/path.hpp"

namespace swiftlet::collision {

namespace {

constexpr double kTouching = 1e-6;      // m; hulls closer than this overlap
constexpr double kResolution = 2e-6;    // m; how near to its target gap an advance ends
constexpr double kSlack = 1e-5;         // m; what a hull that rests may lose of its gap before that counts as pressing
constexpr double kFloatStep = 0x1p-23;  // of a coordinate
constexpr int kMaxAdvances = 1000;
constexpr int kRewinds = 24;  // halvings of the time: 10 m to a micrometre

// How far the hull stays away, for coordinates of the size of this motion's.
struct Margins {
  double standoff;  // m
  double slack;     // m

  explicit Margins(const Pose& from, const Pose& to) {
    const float largest = std::max(from.position.cwiseAbs().maxCoeff(), to.position.cwiseAbs().maxCoeff());
    const double rounding = 4.0 * kFloatStep * static_cast<double>(largest);
    standoff = kStandoff + rounding;
    slack = kSlack + rounding;
  }
};

// What lies between hull and obstacle at one time.
struct Clearance {
  bool overlapping = false;
  Plane plane;
  double gap = 0.0;  // m, from the plane to the hull
};

// The first contact with one obstacle or one wall of a room.
struct Touch {
  bool hit = false;
  bool inside = false;
  double time = 1.0;
  Vec3d normal = Vec3d::Zero();
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
    return {s.overlapping, s.plane, s.gap};
  }

  // Until when, from `time` on, the hull surely stays `target` (m) away from the plane; 1 at the latest.
  //
  // With a = gap of a vertex x beyond the target and b = its speed along the normal n now, and since a point that turns at rate w
  // about an axis at distance d accelerates by w^2 d, its gap after t is at least a + b t - k t^2 / 2, k = w^2 d |n across the
  // axis|. This is linear in x, so one support query finds the vertex that is worst after t; and concave in t, so a vertex that
  // is fine now and after t is fine between. Cut t to the root of the worst vertex until none is left. Each vertex cuts once at
  // most.
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
      if (a + t * (b - 0.5 * k * t) >= 0.0) {
        return time + t;
      }
      if (a <= 0.0) {
        return time;
      }
      const double root = std::sqrt(b * b + 2.0 * k * a);
      const double reached = b < 0.0 ? 2.0 * a / (root - b) : (b + root) / k;
      if (!(reached < t)) {
        return time + t;
      }
      t = reached;
    }
    return time + t;
  }

  // Conservative advancement (B. Mirtich, "Impulse-based Dynamic Simulation of Rigid Body Systems", 1996, 2.3), over planes that
  // separate. clearance(time, guess) is what lies between at a time. Contacts after `limit` need not be found.
  template <class ClearanceAt>
  Touch first_touch(const ClearanceAt& clearance, const Vec3d& guess, const Margins& margins, double limit) const {
    Touch touch;
    Clearance now = clearance(0.0, guess);
    touch.normal = now.plane.normal;
    if (now.overlapping || now.gap <= kTouching) {
      touch.hit = touch.inside = true;
      touch.time = 0.0;
      return touch;
    }
    // A hull that starts at the standoff, where an earlier motion left it, must not come nearer, but may stay.
    const double first_gap = now.gap;
    const bool resting = first_gap < margins.standoff + margins.slack;
    const double target = resting ? std::max(first_gap - margins.slack, 0.5 * kTouching) : margins.standoff;
    double time = 0.0;
    for (int advance = 0; advance < kMaxAdvances; ++advance) {
      const double clear = clear_until(now.plane, time, target);
      if (clear >= 1.0 || (!resting && clear > limit)) {
        return touch;
      }
      const bool stuck = clear <= time;
      time = clear;
      now = clearance(time, now.plane.normal);
      if (now.overlapping) {
        break;
      }
      touch.normal = now.plane.normal;
      if (stuck || now.gap <= target + kResolution) {
        break;
      }
    }
    touch.hit = true;
    touch.time = resting ? rewind(clearance, touch.normal, first_gap, time) : time;
    return touch;
  }

 private:
  // A time up to `time` when the gap was no smaller than at first. Convex bodies that only translate approach ever faster, so
  // the hull has been pressing from the start.
  template <class ClearanceAt>
  double rewind(const ClearanceAt& clearance, const Vec3d& guess, double first_gap, double time) const {
    double free = 0.0;
    for (int halving = 0; halving < kRewinds && path_.angle > 0.0; ++halving) {
      const double middle = 0.5 * (free + time);
      const Clearance there = clearance(middle, guess);
      (!there.overlapping && there.gap >= first_gap ? free : time) = middle;
    }
    return free;
  }

  const Hull& hull_;
  Path path_;
};

// The walls of a room as planes, x low, x high, y low, ...
Plane wall_plane(const Room& room, int wall) {
  const int axis = wall / 2;
  const bool low = wall % 2 == 0;
  const double at = static_cast<double>(low ? room.inside.min[axis] : room.inside.max[axis]);
  return {(low ? 1.0 : -1.0) * Vec3d::Unit(axis), low ? at : -at};
}

// Where the hull is nearest to the wall: the middle of the vertices that are.
Vec3d point_on_wall(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Plane& wall) {
  const Vec3d normal = rotation.transpose() * wall.normal;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < hull.count(); ++i) {
    least = std::min(least, normal.dot(hull.vertex(i)));
  }
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

// One sweep's search for the first of all contacts. The answer does not depend on the order in which obstacles come.
class Search {
 public:
  Search(const Hull& hull, const Pose& from, const Pose& to)
      : hull_(hull),
        from_(from),
        to_(to),
        margins_(from, to),
        middle_(0.5F * (from.position + to.position)),
        reach_(hull.radius() + 0.5F * (to.position - from.position).norm() +
               static_cast<float>(2.0 * (margins_.standoff + margins_.slack))) {}

  // The ball that holds the hull all the way.
  const Vec3& middle() const { return middle_; }
  float reach() const { return reach_; }

  void meet(const Room& room) {
    const double away = static_cast<double>(hull_.radius()) + margins_.standoff + margins_.slack;
    for (int wall = 0; wall < 6; ++wall) {
      const Plane plane = wall_plane(room, wall);
      if (std::min(plane.normal.dot(from_.position.cast<double>()), plane.normal.dot(to_.position.cast<double>())) -
              plane.offset <=
          away) {
        const auto clearance = [this, &plane](double time, const Vec3d&) {
          return Clearance{false, plane, mover().gap(plane, time)};
        };
        take(mover().first_touch(clearance, plane.normal, margins_, limit()), room.element, plane);
      }
    }
  }

  void meet(const Convex& obstacle, std::uint32_t element) {
    const Vec3d middle = middle_.cast<double>();
    Vec3d guess = middle - closest_point(obstacle, middle);
    const double distance = guess.norm();
    if (distance > static_cast<double>(reach_)) {
      return;
    }
    if (distance > kTouching) {
      const Plane plane = supporting_plane(obstacle, guess / distance);
      if (mover().gap(plane, 0.0) > margins_.standoff + margins_.slack &&
          mover().clear_until(plane, 0.0, margins_.standoff) >= 1.0) {
        return;
      }
    } else {
      guess = from_.position.cast<double>() - obstacle.center + kTouching * Vec3d::Ones();
    }
    const auto clearance = [this, &obstacle](double time, const Vec3d& start) {
      return mover().clearance(obstacle, time, start);
    };
    take(mover().first_touch(clearance, guess, margins_, limit()), element, Plane{});
  }

  Contact contact(const Obstacles& obstacles) {
    Contact contact;
    if (!first_.hit) {
      return contact;
    }
    contact.hit = true;
    contact.inside = first_.inside;
    contact.fraction = static_cast<float>(first_.time);
    if (static_cast<double>(contact.fraction) > first_.time) {
      contact.fraction = std::nextafter(contact.fraction, 0.0F);
    }
    const Mat3d rotation = mover().path().matrix(first_.time);
    const Vec3d position = mover().path().position(first_.time);
    Vec3d point;
    if (is_room(obstacles)) {
      point = point_on_wall(hull_, rotation, position, wall_);
    } else {
      const Convex obstacle = obstacles.convex(element_);
      const Separation s = separate(hull_, rotation, position, obstacle, first_.normal);
      if (first_.inside || s.overlapping) {
        const Penetration p = penetrate(hull_, rotation, position, obstacle);
        point = p.point;
        first_.normal = p.normal;
      } else {
        point = s.point;
        first_.normal = s.plane.normal;
      }
    }
    contact.point = point.cast<float>();
    contact.normal = first_.normal.cast<float>().normalized();
    return contact;
  }

 private:
  // Most motions meet nothing and never need it.
  const Mover& mover() {
    if (!mover_) {
      mover_.emplace(hull_, from_, to_);
    }
    return *mover_;
  }

  double limit() const { return first_.time; }

  bool is_room(const Obstacles& obstacles) const {
    return std::any_of(obstacles.rooms().begin(), obstacles.rooms().end(),
                       [this](const Room& room) { return room.element == element_; });
  }

  void take(const Touch& touch, std::uint32_t element, const Plane& wall) {
    if (!touch.hit) {
      return;
    }
    const auto key = [](const Touch& t, std::uint32_t e) { return std::tuple(!t.inside, t.time, e); };
    if (!first_.hit || key(touch, element) < key(first_, element_)) {
      first_ = touch;
      element_ = element;
      wall_ = wall;
    }
  }

  const Hull& hull_;
  const Pose& from_;
  const Pose& to_;
  Margins margins_;
  Vec3 middle_;
  float reach_;  // m
  std::optional<Mover> mover_;
  Touch first_;
  std::uint32_t element_ = 0;
  Plane wall_;
};

}  // namespace

Pose interpolate(const Pose& from, const Pose& to, float fraction) {
  if (fraction <= 0.0F) {
    return from;
  }
  if (fraction >= 1.0F) {
    return to;
  }
  const Path path(from, to);
  const double time = static_cast<double>(fraction);
  return {path.position(time).cast<float>(), path.rotation(time).normalized().cast<float>()};
}

Contact sweep(const Obstacles& obstacles, const Hull& hull, const Pose& from, const Pose& to) {
  Search search(hull, from, to);
  for (const Room& room : obstacles.rooms()) {
    search.meet(room);
  }
  obstacles.for_each_near(search.middle(), search.reach(),
                          [&](std::uint32_t element) { search.meet(obstacles.convex(element), element); });
  return search.contact(obstacles);
}

bool overlaps(const Obstacles& obstacles, const Hull& hull, const Pose& pose) {
  return sweep(obstacles, hull, pose, pose).inside;
}

Contact sweep(const World& world, const DroneModel& drone, const Pose& from, const Pose& to) {
  return sweep(world.obstacles(), Hull(drone), from, to);
}

bool overlaps(const World& world, const DroneModel& drone, const Pose& pose) {
  return overlaps(world.obstacles(), Hull(drone), pose);
}

}  // namespace swiftlet::collision
