// The distance between the hull and a convex obstacle, by Bullet's GJK: it takes half the time of FCL's, allocates nothing, and
// never reported a gap between overlapping bodies. Far from round obstacles it is coarse (up to 0.2 mm), so the sweep uses the
// plane that the search found instead: the hull's gap to that plane is a valid lower bound even if the search ended early. Two
// bounds that disagree reveal that, and the search restarts.
#pragma once

#include "collision/convex.hpp"
#include "collision/hull.hpp"

namespace flockstep::collision {

// The obstacle lies in normal . x <= offset (world frame, m). The distance of the hull from this half space is an exact lower
// bound of its distance from the obstacle, even if the search that found the plane is inaccurate.
struct Plane {
  Vec3d normal = Vec3d::UnitZ();  // unit, from the obstacle towards the hull
  double offset = 0.0;            // m
};

// Returns the smallest half space with this normal that contains the obstacle.
Plane supporting_plane(const Convex& obstacle, const Vec3d& normal);

struct Separation {
  bool overlapping = false;     // or closer than 0.1 um; the fields below are then unset
  Plane plane;                  // with the widest gap found
  double gap = 0.0;             // m, between plane and hull: lower bound of the distance, up to rounding
  double distance = 0.0;        // m, between two points of hull and obstacle: upper bound of the distance
  Vec3d point = Vec3d::Zero();  // m, world frame, nearest point of the obstacle
};

// gap and distance differ by at most 3e-4 of the distance plus 1 um, unless the search failed from every start. A failed search
// may also report an overlapping hull and obstacle as separate; its gap is not positive then. guess: a direction (any length,
// not zero) from the obstacle to the hull; a good one saves iterations.
Separation separate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, const Vec3d& guess);

// Returns the point of a convex of the kind hull that is nearest to `point`, or `point` itself if it is inside; world frame. The
// plane through the result across the way to `point` never cuts the convex; its distance has the error of Separation::gap.
Vec3d closest_point_of_hull(const Convex& convex, const Vec3d& point);

// The way out of an obstacle that the hull penetrates.
struct Penetration {
  Vec3d normal = Vec3d::UnitZ();  // unit, from the obstacle towards the hull: the shortest way out
  Vec3d point = Vec3d::Zero();    // m, world frame, on the obstacle's surface
};
Penetration penetrate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle);

}  // namespace flockstep::collision
