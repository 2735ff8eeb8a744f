#include <cstdlib>
#include <stdexcept>
#include <string>
#include <utility>

#include "flockstep/world.hpp"
#include "fuzz/targets.hpp"
#include "world/gltf.hpp"
#include "world/gltf_writer.hpp"
#include "world/obj.hpp"
#include "world/scene_description.hpp"
#include "world/scene_json.hpp"

namespace flockstep::fuzz {
namespace {

std::string text_of(Bytes input) { return {reinterpret_cast<const char*>(input.data()), input.size()}; }

// Written and read again, to the last bit.
void require_same_again(const SceneDescription& scene) {
  const World world(scene);
  const auto from_json = World::from_json(world.to_json());
  if (from_json->to_json() != world.to_json() || from_json->content_hash() != world.content_hash()) std::abort();
  GltfFile file = parse_gltf(write_gltf(scene, GltfForm::binary, "gltf"), "gltf", "/nowhere");
  if (!file.ignored.empty() || World(std::move(file.scene)).content_hash() != world.content_hash()) std::abort();
}

}  // namespace

void scene(Bytes input) {
  SceneDescription read;
  try {
    read = canonical(parse_scene(text_of(input), "scene", "/nowhere"));
  } catch (const std::invalid_argument&) {
    return;
  }
  require_same_again(read);
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

void gltf(Bytes input) {
  SceneDescription read;
  try {
    read = canonical(parse_gltf(text_of(input), "gltf", "/nowhere").scene);
  } catch (const std::invalid_argument&) {
    return;
  }
  require_same_again(read);
}

}  // namespace flockstep::fuzz
