// Wavefront OBJ files: geometry only; their materials and colours are ignored (a scene names the material of a mesh).
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "flockstep/world.hpp"

namespace flockstep {

// Polygons are triangulated. `materials` of the result is empty.
// Throws std::invalid_argument naming the file and the line; `source` is what messages call the text.
TriangleMesh parse_obj(std::string_view text, const std::string& source);
TriangleMesh load_obj(const std::filesystem::path& path);

}  // namespace flockstep
