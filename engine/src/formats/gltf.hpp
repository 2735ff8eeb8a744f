// Reads and writes glTF 2.0 files: a scene's meshes, their materials and textures, markers and the sun.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/text_file.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct GltfFile {
  SceneDescription scene;
  bool has_name = false;             // the scene's name comes from the file
  std::vector<std::string> ignored;  // descriptions of ignored content
};

// Limit for the triangles of all nodes together, including dropped ones.
inline constexpr std::size_t kMaxGltfTriangles = std::size_t{1} << 25;

// Reads the default scene, or all root nodes if the file has no default scene. Each mesh of a node becomes an object. Points
// are placed as the options say in double precision and rounded once. Triangles without an area are dropped and counted.
// Throws std::invalid_argument that names the file, the place in it, the expected value and the actual one.
GltfFile load_gltf(const std::filesystem::path& path, const LoadOptions& options = {});

// Reads glTF from bytes. `folder` is the folder of the referenced files.
GltfFile parse_gltf(const std::string& bytes, const std::string& source, const std::filesystem::path& folder,
                    const LoadOptions& options = {});

// --- writing: everything that viewers show, and the rest in `extras`, so that a written world reads back equal

// JSON with all data embedded as base64 (.gltf), or with a binary chunk (.glb).
enum class GltfForm : std::uint8_t { text, binary };

// Expects a canonical() description. A primitive becomes a node that places and scales its tessellation, an object a node with
// a mesh, and a marker a named node. Worlds too large for parse_gltf() are rejected: throws std::invalid_argument that names
// the source, the expected value and the actual one.
std::string write_gltf(const SceneDescription& description, GltfForm form, const std::string& source,
                       std::size_t max_bytes = static_cast<std::size_t>(kMaxFileBytes));

}  // namespace flockstep
