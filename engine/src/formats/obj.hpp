// Reads Wavefront OBJ files.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

// The names that a file gives for the materials of its faces.
struct ObjNames {
  std::vector<std::string> materials;  // in the order of first use; "" for faces before any usemtl
  std::vector<std::string> libraries;  // contents of the mtllib lines
};

struct ObjMesh {
  TriangleMesh mesh;  // materials: indices into names.materials
  ObjNames names;
  std::vector<std::string> ignored;  // descriptions of ignored content
};

// Polygons are triangulated. Each `o` starts an object, or each `g` in a file without `o`. A repeated name continues its
// object. Names with collision-only prefixes (solid_names.hpp) make collision-only objects. Colours after vertex coordinates
// are sRGB. wants_uv is called once after all names are known. If it returns true, vt become uv, and a vertex that has
// different vt in different faces is duplicated; a corner without vt, or with one that is not within +-1e6, gets (0, 0).
// `source` names the text in messages. Throws std::invalid_argument that names the file and the line.
using WantsUv = std::function<bool(const ObjNames&)>;
inline bool without_uv(const ObjNames&) { return false; }
ObjMesh parse_obj(std::string_view text, const std::string& source, const WantsUv& wants_uv = without_uv);
ObjMesh load_obj(const std::filesystem::path& path, const WantsUv& wants_uv = without_uv);

}  // namespace flockstep
