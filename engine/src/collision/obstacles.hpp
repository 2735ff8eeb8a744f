// Obstacles: a world prepared for collision queries. Built once per world; immutable, so any number of threads may query it.
#pragma once

#include <cstdint>
#include <limits>
#include <memory_resource>
#include <span>
#include <type_traits>
#include <vector>

#include "base/near_memory.hpp"
#include "collision/convex.hpp"
#include "trace/scene.hpp"

namespace flockstep::collision {

// The inside of an axis-aligned box; everything outside is solid.
struct RoomInterior {
  std::uint32_t element = 0;
  Aabb inside;  // m
};

// The point of an obstacle that is nearest to another point.
struct NearestPoint {
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  Vec3 point = Vec3::Constant(std::numeric_limits<float>::quiet_NaN());
  float distance = 0.0F;          // m
  std::uint32_t element = kNone;  // see Obstacles::convex(); also of a room
};

class Obstacles {
 public:
  // The world and its scene must outlive the obstacles.
  Obstacles(const World& world, const trace::Scene& scene, std::pmr::memory_resource& memory = *std::pmr::get_default_resource());

  std::span<const RoomInterior> rooms() const { return rooms_; }

  // Returns the solid or triangle of an element (index into World::primitives(), then primitives().size() + triangle index),
  // which must not be a room.
  Convex convex(std::uint32_t element) const;

  // Returns true if nothing is within radius (m) of center. It tests bounding boxes, so it may return false for obstacles that
  // are farther away.
  bool is_clear(const Vec3& center, float radius) const;

  // Returns true if something is within reach (m) of the point.
  bool touches(const Vec3& point, float reach) const;

  // Prefetches the data that every motion reads first. The obstacles and their scene must already be in the cache.
  void prefetch_parts() const {
    prefetch(rooms_.data(), rooms_.size() * sizeof(RoomInterior));
    scene_->prefetch_parts();
  }

  // Returns the nearest point of a solid, triangle or wall; the point itself inside a solid or outside a room. If none is nearer
  // than `most` (m), that is the distance, without an element.
  NearestPoint nearest(const Vec3& point, float most) const;
  float distance(const Vec3& point, float most) const { return nearest(point, most).distance; }

  // Calls visit(element), in any order, for each element except rooms whose bounding box is within radius (m) of center, and
  // possibly for some others.
  template <class Visit>
  void for_each_near(const Vec3& center, float radius, Visit&& visit) const {
    const auto call = [](void* context, std::uint32_t element) {
      (*static_cast<std::remove_reference_t<Visit>*>(context))(element);
      return std::numeric_limits<float>::infinity();  // the radius stays
    };
    scene_->for_each_near(center, radius, call, &visit);
  }

 private:
  const World* world_;
  const trace::Scene* scene_;
  std::pmr::vector<RoomInterior> rooms_;
  std::pmr::vector<Convex> convexes_;  // one per primitive; unused for rooms
};

}  // namespace flockstep::collision
