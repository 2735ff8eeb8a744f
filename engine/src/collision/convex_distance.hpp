// The distance between the hull and a convex obstacle, by a library's GJK (measured in bench/convex_distance.cpp).
#pragma once

#include "collision/convex.hpp"
#include "collision/hull.hpp"

namespace flockstep::collision {

// The obstacle lies in normal . x <= offset (world frame, m). The hull's distance from this half space bounds its distance from
// the obstacle from below, exactly, whatever the accuracy of the search that found the plane.
struct Plane {
  Vec3d normal = Vec3d::UnitZ();  // unit, from the obstacle towards the hull
  double offset = 0.0;            // m
};

// The half space with this normal that just holds the obstacle.
Plane supporting_plane(const Convex& obstacle, const Vec3d& normal);

struct Separation {
  bool overlapping = false;     // or closer than 0.1 um; nothing below is set then
  Plane plane;                  // the widest gap's
  double gap = 0.0;             // m, between plane and hull: the distance from below, up to rounding
  double distance = 0.0;        // m, between two actual points of hull and obstacle: the distance from above
  Vec3d point = Vec3d::Zero();  // m, world frame, the obstacle's nearest
};

// gap and distance agree within 3e-4 of themselves and 1 um, unless the search failed from every start. A failed search may
// also take hull and obstacle for apart that overlap; its gap is not positive then.
// guess: a direction (any length, not zero) from the obstacle to the hull; a good one saves iterations.
Separation separate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, const Vec3d& guess);

// How to leave an obstacle that the hull penetrates.
struct Penetration {
  Vec3d normal = Vec3d::UnitZ();  // unit, from the obstacle towards the hull: the shortest way out
  Vec3d point = Vec3d::Zero();    // m, world frame, on the obstacle's surface
};
Penetration penetrate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle);

}  // namespace flockstep::collision
