// The swept hull: continuous collision of one moving convex hull against a world.
#pragma once

#include "swiftlet/drone_model.hpp"
#include "swiftlet/pose.hpp"
#include "swiftlet/world.hpp"

namespace swiftlet::collision {

// Where a motion ended.
struct Contact {
  bool hit = false;              // something was touched, or the motion began in penetration
  bool inside = false;           // the motion began in penetration; fraction is 0 and nothing moved
  float fraction = 1.0F;         // of the motion that was flown, in [0, 1]
  Vec3 point = Vec3::Zero();     // m, world frame, on the obstacle's surface
  Vec3 normal = Vec3::Zero();    // unit, world frame, from the obstacle towards the drone
};

// Position moves along the segment from `from` to `to`, rotation along the shortest arc, both uniformly in time.
Pose interpolate(const Pose& from, const Pose& to, float fraction);

// Sweeps the hull; on a hit the pose at `fraction` is the last free one. Allocates nothing.
Contact sweep(const World& world, const DroneModel& drone, const Pose& from, const Pose& to);

// True if the hull at this pose touches or penetrates anything.
bool overlaps(const World& world, const DroneModel& drone, const Pose& pose);

}  // namespace swiftlet::collision
