// BodySearch: the first contact of one motion of the hull with the static world and with bodies that move at the same time.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include "collision/mover.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/path.hpp"
#include "collision/search.hpp"

namespace flockstep::collision {

// The bodies have members of their own, so that a search without bodies costs nothing more.
class BodySearch : public Search {
 public:
  // While the hull moves, bodies move from time `begin` to time `end` of their motion. leads_out: as for first_contact().
  BodySearch(const Hull& hull, const Pose& from, const Pose& to, double begin, double end, bool leads_out = false)
      : Search(hull, from, to), begin_(begin), end_(end) {
    leads_out_ = leads_out;
  }

  using Search::test;

  void test(const MovingSolid& body) {
    const Vec3d start = body.position(begin_);
    const Vec3d advance = (end_ - begin_) * body.path().velocity;
    const Vec3d from = from_.position.cast<double>();
    if (!balls_meet(from - start, to_.position.cast<double>() - from - advance, body.radius())) return;
    if (body.path().turns()) {
      meet_turning(body);
    } else {
      meet_straight(body, advance);
    }
  }

  // The contact that ends the motion, if there is one, and its body, or null for the static world.
  const Touch& end_of_motion() const { return is_ended_by_body() ? first_of_body_ : first_; }
  const MovingSolid* body_at_end() const { return is_ended_by_body() ? first_body_ : nullptr; }

  float fraction() const {
    const double time = end_of_motion().time;
    const double least_gain = std::min(least_gain_, least_gain_of_body_);
    return leaves_turning_ && time < 1.0 ? 0.0F : flown(time, least_gain);
  }

  // The contact to report, and its body, or null for the static world.
  Contact contact() const {
    const bool inside = inside_.hit || inside_of_body_.hit;
    const Touch& shown = inside_.hit ? inside_ : (inside ? inside_of_body_ : end_of_motion());
    return shown.hit ? contact_of(shown, inside, fraction()) : Contact{};
  }
  const MovingSolid* body_of_contact() const {
    return inside_.hit ? nullptr : (inside_of_body_.hit ? inside_body_ : body_at_end());
  }

 private:
  // Returns false if the balls around the hull and a body stay apart. start: from the body to the hull; way: change of that.
  bool balls_meet(const Vec3d& start, const Vec3d& way, double radius) const {
    const double length2 = way.squaredNorm();
    const double nearest = length2 > 0.0 ? std::clamp(-start.dot(way) / length2, 0.0, 1.0) : 0.0;
    const double reach = reach_of_ball() + radius;
    return (start + nearest * way).squaredNorm() <= reach * reach;
  }

  // Returns the clearance from a body at the start, or nothing if a plane separates them during the whole motion.
  template <class Track>
  std::optional<Clearance> clearance_from(const Mover<Track>& mover, const Convex& body, const Vec3d& start, const Vec3d& way,
                                          double reach) const {
    if (body.kind == Convex::Kind::hull) return clearance_from_corners(mover, body);
    const std::optional<Approach> approach = approach_of_ball(body, start, way, reach);
    if (!approach) return std::nullopt;
    return clearance_at_start(mover, body, *approach);
  }

  // Seen from the last place of a body that does not turn, the hull moves along a Path, too.
  void meet_straight(const MovingSolid& body, const Vec3d& advance) {
    Path path = mover().path();
    path.start += advance;
    path.velocity -= advance;
    const Convex last = body.at(end_);
    const Mover mover(hull_, path);
    const std::optional<Clearance> start = clearance_from(mover, last, path.start, path.velocity, reach_of_ball());
    if (!start) return;
    Found found = touch(mover, last, *start, end_of_motion().time);
    found.touch.point -= (1.0 - time_of(found.touch)) * advance;
    take(found, body);
  }

  void meet_turning(const MovingSolid& body) {
    const RelativePath path(mover().path(), body.path().part(begin_, end_));
    // The path deviates from its chord by at most an eighth of its acceleration.
    const Vec3d chord = path.position(1.0) - path.position(0.0);
    const double reach = reach_of_ball() + 0.125 * path.acceleration(0.0);
    const Convex last = body.at(end_);
    const Mover mover(hull_, path);
    const std::optional<Clearance> start = clearance_from(mover, last, path.position(0.0), chord, reach);
    if (!start) return;
    Found found = touch(mover, last, *start, end_of_motion().time);
    leaves_turning_ |= !std::isinf(found.gain);
    const double time = time_of(found.touch);
    const Mat3d back = path.turn(time).transpose();
    found.touch.point = path.body(time) + back * (found.touch.point - path.body(1.0));
    found.touch.normal = back * found.touch.normal;
    take(found, body);
  }

  // Returns the time that point and normal belong to.
  static double time_of(const Touch& touch) { return touch.inside ? 0.0 : touch.time; }

  // At the same time the static world comes first.
  bool is_ended_by_body() const { return first_of_body_.time < first_.time; }

  void take(const Found& found, const MovingSolid& body) {
    least_gain_of_body_ = std::min(least_gain_of_body_, found.gain);
    const Touch& touch = found.touch;
    if (!touch.hit) return;
    if (touch.inside && (!inside_of_body_.hit || body.index() < inside_body_->index())) {
      inside_of_body_ = touch;
      inside_body_ = &body;
    }
    const int index = first_body_ != nullptr ? first_body_->index() : 0;
    if (touch.time < 1.0 && std::tuple(touch.time, body.index()) < std::tuple(first_of_body_.time, index)) {
      first_of_body_ = touch;
      first_body_ = &body;
    }
  }

  double begin_;
  double end_;
  // As in Search, for bodies.
  Touch first_of_body_;
  Touch inside_of_body_;
  const MovingSolid* first_body_ = nullptr;
  const MovingSolid* inside_body_ = nullptr;
  double least_gain_of_body_ = std::numeric_limits<double>::infinity();
  bool leaves_turning_ = false;  // the hull begins nearer than Margins::floor() to a body that turns
};

}  // namespace flockstep::collision
