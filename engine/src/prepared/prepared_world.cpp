#include "prepared/prepared_world.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "collision/convex.hpp"
#include "collision/obstacles.hpp"
#include "render/raycast/shading.hpp"
#include "trace/scene.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

PreparedWorld::PreparedWorld(const World& world) : world_(world) {}

PreparedWorld::~PreparedWorld() = default;

template <class T, class Pointer, class Build>
const T& PreparedWorld::once(Part<T, Pointer>& part, const Build& build) const {
  const std::lock_guard lock(part.mutex);  // not std::call_once; see Attachment
  if (!part.value) {
    part.value = build();
    if (world_.triangles().triangles.size() >= kManyTriangles) give_back_freed_memory();
  }
  return *part.value;
}

const trace::Scene& PreparedWorld::scene() const {
  if (world_.original() != nullptr) return prepared(*world_.original()).scene();
  return once(scene_, [this] { return make_near<trace::Scene>(memory_, world_); });
}

const collision::Obstacles& PreparedWorld::obstacles() const {
  if (world_.original() != nullptr) return prepared(*world_.original()).obstacles();
  const trace::Scene& visible = scene();  // always first; see memory_
  return once(obstacles_, [&] {
    const auto is_full = [](const auto& thing) { return thing.visibility == Visibility::full; };
    const bool is_same =
        std::all_of(world_.primitives().begin(), world_.primitives().end(), is_full) && world_.triangles().visibility.empty();
    if (is_same) return make_near<collision::Obstacles>(memory_, world_, visible);
    const World& solids = once(solids_, [this] { return std::make_unique<const World>(solids_of(world_)); });
    const trace::Scene& solid_scene = once(solid_scene_, [&] { return std::make_unique<const trace::Scene>(solids); });
    return make_near<collision::Obstacles>(memory_, solids, solid_scene);
  });
}

const std::vector<std::int32_t>& PreparedWorld::solid_objects() const {
  if (world_.original() != nullptr) return prepared(*world_.original()).solid_objects();
  return once(solid_objects_, [this] {
    auto objects = std::make_unique<std::vector<std::int32_t>>();
    const std::span<const Primitive> primitives = world_.primitives();
    for (std::size_t i = 0; i < primitives.size(); ++i) {
      if (is_solid(primitives[i].visibility)) objects->push_back(static_cast<std::int32_t>(i));
    }
    const TriangleMesh& mesh = world_.triangles();
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (is_solid(mesh.visibility_of(i))) objects->push_back(static_cast<std::int32_t>(primitives.size() + mesh.objects[i]));
    }
    return std::unique_ptr<const std::vector<std::int32_t>>(std::move(objects));
  });
}

const std::vector<collision::Corners>& PreparedWorld::corners() const {
  if (world_.original() != nullptr) return prepared(*world_.original()).corners();
  return once(corners_, [this] {
    return std::make_unique<const std::vector<collision::Corners>>(collision::corners_of_objects(world_.triangles()));
  });
}

const render::Shading& PreparedWorld::shading(bool shadows) const {
  const render::Shading& shading = once(shading_, [this] {
    const World* original = world_.original();
    return std::make_unique<const render::Shading>(world_, scene(), original ? &prepared(*original).shading() : nullptr);
  });
  if (shadows) shading.prepare_shadows();
  return shading;
}

const PreparedWorld& prepared(const World& world) {
  return world.attachment().get<PreparedWorld>([&world] { return std::make_shared<const PreparedWorld>(world); });
}

}  // namespace flockstep
