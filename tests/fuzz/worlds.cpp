#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>

#include "flockstep/world.hpp"
#include "fuzz/targets.hpp"
#include "world/gltf.hpp"
#include "world/obj.hpp"
#include "world/scene_json.hpp"

namespace flockstep::fuzz {
namespace {

std::string text_of(Bytes input) { return {reinterpret_cast<const char*>(input.data()), input.size()}; }

}  // namespace

// What is read is written and read again, to the last bit.
void scene(Bytes input) {
  std::shared_ptr<const World> world;
  try {
    world = std::make_shared<const World>(parse_scene(text_of(input), "scene", "/nowhere"));
  } catch (const std::invalid_argument&) {
    return;
  }
  const auto again = World::from_json(world->to_json());
  if (again->to_json() != world->to_json() || again->content_hash() != world->content_hash()) std::abort();
}

void obj(Bytes input) {
  try {
    const TriangleMesh mesh = parse_obj(text_of(input), "mesh");
    for (const auto& triangle : mesh.triangles) {
      for (const std::int32_t index : triangle) {
        if (index < 0 || static_cast<std::size_t>(index) >= mesh.vertices.size()) std::abort();
      }
    }
  } catch (const std::invalid_argument&) {
    return;
  }
}

// What is read comes back equal from a scene file.
void gltf(Bytes input) {
  std::shared_ptr<const World> world;
  try {
    world = std::make_shared<const World>(parse_gltf(text_of(input), "gltf", "/nowhere").scene);
  } catch (const std::invalid_argument&) {
    return;
  }
  if (World::from_json(world->to_json())->content_hash() != world->content_hash()) std::abort();
}

}  // namespace flockstep::fuzz
