// Wavefront OBJ files: geometry only; their materials and colours are ignored (a scene names the material of a mesh).
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "flockstep/world.hpp"

namespace flockstep {

// Polygons are triangulated. `materials` of the result is empty. with_uv: vt become uv, and a vertex whose faces have different
// ones there becomes several; a corner without one, or with one that is no number within +-1e6, has (0, 0).
// Throws std::invalid_argument naming the file and the line; `source` is what messages call the text.
TriangleMesh parse_obj(std::string_view text, const std::string& source, bool with_uv = false);
TriangleMesh load_obj(const std::filesystem::path& path, bool with_uv = false);

}  // namespace flockstep
