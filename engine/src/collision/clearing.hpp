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

}  // namespace flockstep::collision
