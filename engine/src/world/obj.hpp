// Wavefront OBJ files: geometry only; their materials and colours are ignored (a scene names the material of a mesh).
#pragma once

#include <filesystem>

#include "flockstep/world.hpp"

namespace flockstep {

// Polygons are triangulated. `materials` of the result is empty.
// Throws std::invalid_argument naming the file and the line.
TriangleMesh load_obj(const std::filesystem::path& path);

}  // namespace flockstep
