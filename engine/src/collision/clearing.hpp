// Clearing: moves a hull out of what it overlaps, or comes too near to.
#pragma once

#include <span>

#include "collision/hull.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/obstacles.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::collision {

// Returns the pose moved, without turning, until the hull keeps its standoff from the static world and from bodies at a time of
// their motion. It is moved away from the nearest obstacle first, again and again, and altogether by at most `most` (m). Among
// obstacles that leave too little room, the hull may still overlap one. Nothing is swept: the caller does.
Pose cleared(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double time,
             double most);

// Returns the pose moved by at most `most` (m) straight towards where the hull is cleared, until it hits something that it does
// not begin inside of. On its way out of several obstacles it may get deeper into one for a while: the shortest ways out of two
// may cross. If no place is found where it is free, it gets no deeper into any. Bodies stand at the end of their motion.
Pose led_out(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose, double most);

}  // namespace flockstep::collision
