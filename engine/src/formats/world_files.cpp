#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/world.hpp"
#include "formats/gltf.hpp"
#include "formats/gltf_writer.hpp"
#include "formats/mesh_scene.hpp"
#include "formats/placement.hpp"
#include "formats/scene_json.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

constexpr const char* kSceneFile = "a scene file";
constexpr const char* kGltfFile = "a glTF file";

// Refusals name the file.
std::shared_ptr<const World> made_from(SceneDescription description, const std::filesystem::path& path,
                                       std::vector<std::string> ignored = {}) {
  try {
    return std::make_shared<const World>(std::move(description), std::move(ignored));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path.string() + ": " + error.what());
  }
}

}  // namespace

std::shared_ptr<const World> World::load(const std::filesystem::path& path, const LoadOptions& options) {
  check_placement(options);
  const std::string extension = extension_of(path);
  if (extension == ".json") {
    std::vector<std::string> ignored;
    SceneDescription scene =
        parse_scene(read_text_file(path, kSceneFile), path.string(), path.parent_path(), options.files, &ignored);
    if (moves(options)) return made_from(placed(std::move(scene), options), path, std::move(ignored));
    return std::make_shared<const World>(std::move(scene), std::move(ignored));
  }
  if (extension == ".gltf" || extension == ".glb") {
    GltfFile file = load_gltf(path, options);
    return made_from(std::move(file.scene), path, std::move(file.ignored));
  }
  if (extension == ".obj" || extension == ".ply") {
    std::vector<std::string> ignored;
    SceneDescription scene =
        extension == ".obj" ? load_obj_scene(path, options, ignored) : load_ply_scene(path, options, ignored);
    return made_from(std::move(scene), path, std::move(ignored));
  }
  refuse(path.string(), "a file ending in .json, .gltf, .glb, .obj or .ply", '"' + extension + '"');
}

std::shared_ptr<const World> World::from_json(const std::string& text, const std::filesystem::path& base_dir, MeshFiles files) {
  std::vector<std::string> ignored;
  SceneDescription scene = parse_scene(text, "scene", base_dir, files, &ignored);
  return std::make_shared<const World>(std::move(scene), std::move(ignored));
}

std::string World::to_json() const {
  SceneDescription copy;
  return write_scene(description(copy));
}

void World::save(const std::filesystem::path& path) const {
  const std::string extension = extension_of(path);
  if (extension == ".json") return write_text_file(path, kSceneFile, to_json());
  if (extension == ".glb" || extension == ".gltf") {
    const GltfForm form = extension == ".glb" ? GltfForm::binary : GltfForm::text;
    SceneDescription copy;
    return write_text_file(path, kGltfFile, write_gltf(description(copy), form, path.string()));
  }
  refuse(path.string(), "a file ending in .json, .glb or .gltf", '"' + extension + '"');
}

}  // namespace flockstep
