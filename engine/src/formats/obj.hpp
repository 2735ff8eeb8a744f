// Wavefront OBJ files.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

// What a file says of the materials of its faces.
struct ObjNames {
  std::vector<std::string> materials;  // by the first face of each; "" for faces before any usemtl
  std::vector<std::string> libraries;  // what its mtllib lines say
};

struct ObjMesh {
  TriangleMesh mesh;  // materials: indices into names.materials
  ObjNames names;
  std::vector<std::string> ignored;  // what the file has and is not read, in words
};

// Polygons are triangulated. Each `o` is an object, or each `g` in a file without `o`; where a name comes again, its object goes
// on, and names of what is there for collision alone (solid_names.hpp) say so. Colours behind a vertex's coordinates are taken
// for sRGB. wants_uv is asked once, when all names are known: if so, vt become uv, and a vertex whose faces have different ones
// there becomes several; a corner without one, or with one that is no number within +-1e6, has (0, 0). Throws
// std::invalid_argument naming the file and the line; `source` is what messages call the text.
using WantsUv = std::function<bool(const ObjNames&)>;
inline bool without_uv(const ObjNames&) { return false; }
ObjMesh parse_obj(std::string_view text, const std::string& source, const WantsUv& wants_uv = without_uv);
ObjMesh load_obj(const std::filesystem::path& path, const WantsUv& wants_uv = without_uv);

}  // namespace flockstep
