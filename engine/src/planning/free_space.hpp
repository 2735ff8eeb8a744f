// FreeSpace: where a level drone that faces +x fits, and which straight motions it can make.
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

  // A box of places for the drone's origin; `half` (m) is half its edge along every axis.
  struct Box {
    Eigen::Vector3d center;
    double half;
  };

  const collision::Obstacles& obstacles() const { return obstacles_; }

  bool is_free(const Vec3& place) const { return !collision::overlaps(obstacles_, hull_, Pose{.position = place}); }

  // Sweeps pieces of at most 1 m, because a sweep tests every obstacle in a ball around its motion.
  bool is_clear(const Vec3& from, const Vec3& to) const;

  // The same in one sweep, for a motion on which nothing but these elements can be touched.
  bool is_clear(const Vec3& from, const Vec3& to, std::span<const std::uint32_t> elements) const {
    return collision::is_clear(obstacles_, elements, hull_, Pose{.position = from}, Pose{.position = to});
  }

  // One sweep for the whole motion.
  bool is_free_leg(const Vec3& from, const Vec3& to) const {
    return !collision::sweep(obstacles_, hull_, Pose{.position = from}, Pose{.position = to}).hit;
  }

  // An obstacle, and the box of all places at which the box around the drone touches the box around the obstacle, with a margin.
  struct Obstacle {
    std::uint32_t element;
    Aabb taken;  // m
  };
  Obstacle obstacle(std::uint32_t element, const collision::Convex& convex) const;

  // True if the drone stays clear of the obstacle at every place of the box, by so much that no sweep there finds a contact.
  // False says nothing.
  bool is_apart(const Obstacle& obstacle, const collision::Convex& convex, const Box& box) const;
  bool is_apart_from_walls(const Box& box) const;  // the same for the walls of all rooms

  // Radius (m) around the center of a box. Obstacles farther away are apart from it.
  float reach(const Box& box) const;

 private:
  const collision::Obstacles& obstacles_;
  collision::Hull hull_;
  Aabb extent_;    // m, of the hull
  double margin_;  // m, well beyond the sweep's standoff
};

}  // namespace flockstep
