// MovingBodies: the solid bodies of one env during a tick, as drones hit them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "collision/convex.hpp"
#include "collision/hull.hpp"
#include "collision/obstacles.hpp"
#include "collision/path.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

// MovingSolid: a convex body that moves while a drone moves. Prepared once per motion, for any number of drones.
class alignas(64) MovingSolid {
 public:
  // Moves as Path does: the position along the segment, the rotation along the shortest arc. At a half turn the signs of the
  // quaternions choose the arc. kind: any except a room. half_extents: as in Primitive. index: not negative; ordered as the
  // bodies of a motion are. Parts of one body may share it.
  MovingSolid(PrimitiveKind kind, const Vec3& half_extents, const Pose& from, const Pose& to, int index);
  // The convex hull of corners, which must outlive the body.
  MovingSolid(const Corners& corners, const Pose& from, const Pose& to, int index);

  int index() const { return index_; }
  double radius() const { return radius_; }   // m, of the ball around the body's origin that contains it
  const Path& path() const { return path_; }  // motion of the space that it fills: a sphere's never turns

  Vec3d position(double time) const { return path_.position(time); }

  // Returns the body at a time from 0 to 1.
  Convex at(double time) const;

  // Returns where the body's point that is at `point` (world frame) at one time is at another time, along its path().
  Vec3d point_after(const Vec3d& point, double time, double later) const;

  // Returns the velocity (m per motion) of the body's point that is at `point` (world frame) at that time.
  Vec3d velocity(const Vec3d& point, double time) const;

 private:
  MovingSolid(const Convex& end, const Pose& from, const Pose& to, int index);

  // Most bodies are out of reach, which the radius and the beginning of the path show. These share a cache line.
  double radius_ = 0.0;
  int index_ = 0;
  Path path_;
  Convex end_;
  Vec3d turning_;  // rad per motion, world frame; the same at all times
};

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

// The bodies that one drone may hit.
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
