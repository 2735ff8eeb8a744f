// The swept hull: continuous collision detection of one moving convex hull against a world.
#pragma once

#include <cstdint>
#include <span>

#include "collision/hull.hpp"
#include "collision/obstacles.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::collision {

// The result of a motion.
struct Contact {
  bool hit = false;            // something was touched, or the motion began in penetration
  bool inside = false;         // the motion began in penetration; it was flown only if it led out, never deeper
  float fraction = 1.0F;       // fraction of the motion that was flown, in [0, 1]
  Vec3 point = Vec3::Zero();   // m, world frame, on the obstacle's surface; 0 without a hit
  Vec3 normal = Vec3::Zero();  // unit, world frame, from the obstacle towards the drone; 0 without a hit
};

// The hull stops this far (m) from an obstacle, plus a few float32 steps of its coordinates, so that its rounded pose is free.
// However many motions follow, it never comes nearer than half of this, because the limit depends only on the place and not on
// earlier motions.
inline constexpr double kStandoff = 1e-4;

// Moves the position along the segment from `from` to `to` and the rotation along the shortest arc, both uniformly in time.
Pose interpolate(const Pose& from, const Pose& to, float fraction);

// Sweeps the hull. On a hit, the pose interpolated at `fraction` is the last free one. A hull that rests at the standoff may
// leave or slide along the obstacle. If a motion pushes it towards the obstacle, the contact has fraction 0. A hull that starts
// inside an obstacle, or nearer than any motion ends, may move away; point and normal then show the way out. If several
// contacts come first at the same time, the one with the lowest element is reported. Allocates nothing; the result depends only
// on the arguments.
Contact sweep(const Obstacles& obstacles, const Hull& hull, const Pose& from, const Pose& to);

// Returns true if a sweep finds no contact with the walls of rooms or with these elements, and the hull does not begin inside
// one of them.
bool is_clear(const Obstacles& obstacles, std::span<const std::uint32_t> elements, const Hull& hull, const Pose& from,
              const Pose& to);

// Returns true if the hull at this pose touches or penetrates anything: a sweep from here would begin inside.
bool overlaps(const Obstacles& obstacles, const Hull& hull, const Pose& pose);

}  // namespace flockstep::collision
