// Loads scenes from single mesh files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

// Loads an OBJ file with its materials and textures, placed as the options say. Triangles without an area are dropped.
// Descriptions of ignored content are added to `ignored`.
// Throws std::invalid_argument that names the file, the line, the expected value and the actual one.
SceneDescription load_obj_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

// Loads a PLY file in the same way, with a single material.
SceneDescription load_ply_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

}  // namespace flockstep
