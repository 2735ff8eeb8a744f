// FreeSpace: tests where a level drone that faces +x fits, and which straight motions it can make.
#pragma once

#include <cstdint>
#include <span>

#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

class FreeSpace {
 public:
  FreeSpace(const World& world, const DroneModel& drone);

  // A cube of positions of the drone's origin; `half` is half its edge in m.
  struct Box {
    Eigen::Vector3d center;
    double half;
  };

  const collision::Obstacles& obstacles() const { return obstacles_; }

  bool is_free(const Vec3& place) const { return !collision::overlaps(obstacles_, hull_, Pose{.position = place}); }

  // Returns whether a straight motion is free. Sweeps pieces of at most 1 m, because a sweep tests every obstacle in a ball
  // around its motion.
  bool is_clear(const Vec3& from, const Vec3& to) const;

  // Same test in a single sweep, for a motion that can touch only these elements.
  bool is_clear(const Vec3& from, const Vec3& to, std::span<const std::uint32_t> elements) const {
    return collision::is_clear(obstacles_, elements, hull_, Pose{.position = from}, Pose{.position = to});
  }

  // Same test in a single sweep for the whole motion.
  bool is_free_leg(const Vec3& from, const Vec3& to) const {
    return !collision::sweep(obstacles_, hull_, Pose{.position = from}, Pose{.position = to}).hit;
  }

  // An obstacle with the box of drone positions at which the bounding boxes of drone and obstacle touch, with a margin.
  struct Obstacle {
    std::uint32_t element;
    Aabb taken;  // m
  };
  Obstacle obstacle(std::uint32_t element, const collision::Convex& convex) const;

  // Returns true if the drone stays clear of the obstacle at every position in the box, with enough margin that no sweep there
  // finds a contact. False is inconclusive.
  bool is_apart(const Obstacle& obstacle, const collision::Convex& convex, const Box& box) const;
  bool is_apart_from_walls(const Box& box) const;  // same test for the walls of all rooms

  // Returns the radius (m) around the center of a box beyond which obstacles are apart from it.
  float reach(const Box& box) const;

 private:
  const collision::Obstacles& obstacles_;
  collision::Hull hull_;
  Aabb extent_;    // m, bounds of the hull
  double margin_;  // m, well above the sweep's standoff
};

}  // namespace flockstep
