// Obstacles: a world as the collision stage wants it. Built once per world; immutable, so any number of threads may ask.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "collision/convex.hpp"
#include "trace/scene.hpp"

namespace swiftlet::collision {

// The inside of an axis-aligned box; all the rest is solid.
struct Room {
  std::uint32_t element = 0;
  Aabb inside;  // m
};

class Obstacles {
 public:
  explicit Obstacles(const World& world);  // keeps a reference to the world

  std::span<const Room> rooms() const { return rooms_; }

  // The element (index into World::primitives(), then primitives().size() + triangle index), which is not a room.
  Convex convex(std::uint32_t element) const;

  // Calls visit(element) for each element but the rooms whose bounding box comes within radius (m) of center, and perhaps for
  // some more, in any order. Few elements are looked at one after the other, many through the world's acceleration structure.
  template <class Visit>
  void for_each_near(const Vec3& center, float radius, Visit&& visit) const;

 private:
  static constexpr std::size_t kWidth = 8;
  struct Block {  // bounds of kWidth elements, m; empty places are infinitely far
    std::array<float, kWidth> min_x, min_y, min_z, max_x, max_y, max_z;
    std::array<std::uint32_t, kWidth> element;
  };
  static std::array<float, kWidth> squared_distances(const Block& block, const Vec3& point);
  void add_bounds(std::size_t place, std::uint32_t element, const Aabb& bounds);

  const World* world_;
  std::vector<Room> rooms_;
  std::vector<Convex> convexes_;  // one per primitive; unused where it is a room
  std::vector<Block> blocks_;     // empty if there are many elements
  bool many_ = false;
};

// The plain loops let the compiler compare several boxes at once.
inline std::array<float, Obstacles::kWidth> Obstacles::squared_distances(const Block& block, const Vec3& point) {
  const auto beyond = [](float low, float high, float x) {
    const float below = low - x;
    const float above = x - high;
    const float outside = below > above ? below : above;
    return outside > 0.0F ? outside : 0.0F;
  };
  std::array<float, kWidth> result;
  for (std::size_t i = 0; i < kWidth; ++i) {
    const float x = beyond(block.min_x[i], block.max_x[i], point.x());
    const float y = beyond(block.min_y[i], block.max_y[i], point.y());
    const float z = beyond(block.min_z[i], block.max_z[i], point.z());
    result[i] = x * x + y * y + z * z;
  }
  return result;
}

template <class Visit>
void Obstacles::for_each_near(const Vec3& center, float radius, Visit&& visit) const {
  if (many_) {
    // Element indices below primitives().size() may be rooms; they are not convex, and handled apart.
    struct Context {
      const Obstacles* self;
      Visit* visit;
    } context{this, &visit};
    world_->scene().for_each_nearby(
        center, radius,
        [](void* pointer, std::uint32_t element) {
          const auto& [self, visitor] = *static_cast<Context*>(pointer);
          const auto primitives = self->world_->primitives();
          if (element >= primitives.size() || primitives[element].kind != PrimitiveKind::room) {
            (*visitor)(element);
          }
        },
        &context);
    return;
  }
  const float radius2 = radius * radius;
  for (const Block& block : blocks_) {
    const std::array<float, kWidth> distance2 = squared_distances(block, center);
    for (std::size_t i = 0; i < kWidth; ++i) {
      if (distance2[i] <= radius2) {
        visit(block.element[i]);
      }
    }
  }
}

}  // namespace swiftlet::collision
