// PreparedWorld: data structures that the stages derive from a world. The world does not depend on them.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "base/near_memory.hpp"
#include "flockstep/attachment.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

namespace trace {
class Scene;
}
namespace collision {
class Corners;
class Obstacles;
}  // namespace collision
namespace render {
class Shading;
}

// Each part is built on first use by one thread, while others wait for it. A batch requests its parts when it is created, so
// that nothing is built during a step. A world that differs from its original only in appearance shares all parts of the
// original that do not depend on appearance.
class PreparedWorld {
 public:
  explicit PreparedWorld(const World& world);  // must outlive this object
  ~PreparedWorld();
  PreparedWorld(const PreparedWorld&) = delete;
  PreparedWorld& operator=(const PreparedWorld&) = delete;

  const World& world() const { return world_; }
  const trace::Scene& scene() const;              // for rays: visible objects
  const collision::Obstacles& obstacles() const;  // for collisions: solid objects
  // The number of the object among World::objects(), for each element of obstacles().
  const std::vector<std::int32_t>& solid_objects() const;
  // The corners of each solid object, for a body that is this world's mesh.
  const std::vector<collision::Corners>& corners() const;
  // Cache for the layer of bodies; see bodies/body_model.hpp.
  const Attachment& bodies() const { return bodies_; }
  // For cameras; with shadows, for cameras that show shadows.
  const render::Shading& shading(bool shadows = false) const;

 private:
  template <class T, class Pointer = std::unique_ptr<const T>>
  struct Part {
    std::mutex mutex;
    Pointer value;
  };
  template <class T>
  using NearPart = Part<T, NearMemory::Pointer<T>>;
  template <class T, class Pointer, class Build>
  const T& once(Part<T, Pointer>& part, const Build& build) const;

  const World& world_;
  // Data that every step reads; it holds all of a small world. Only one thread at a time allocates here, because obstacles are
  // built after the scene.
  mutable NearMemory memory_;
  mutable NearPart<trace::Scene> scene_;  // the other parts refer to it
  mutable Part<World> solids_;            // used if not everything is both solid and visible
  mutable Part<trace::Scene> solid_scene_;
  mutable NearPart<collision::Obstacles> obstacles_;
  mutable Part<std::vector<std::int32_t>> solid_objects_;
  mutable Part<std::vector<collision::Corners>> corners_;
  mutable Part<render::Shading> shading_;
  Attachment bodies_;
};

// Returns the PreparedWorld of this world. It is created on first use and kept by the world, so that all batches share it.
// Thread-safe.
const PreparedWorld& prepared(const World& world);

}  // namespace flockstep
