// trace::Scene: one world's acceleration structure (Embree), and the one question asked of it: what is the nearest thing along
// these rays.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "swiftlet/world.hpp"

namespace swiftlet::trace {

// Called for every primitive (index into World::primitives(), then primitives().size() + triangle index) whose bounds come within the query radius.
using NearbyCallback = void (*)(void* context, std::uint32_t element);

class Scene {
 public:
  explicit Scene(const World& world);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // The broad phase of collision: calls back for each element whose bounding box comes within radius of center; may call back
  // for some that do not. Allocates nothing; safe from many threads.
  void for_each_nearby(const Vec3& center, float radius, NearbyCallback callback, void* context) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace swiftlet::trace
