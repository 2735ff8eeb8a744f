// MovingSolid: a convex body that moves while a drone moves. Prepared once per motion, for any number of drones.
#pragma once

#include "collision/convex.hpp"
#include "collision/corners.hpp"
#include "collision/path.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::collision {

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
  const Path& path() const { return path_; }  // of the space that it fills: a sphere's never turns

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

}  // namespace flockstep::collision
