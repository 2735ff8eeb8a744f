// Maps file extensions to world file formats.
#include <array>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/world.hpp"
#include "formats/gltf.hpp"
#include "formats/mesh_files.hpp"
#include "formats/packed_world.hpp"
#include "formats/placement.hpp"
#include "formats/scene_json.hpp"

namespace flockstep {
namespace {

using Path = std::filesystem::path;
using Ignored = std::vector<std::string>;  // descriptions of ignored content

constexpr const char* kSceneFile = "a scene file";
constexpr const char* kGltfFile = "a glTF file";

SceneDescription load_scene_file(const Path& path, const LoadOptions& options, Ignored& ignored) {
  SceneDescription scene =
      parse_scene(read_text_file(path, kSceneFile), path.string(), path.parent_path(), options.files, &ignored);
  return moves(options) ? placed(std::move(scene), options) : scene;
}

SceneDescription load_gltf_file(const Path& path, const LoadOptions& options, Ignored& ignored) {
  GltfFile file = load_gltf(path, options);
  ignored = std::move(file.ignored);
  return std::move(file.scene);
}

std::string scene_file(const SceneDescription& scene, const Path&) { return write_scene(scene); }
std::string gltf_text(const SceneDescription& scene, const Path& path) {
  return write_gltf(scene, GltfForm::text, path.string());
}
std::string gltf_binary(const SceneDescription& scene, const Path& path) {
  return write_gltf(scene, GltfForm::binary, path.string());
}

// To add a format, write a file that reads it and add a line here.
struct Format {
  std::string_view suffix;
  SceneDescription (*load)(const Path& path, const LoadOptions& options, Ignored& ignored);
  const char* kind = nullptr;                                                       // name of written files in messages
  std::string (*write)(const SceneDescription& scene, const Path& path) = nullptr;  // null: read-only format
};
constexpr std::array kFormats{
    Format{".json", &load_scene_file, kSceneFile, &scene_file},
    Format{".gltf", &load_gltf_file, kGltfFile, &gltf_text},
    Format{".glb", &load_gltf_file, kGltfFile, &gltf_binary},
    Format{".obj", &load_obj_scene},
    Format{".ply", &load_ply_scene},
};

bool can_load(const Format&) { return true; }
bool can_save(const Format& format) { return format.write != nullptr; }

// Returns the format of a path. Throws std::invalid_argument if no format has its suffix.
const Format& format_of(const Path& path, bool (*can)(const Format&)) {
  const std::string suffix = extension_of(path);
  std::vector<std::string_view> suffixes;
  for (const Format& format : kFormats) {
    if (!can(format)) continue;
    if (format.suffix == suffix) return format;
    suffixes.push_back(format.suffix);
  }
  std::string expected = "a file ending in ";
  for (std::size_t i = 0; i < suffixes.size(); ++i) {
    expected += std::string(i == 0 ? "" : i + 1 == suffixes.size() ? " or " : ", ") + std::string(suffixes[i]);
  }
  refuse(path.string(), expected, '"' + suffix + '"');
}

}  // namespace

std::shared_ptr<const World> World::load(const Path& path, const LoadOptions& options) {
  check_placement(options);
  Ignored ignored;
  SceneDescription scene = format_of(path, &can_load).load(path, options, ignored);
  try {
    return std::make_shared<const World>(std::move(scene), std::move(ignored));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path.string() + ": " + error.what());
  }
}

std::shared_ptr<const World> World::from_json(const std::string& text, const Path& base_dir, MeshFiles files) {
  Ignored ignored;
  SceneDescription scene = parse_scene(text, "scene", base_dir, files, &ignored);
  return std::make_shared<const World>(std::move(scene), std::move(ignored));
}

std::string World::to_json() const {
  SceneDescription copy;
  return write_scene(description(copy));
}

std::string World::to_bytes() const {
  SceneDescription copy;
  return pack_world(description(copy));
}

std::shared_ptr<const World> World::from_bytes(std::string_view bytes) {
  return std::make_shared<const World>(unpack_world(bytes));
}

std::string World::to_glb() const {
  SceneDescription copy;
  return write_gltf(description(copy), GltfForm::binary, name());
}

std::shared_ptr<const World> World::from_glb(const std::string& bytes, const std::string& source) {
  GltfFile file = parse_gltf(bytes, source, {}, {.files = MeshFiles::none});
  try {
    return std::make_shared<const World>(std::move(file.scene), std::move(file.ignored));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(source + ": " + error.what());
  }
}

void World::save(const Path& path) const {
  const Format& format = format_of(path, &can_save);
  SceneDescription copy;
  write_text_file(path, format.kind, format.write(description(copy), path));
}

std::vector<std::string_view> World::suffixes() {
  std::vector<std::string_view> suffixes;
  for (const Format& format : kFormats) suffixes.push_back(format.suffix);
  return suffixes;
}

}  // namespace flockstep
