#include "collision/clearing.hpp"

#include <algorithm>
#include <limits>

#include "collision/convex_distance.hpp"
#include "collision/mover.hpp"
#include "collision/moving_sweep.hpp"
#include "collision/search.hpp"

namespace flockstep::collision {
namespace {

constexpr int kMaxMoves = 16;  // two walls and their corner need three

// The obstacle nearest to a hull, among those nearer than its standoff.
class Nearest {
 public:
  Nearest(const Hull& hull, const Pose& pose, const Vec3d& moved)
      : hull_(hull), path_(pose, pose), margins_(pose, pose), gap_(margins_.standoff - kResolution) {
    path_.start += moved;
  }

  // Returns the way (m) to the standoff from the nearest obstacle, 0 if the hull keeps it from all.
  Vec3d way() const { return is_found_ ? Vec3d((margins_.standoff - gap_) * normal_) : Vec3d(Vec3d::Zero()); }

  void test(const RoomInterior& room) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const bool low : {true, false}) {
        const Plane wall = wall_plane(room, axis, low);
        take(wall, Mover(hull_, path_).gap(wall, 0.0));
      }
    }
  }

  void test(const Convex& obstacle) {
    const double reach = static_cast<double>(hull_.radius()) + margins_.standoff;
    const Vec3d apart = path_.start - closest_point(obstacle, path_.start);
    if (apart.squaredNorm() > reach * reach) return;
    const Mover mover(hull_, path_);
    const Vec3d outwards = path_.start - obstacle.center + kTouching * Vec3d::Ones();  // never quite zero
    const Clearance now = mover.clearance(obstacle, 0.0, outwards);
    if (!now.overlapping && now.gap > 0.0) return take(now.plane, now.gap);
    const Plane out = supporting_plane(obstacle, penetrate(hull_, path_.first_matrix, path_.start, obstacle).normal);
    take(out, mover.gap(out, 0.0));
  }

 private:
  void take(const Plane& plane, double gap) {
    if (!(gap < gap_)) return;
    gap_ = gap;
    normal_ = plane.normal;
    is_found_ = true;
  }

  const Hull& hull_;
  Path path_;
  Margins margins_;
  double gap_;
  Vec3d normal_ = Vec3d::Zero();
  bool is_found_ = false;
};

}  // namespace

Pose cleared(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double time,
             double most) {
  Vec3d moved = Vec3d::Zero();
  if (!(most > 0.0)) return pose;
  for (int move = 0; move < kMaxMoves && moved.norm() < most; ++move) {
    Nearest nearest(hull, pose, moved);
    const Vec3 center = pose.position + moved.cast<float>();
    for (const RoomInterior& room : obstacles.rooms()) nearest.test(room);
    obstacles.for_each_near(center, hull.radius() + static_cast<float>(Margins(pose, pose).resting()),
                            [&](std::uint32_t element) { nearest.test(obstacles.convex(element)); });
    for (const MovingSolid& body : bodies) nearest.test(body.at(time));
    const Vec3d way = nearest.way();
    if (way.isZero()) break;
    moved += way;
  }
  if (const double length = moved.norm(); length > most) moved *= most / length;
  return {(pose.position.cast<double>() + moved).cast<float>(), pose.rotation};
}

Pose led_out(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double most) {
  const Pose out = cleared(obstacles, bodies, hull, pose, 1.0, std::numeric_limits<double>::infinity());
  const bool is_free = !first_contact(obstacles, bodies, hull, out, out, 1.0).inside;
  const Pose target = is_free ? out : cleared(obstacles, bodies, hull, pose, 1.0, most);
  const float flown = first_contact(obstacles, bodies, hull, pose, target, 1.0, is_free).fraction;
  const double length = (target.position - pose.position).cast<double>().norm();
  return interpolate(pose, target, std::min(flown, static_cast<float>(most / length)));
}

}  // namespace flockstep::collision
