// PreparedWorld: what the stages make of one world. The world itself knows nothing of them.
#pragma once

#include <memory>
#include <mutex>

#include "base/near_memory.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

namespace trace {
class Scene;
}
namespace collision {
class Obstacles;
}
namespace render {
class Shading;
}

// Each part is built on first need, by whichever thread comes first while the others wait. A batch asks for what it needs when
// it is made, so that nothing is built in the middle of a step. A world that only looks other than its original has the parts
// of that one but for what depends on the look.
class PreparedWorld {
 public:
  explicit PreparedWorld(const World& world);  // which outlives it
  ~PreparedWorld();
  PreparedWorld(const PreparedWorld&) = delete;
  PreparedWorld& operator=(const PreparedWorld&) = delete;

  const World& world() const { return world_; }
  const trace::Scene& scene() const;              // as rays meet it: what is visual
  const collision::Obstacles& obstacles() const;  // as a moving drone meets it: what is solid
  // As cameras see it, or as those see it that show shadows.
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
  // What every step reads; of a small world, all of it. One thread at a time is here: obstacles wait for the scene.
  mutable NearMemory memory_;
  mutable NearPart<trace::Scene> scene_;  // the others point to it
  mutable Part<World> solids_;            // where not all is solid, and as rays meet it
  mutable Part<trace::Scene> solid_scene_;
  mutable NearPart<collision::Obstacles> obstacles_;
  mutable Part<render::Shading> shading_;
};

// The one of this world: made on first need and kept by the world, so that all batches share it. Thread-safe.
const PreparedWorld& prepared(const World& world);

}  // namespace flockstep
