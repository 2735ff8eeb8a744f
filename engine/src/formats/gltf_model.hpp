// glTF 2.0 files as tinygltf reads them, after all that it would take on trust has been checked.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/world.hpp"
#include "formats/gltf_extras.hpp"
#include "formats/tinygltf.hpp"

namespace flockstep {

// Fields of `extras` in GltfModel::model, which are put there where a file means the same.
inline constexpr const char* kGltfSemantic = "semantic";  // of materials and nodes, as in a scene file
inline constexpr const char* kGltfMarker = "marker";      // of nodes: a name that is_gltf_marker()
inline constexpr const char* kGltfUnlit = "unlit";        // of materials: true where one is
inline constexpr const char* kGltfSun = "sun";            // of nodes: true where one has a directional light

// "start", "goal", "waypoint" or "waypoint." and a number.
bool is_gltf_marker(std::string_view name);

// The files that a glTF file names: embedded, or beside it.
class GltfFiles {
 public:
  GltfFiles(std::string source, std::filesystem::path folder, MeshFiles files)
      : source_(std::move(source)), folder_(std::move(folder)), files_(files) {}

  // What a uri is of, a base64 data: or a relative path. `field` names it in messages, `kind` says what the file was taken for.
  std::string read(const std::string& uri, const std::string& field, const std::string& kind);

 private:
  std::string source_;
  std::filesystem::path folder_;
  MeshFiles files_;
  std::size_t read_bytes_ = 0;
};

struct GltfImage {
  std::string name;
  std::optional<std::size_t> buffer_view;  // or else
  std::string uri;
};

// Every index in the model is in range, and what an accessor with a buffer view spans lies in it. Of what is not read here
// (skins, animations, morph targets, cameras, all extensions but a few) nothing is left.
struct GltfModel {
  tinygltf::Model model;
  std::vector<GltfImage> images;
  std::vector<GltfNodeExtras> node_extras;                   // of each node
  std::vector<std::optional<GltfSceneExtras>> scene_extras;  // of each scene
  std::vector<std::string> ignored;                          // what the file has of these
};

// `bytes` is a .gltf or .glb file, which its first bytes tell.
// Throws std::invalid_argument naming the source, the JSON pointer of the offending field, what was expected and what came.
GltfModel read_gltf_model(const std::string& bytes, const std::string& source, GltfFiles& files);

}  // namespace flockstep
