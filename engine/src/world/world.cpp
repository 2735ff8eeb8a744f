#include "flockstep/world.hpp"

#include <mutex>
#include <span>
#include <string>
#include <utility>

#include "base/platform.hpp"
#include "world/scene_description.hpp"
#include "world/tessellate.hpp"

namespace flockstep {
namespace {

Aabb bounds_of(std::span<const Primitive> primitives, std::span<const Vec3> vertices) {
  Eigen::AlignedBox3f box;
  for (const Primitive& primitive : primitives) {
    const Aabb part = bounds(primitive);
    box.extend(part.min).extend(part.max);
  }
  for (const Vec3& vertex : vertices) box.extend(vertex);
  return Aabb{box.min(), box.max()};
}

}  // namespace

World::World(SceneDescription description, std::vector<std::string> ignored)
    : description_(canonical(std::move(description))),
      framed_(with_frames(description_)),
      ignored_(std::move(ignored)),
      bounds_(bounds_of(own_primitives(), description_.mesh.vertices)) {
  if (description_.mesh.triangles.size() >= kManyTriangles) give_back_freed_memory();  // the readers have freed much
}

World::World(std::shared_ptr<const World> world, const Lighting& lighting)
    : original_(world->original_ ? world->original_ : world), ignored_(world->ignored_), bounds_(world->bounds_) {
  description_.name = world->name();
  description_.materials = world->description_.materials;
  description_.markers = world->markers();
  description_.light = lighting.light;
  check_light(description_.light);
  apply_tint(lighting.tint, description_.materials);
}

const SceneDescription& World::description(SceneDescription& copy) const {
  if (!original_) return description_;
  copy = description_;
  copy.textures = shape().textures;
  copy.primitives = shape().primitives;
  copy.mesh = shape().mesh;
  copy.gates = shape().gates;
  copy.bodies = shape().bodies;
  return copy;
}

std::uint16_t World::semantic(std::size_t material) const {
  const std::uint16_t given = materials()[material].semantic;
  return given != 0 ? given : static_cast<std::uint16_t>(material + 1);
}

TriangleMesh World::mesh(float chord_error_m, std::vector<std::int32_t>* all_objects) const {
  SceneDescription copy;
  if (gates().empty()) return tessellate(description(copy), chord_error_m, all_objects);
  copy = description(copy);
  copy.primitives.assign(primitives().begin(), primitives().end());
  return tessellate(copy, chord_error_m, all_objects);
}

std::shared_ptr<const World> World::with_markers(Markers markers) const {
  check_markers(markers);  // before the copy, which may be large
  SceneDescription copy = description_;
  if (original_) description(copy);
  copy.markers = std::move(markers);
  return std::make_shared<const World>(std::move(copy), ignored_);
}

std::shared_ptr<const World> World::with_bodies(std::vector<BodyConfig> bodies) const {
  check_bodies(bodies);  // before the copy, which may be large
  SceneDescription copy = description_;
  if (original_) description(copy);
  copy.bodies = std::move(bodies);
  return std::make_shared<const World>(std::move(copy), ignored_);
}

std::uint64_t World::content_hash() const {
  std::call_once(hashed_, [this] {
    SceneDescription copy;
    content_hash_ = flockstep::content_hash(description(copy));
  });
  return content_hash_;
}

}  // namespace flockstep
