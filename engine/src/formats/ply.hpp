// PLY files, of text or binary.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

struct PlyMesh {
  TriangleMesh mesh;                 // vertices, triangles, and colours where the file has any
  std::vector<std::string> ignored;  // what the file has and is not read, in words
};

// Polygons are cut into triangles as those of OBJ files are. Colours of vertices are taken for sRGB: of whole numbers of 16 bits
// without a sign 65535 is the most, of others 255, of other numbers 1.
// Throws std::invalid_argument naming the source, the element, what was expected and what came: also where there are no faces.
PlyMesh parse_ply(std::string_view bytes, const std::string& source);
PlyMesh load_ply(const std::filesystem::path& path);

}  // namespace flockstep
