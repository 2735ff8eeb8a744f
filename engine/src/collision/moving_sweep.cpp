#include "collision/moving_sweep.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "collision/body_search.hpp"
#include "collision/convex_distance.hpp"
#include "collision/mover.hpp"
#include "collision/path.hpp"

namespace flockstep::collision {

namespace {

constexpr int kMaxPushes = 64;
constexpr std::size_t kMaxSupports = 6;
constexpr double kMinPart = 1.0 / 40.0;  // fraction of the time to push in; kMaxPushes of them leave some for other contacts
constexpr double kMaxTurn = 0.2;         // rad, of a body while it pushes along one normal
constexpr double kMaxAdvance = 0.1;      // m, of a turning body while it pushes along one normal
constexpr double kMaxSlip = 4.0;         // length of a way relative to the farthest advance
constexpr double kMinSlip = 1e-3;        // m
constexpr double kDiscrepancy = 1e-7;    // m; how much a way may fall short of an advance
constexpr double kParallel = 1e-6;       // determinant of unit normals that count as linearly dependent
constexpr double kBeyond = 0.01;         // m; far enough from a body to find its surface from outside

// Meets everything near the hull's way, except some bodies.
template <class IsSkipped>
void test_all(BodySearch& search, const Obstacles& obstacles, std::span<const MovingSolid> bodies, const IsSkipped& is_skipped) {
  for (const RoomInterior& room : obstacles.rooms()) search.test(room);
  obstacles.for_each_near(search.middle(), search.reach(),
                          [&](std::uint32_t element) { search.test(obstacles.convex(element), element); });
  for (const MovingSolid& body : bodies) {
    if (!is_skipped(body)) search.test(body);
  }
}

Path standing(const Pose& pose, const Vec3d& start, const Vec3d& velocity) {
  Path path(pose, pose);
  path.start = start;
  path.velocity = velocity;
  return path;
}

// Something that the hull touches and must not enter: a body that advances, or an obstacle.
struct Support {
  const MovingSolid* body = nullptr;  // none: an obstacle
  Vec3d normal = Vec3d::Zero();       // towards the hull
  double gap = 0.0;                   // m, that the hull shall have at the end, along the normal
  double advance = 0.0;               // m along the normal, that the hull must move
  // The gap is that of the body's supporting plane. Else it is that of its surface, found by a sweep against the normal, and the
  // hull stays ahead of the body's point at the contact.
  bool is_flat = true;
  double time = 0.0;               // time of the contact
  Vec3d point = Vec3d::Zero();     // the body's at the contact
  Vec3d position = Vec3d::Zero();  // the hull's at the contact
};

// The supports of a hull that is pushed.
struct Supports {
  std::array<Support, kMaxSupports> all;
  std::size_t count = 0;

  std::span<Support> items() { return std::span(all).first(count); }
  bool has(const MovingSolid& body) const {
    return std::any_of(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count),
                       [&body](const Support& support) { return support.body == &body; });
  }
};

// Returns the shortest way with normal . way >= advance for each support. It is a combination, with positive weights, of the
// normals of at most three supports, for which equality holds. Returns nothing if no way is short enough.
std::optional<Vec3d> shortest_way(std::span<const Support> supports) {
  double farthest = 0.0;
  for (const Support& support : supports) farthest = std::max(farthest, support.advance);
  const double most = kMaxSlip * farthest + kMinSlip;
  std::optional<Vec3d> best;
  const auto consider = [&](const Vec3d& way) {
    const bool is_enough = std::all_of(supports.begin(), supports.end(), [&way](const Support& support) {
      return support.normal.dot(way) >= support.advance - kDiscrepancy;
    });
    if (is_enough && way.norm() <= most && (!best || way.squaredNorm() < best->squaredNorm())) best = way;
  };
  consider(Vec3d::Zero());
  for (std::size_t i = 0; i < supports.size(); ++i) {
    const Support& a = supports[i];
    if (a.advance > 0.0) consider(a.advance * a.normal);
    for (std::size_t j = i + 1; j < supports.size(); ++j) {
      const Support& b = supports[j];
      const double cosine = a.normal.dot(b.normal);
      const double sine2 = 1.0 - cosine * cosine;
      if (sine2 < kParallel) continue;
      const double x = (a.advance - cosine * b.advance) / sine2;
      const double y = (b.advance - cosine * a.advance) / sine2;
      if (x >= 0.0 && y >= 0.0) consider(x * a.normal + y * b.normal);
      for (std::size_t k = j + 1; k < supports.size(); ++k) {
        const Support& c = supports[k];
        const Vec3d across = a.normal.cross(b.normal);
        const double volume = across.dot(c.normal);
        if (volume * volume < kParallel) continue;
        const Vec3d bc = b.normal.cross(c.normal) / volume;
        const Vec3d ca = c.normal.cross(a.normal) / volume;
        const Vec3d ab = across / volume;
        const Vec3d way = a.advance * bc + b.advance * ca + c.advance * ab;
        if (std::min({way.dot(bc), way.dot(ca), way.dot(ab)}) >= 0.0) consider(way);
      }
    }
  }
  return best;
}

// A hull that bodies push.
class Pushed {
 public:
  Pushed(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double begin)
      : obstacles_(obstacles), bodies_(bodies), hull_(hull), first_(pose), pose_(pose), begin_(begin), time_(begin) {}

  Push run() {
    Push result;
    result.jammed = !move();
    result.pushed = pose_.position != first_.position;
    result.pose = pose_;
    result.farthest = farthest_;
    result.jammed = result.jammed || overlaps_body();
    return result;
  }

  // Returns true if the hull overlaps a body at the end of the motion.
  bool overlaps_body() const {
    return std::any_of(bodies_.begin(), bodies_.end(),
                       [this](const MovingSolid& body) { return is_near(body, 1.0) && gap_from(body, pose_, 1.0) <= kTouching; });
  }

 private:
  // Returns false if the hull is jammed.
  bool move() {
    for (int push = 0; push < kMaxPushes; ++push) {
      BodySearch search(hull_, pose_, pose_, time_, 1.0);
      for (const MovingSolid& body : bodies_) search.test(body);
      const Touch& touch = search.end_of_motion();
      if (!touch.hit) return true;
      time_ += touch.time * (1.0 - time_);
      if (!give_way(support_of(touch, *search.body_at_end()))) return false;
      if (time_ >= 1.0) return true;
    }
    return false;
  }

  // Moves the hull out of the way of a body, until the body has moved enough that its normal should be found again.
  bool give_way(const Support& first) {
    Supports supports;
    supports.all[supports.count++] = first;
    while (true) {
      const double end = end_of_push(supports.items());
      const std::optional<Vec3d> way = find_way(supports, end);
      if (!way) return false;
      const Pose target{(pose_.position.cast<double>() + *way).cast<float>(), pose_.rotation};
      BodySearch search(hull_, pose_, target, time_, end);
      test_all(search, obstacles_, bodies_, [&supports](const MovingSolid& body) { return supports.has(body); });
      const Touch& touch = search.end_of_motion();
      if (!touch.hit) {
        move_to(target);
        time_ = end;
        return true;
      }
      const float flown = search.fraction();
      move_to(interpolate(pose_, target, flown));
      time_ += static_cast<double>(flown) * (end - time_);
      if (supports.count == kMaxSupports) return false;
      supports.all[supports.count++] =
          search.body_at_end() != nullptr ? support_of(touch, *search.body_at_end()) : Support{.normal = touch.normal};
    }
  }

  void move_to(const Pose& pose) {
    pose_ = pose;
    farthest_ = std::max(farthest_, (pose.position - first_.position).norm());
  }

  double end_of_push(std::span<const Support> supports) const {
    double part = 1.0;
    for (const Support& support : supports) {
      if (support.body == nullptr || !support.body->path().turns()) continue;
      const Path& path = support.body->path();
      part = std::min({part, kMaxTurn / path.angle, kMaxAdvance / std::max(path.velocity.norm(), kMaxAdvance)});
    }
    const double end = time_ + std::max(part, kMinPart * (1.0 - begin_));
    return end < 1.0 ? end : 1.0;
  }

  // Returns the way of the hull until the bodies' time `end`, or nothing if it is jammed.
  std::optional<Vec3d> find_way(Supports& supports, double end) const {
    for (Support& support : supports.items()) support.advance = advance_of(support, end);
    while (true) {
      std::optional<Vec3d> way = shortest_way(supports.items());
      if (!way) {
        const Margins margins(pose_, pose_);
        const auto items = supports.items();
        const bool needs_none = std::all_of(items.begin(), items.end(), [&margins](const Support& support) {
          return support.advance <= margins.standoff - margins.floor();
        });
        if (needs_none) way = Vec3d::Zero();
        return way;
      }
      if (supports.count == 1) return way;
      // The surface of a body that turns, along another way than its normal, is found by trial.
      const Pose there{(pose_.position.cast<double>() + *way).cast<float>(), pose_.rotation};
      std::optional<Support> more;
      for (const Support& support : supports.items()) {
        if (support.is_flat || gap_from(*support.body, there, end) >= Margins(there, there).floor()) continue;
        more = support;
        more->normal = plane_from(*support.body, there, end).normal;
        more->is_flat = true;
        break;
      }
      if (!more) return way;
      if (supports.count == kMaxSupports) return std::nullopt;
      more->advance = advance_of(*more, end);
      supports.all[supports.count++] = *more;
    }
  }

  Support support_of(const Touch& touch, const MovingSolid& body) const {
    Support support{.body = &body, .normal = touch.normal, .gap = Margins(pose_, pose_).standoff};
    support.time = time_;
    support.point = touch.point;
    support.position = pose_.position.cast<double>();
    support.is_flat = !body.path().turns();
    if (touch.inside) {
      support.is_flat = true;
      const double at_first = gap_from(body, first_, begin_);
      if (at_first <= kTouching) support.gap = at_first;
    }
    return support;
  }

  double advance_of(const Support& support, double end) const {
    if (support.body == nullptr) return 0.0;
    const Convex convex = support.body->at(end);
    const Vec3d position = pose_.position.cast<double>();
    const double flat =
        support.gap - Mover(hull_, standing(pose_, position, Vec3d::Zero())).gap(supporting_plane(convex, support.normal), 0.0);
    if (support.is_flat) return flat;
    // Comes from outside, against the normal, and stops at the body.
    const Vec3d back = -(flat + kBeyond) * support.normal;
    const Mover mover(hull_, standing(pose_, position - back, back));
    const auto clearance = [&](double time, const Vec3d& guess) { return mover.clearance(convex, time, guess); };
    const Touch touch = mover.first_touch(clearance(0.0, support.normal), clearance, Margins(pose_, pose_), 1.0);
    const double surface = touch.hit ? (flat + kBeyond) * (1.0 - touch.time) : 0.0;
    const Vec3d way = support.body->point_after(support.point, support.time, end) - support.point;
    return std::max(surface, support.normal.dot(way + support.position - position));
  }

  bool is_near(const MovingSolid& body, double time) const {
    const double reach = body.radius() + static_cast<double>(hull_.radius()) + Margins(pose_, pose_).resting();
    return (pose_.position.cast<double>() - body.position(time)).squaredNorm() <= reach * reach;
  }

  // Returns the gap from a body, negative inside.
  double gap_from(const MovingSolid& body, const Pose& pose, double time) const {
    return clearance_from(body, pose, time).second;
  }
  Plane plane_from(const MovingSolid& body, const Pose& pose, double time) const {
    return clearance_from(body, pose, time).first;
  }

  std::pair<Plane, double> clearance_from(const MovingSolid& body, const Pose& pose, double time) const {
    const Mover mover(hull_, Path(pose, pose));
    const Convex convex = body.at(time);
    const Vec3d outwards = mover.path().start - convex.center + kTouching * Vec3d::Ones();  // never quite zero
    const Clearance clearance = mover.clearance(convex, 0.0, outwards);
    if (!clearance.overlapping && clearance.gap > 0.0) return {clearance.plane, clearance.gap};
    const Plane out = supporting_plane(convex, penetrate(hull_, mover.path().first_matrix, mover.path().start, convex).normal);
    return {out, mover.gap(out, 0.0)};
  }

  const Obstacles& obstacles_;
  std::span<const MovingSolid> bodies_;
  const Hull& hull_;
  const Pose first_;
  Pose pose_;
  const double begin_;
  double time_;  // time in the bodies' motion
  float farthest_ = 0.0F;
};

MovingContact contact_of(const BodySearch& search, double begin) {
  MovingContact contact{search.contact()};
  if (const MovingSolid* const body = search.body_of_contact()) {
    contact.body = body->index();
    const double time = begin + (contact.inside ? 0.0 : static_cast<double>(contact.fraction) * (1.0 - begin));
    contact.velocity = body->velocity(contact.point.cast<double>(), time).cast<float>();
  }
  return contact;
}

}  // namespace

MovingContact first_contact(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& from,
                            const Pose& to, double begin, bool leads_out) {
  BodySearch search(hull, from, to, begin, 1.0, leads_out);
  test_all(search, obstacles, bodies, [](const MovingSolid&) { return false; });
  return contact_of(search, begin);
}

MovingContact first_contact(const MovingSolid& body, const Hull& hull, const Pose& from, const Pose& to) {
  BodySearch search(hull, from, to, 0.0, 1.0);
  search.test(body);
  return contact_of(search, 0.0);
}

Push push(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double begin) {
  return Pushed(obstacles, bodies, hull, pose, begin).run();
}

}  // namespace flockstep::collision
