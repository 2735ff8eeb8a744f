// MovingBodies: the solid bodies of one env during a tick, as drones meet them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "collision/hull.hpp"
#include "collision/moving_solid.hpp"
#include "collision/obstacles.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

// A view of arrays, which the batch owns.
struct MovingBodies {
  const float* from_position = nullptr;  // (count, 3) m, world frame, before the tick
  const float* from_quat = nullptr;      // (count, 4) body to world, before the tick
  const float* position = nullptr;       // (count, 3) m, after the tick
  const float* quat_wxyz = nullptr;      // (count, 4) after the tick
  // (count,) m, radius of a ball around `position` that contains the body during the whole tick; negative: drones pass through.
  const float* reach = nullptr;
  const Primitive* const* solids = nullptr;  // (count,) kind and half_extents; the poses are ignored
  // (count,) corners of the convex parts of meshes, instead of solids; null for other bodies. Null if there are no meshes.
  const std::vector<Corners>* const* parts = nullptr;
  std::size_t count = 0;

  // Returns the bodies of one env, if these are the bodies of all envs.
  MovingBodies of_env(std::size_t env, std::size_t per_env) const {
    if (per_env == 0) return {};
    const std::size_t first = env * per_env;
    return {from_position + 3 * first,
            from_quat + 4 * first,
            position + 3 * first,
            quat_wxyz + 4 * first,
            reach + first,
            solids + first,
            parts == nullptr ? nullptr : parts + first,
            per_env};
  }
};

// Returns true if the hull, standing at a pose after the tick, overlaps one of the bodies.
bool overlaps_body(const MovingBodies& bodies, const Obstacles& obstacles, const Hull& hull, const Pose& pose);

// The bodies that one drone may meet.
class NearSolids {
 public:
  // Takes those that reach into the ball of range_m around the origin. Their indices are their numbers in `bodies`; the parts of
  // a mesh share one. Allocates only if there are more than ever before. The result is valid until the next call.
  std::span<const MovingSolid> gather(const MovingBodies& bodies, const Vec3& origin, float range_m);

 private:
  std::vector<std::uint32_t> found_;
  std::vector<MovingSolid> solids_;
};

}  // namespace flockstep::collision
