// Reads PLY files, text or binary.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

struct PlyMesh {
  TriangleMesh mesh;                 // vertices, triangles, and colours if the file has any
  std::vector<std::string> ignored;  // descriptions of ignored content
};

// Polygons are triangulated as in OBJ files. Vertex colours are sRGB. Their maximum is 65535 for unsigned 16-bit integers, 255
// for other integers, and 1 for floats.
// Throws std::invalid_argument that names the source, the element, the expected value and the actual one; also if there are no
// faces.
PlyMesh parse_ply(std::string_view bytes, const std::string& source);
PlyMesh load_ply(const std::filesystem::path& path);

}  // namespace flockstep
