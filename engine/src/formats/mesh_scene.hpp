// Scenes that are a mesh file and nothing else.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

// An OBJ file with the materials and textures that it names, placed as the options say. Triangles without an area are dropped.
// What the file has and is not read is added to `ignored`, in words.
// Throws std::invalid_argument naming the file, the line, what was expected and what came.
SceneDescription load_obj_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

// Likewise a PLY file, all of one material.
SceneDescription load_ply_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

}  // namespace flockstep
