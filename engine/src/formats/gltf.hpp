// glTF 2.0 files: a scene's meshes, their materials and textures, markers and the sun.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

struct GltfFile {
  SceneDescription scene;
  bool has_name = false;             // the scene's name is the file's own
  std::vector<std::string> ignored;  // what the file has and is not read, in words
};

// Of triangles that all nodes together show, those that are dropped included.
inline constexpr std::size_t kMaxGltfTriangles = std::size_t{1} << 25;

// Reads the default scene, or all root nodes where a file names none. Each mesh of a node becomes an object. Points are placed as
// the options say, in double precision, and then rounded once. Triangles without an area are dropped and counted.
// Throws std::invalid_argument naming the file, the place in it, what was expected and what came.
GltfFile load_gltf(const std::filesystem::path& path, const LoadOptions& options = {});

// The same from a file's bytes; folder is where the files that it names are.
GltfFile parse_gltf(const std::string& bytes, const std::string& source, const std::filesystem::path& folder,
                    const LoadOptions& options = {});

}  // namespace flockstep
