// Obstacles: a world as the collision stage wants it. Built once per world; immutable, so any number of threads may ask.
#pragma once

#include <cstdint>
#include <memory_resource>
#include <span>
#include <type_traits>
#include <vector>

#include "base/prefetch.hpp"
#include "collision/convex.hpp"
#include "trace/scene.hpp"

namespace flockstep::collision {

// The inside of an axis-aligned box; all the rest is solid.
struct Room {
  std::uint32_t element = 0;
  Aabb inside;  // m
};

class Obstacles {
 public:
  // Of a world and its scene, which outlive it.
  Obstacles(const World& world, const trace::Scene& scene, std::pmr::memory_resource& memory = *std::pmr::get_default_resource());

  std::span<const Room> rooms() const { return rooms_; }

  // The element (index into World::primitives(), then primitives().size() + triangle index), which is not a room.
  Convex convex(std::uint32_t element) const;

  // Whether nothing comes within radius (m) of center; false may also be said of what comes near.
  bool is_clear(const Vec3& center, float radius) const;

  // Whether something comes within reach (m) of the point.
  bool touches(const Vec3& point, float reach) const;

  // What every motion asks for first. The obstacles themselves and their scene have to be in the cache.
  void prefetch_parts() const {
    prefetch(rooms_.data(), rooms_.size() * sizeof(Room));
    scene_->prefetch_parts();
  }

  // How far (m) the point is from the nearest solid, triangle or wall, 0 within a solid and outside of a room; `most` where
  // nothing is nearer than that.
  float distance(const Vec3& point, float most) const;

  // Calls visit(element) for each element but the rooms whose bounding box comes within radius (m) of center, and perhaps for
  // some more, in any order.
  template <class Visit>
  void for_each_near(const Vec3& center, float radius, Visit&& visit) const {
    const auto call = [](void* context, std::uint32_t element) {
      (*static_cast<std::remove_reference_t<Visit>*>(context))(element);
    };
    scene_->for_each_nearby(center, radius, call, &visit);
  }

 private:
  const World* world_;
  const trace::Scene* scene_;
  std::pmr::vector<Room> rooms_;
  std::pmr::vector<Convex> convexes_;  // one per primitive; unused where it is a room
};

}  // namespace flockstep::collision
