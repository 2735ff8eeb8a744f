#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "flockstep/world.hpp"
#include "formats/gltf.hpp"
#include "formats/mesh_files.hpp"
#include "formats/scene_json.hpp"
#include "fuzz/targets.hpp"
#include "world/scene_description.hpp"

namespace flockstep::fuzz {
namespace {

std::string text_of(Bytes input) { return {reinterpret_cast<const char*>(input.data()), input.size()}; }

// Checks that writing and reading a scene preserves every bit.
void require_same_again(const SceneDescription& scene) {
  const World world(scene);
  const auto from_json = World::from_json(world.to_json());
  if (from_json->to_json() != world.to_json() || from_json->content_hash() != world.content_hash()) std::abort();
  GltfFile file = parse_gltf(write_gltf(scene, GltfForm::binary, "gltf"), "gltf", "/nowhere");
  if (!file.ignored.empty() || World(std::move(file.scene)).content_hash() != world.content_hash()) std::abort();
}

// A temporary folder of this process.
class TemporaryFolder {
 public:
  TemporaryFolder() : path_(std::filesystem::temp_directory_path() / ("flockstep-fuzz-" + std::to_string(process_id()))) {
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

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

// The input is an OBJ file, optionally followed by a line "#mtl" and its material file.
void obj(Bytes input) {
  const std::string text = text_of(input);
  constexpr std::string_view kBreak = "\n#mtl\n";
  const std::size_t at = text.find(kBreak);
  static const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "m.obj";
  std::ofstream(path, std::ios::binary) << text.substr(0, at);
  std::ofstream(folder.path() / "m.mtl", std::ios::binary) << (at == text.npos ? "" : text.substr(at + kBreak.size()));
  SceneDescription read;
  try {
    std::vector<std::string> ignored;
    read = canonical(load_obj_scene(path, {}, ignored));
  } catch (const std::invalid_argument&) {
    return;
  }
  require_same_again(read);
}

void ply(Bytes input) {
  SceneDescription read;
  try {
    read.mesh = parse_ply(text_of(input), "ply").mesh;
    read = canonical(std::move(read));
  } catch (const std::invalid_argument&) {
    return;
  }
  require_same_again(read);
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
