// Reads mesh files: OBJ with MTL, and PLY.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "formats/names.hpp"

namespace flockstep {

// --- Wavefront OBJ files

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
// object. Names with collision-only prefixes (names.hpp) make collision-only objects. Colours after vertex coordinates
// are sRGB. wants_uv is called once after all names are known. If it returns true, vt become uv, and a vertex that has
// different vt in different faces is duplicated; a corner without vt, or with one that is not within +-1e6, gets (0, 0).
// `source` names the text in messages. Throws std::invalid_argument that names the file and the line.
using WantsUv = std::function<bool(const ObjNames&)>;
inline bool without_uv(const ObjNames&) { return false; }
ObjMesh parse_obj(std::string_view text, const std::string& source, const WantsUv& wants_uv = without_uv);
ObjMesh load_obj(const std::filesystem::path& path, const WantsUv& wants_uv = without_uv);

// --- Wavefront MTL files: materials and textures of OBJ files

// Adds the materials and textures of mesh files to a scene. Missing files are skipped, and so are files outside the folder
// unless `files` allows them.
class ObjMaterials {
 public:
  // Names of materials that the scene already has refer to those materials.
  ObjMaterials(SceneDescription& scene, std::filesystem::path folder, MeshFiles files);
  ~ObjMaterials();

  // Returns the material numbers of an OBJ file's names: materials from its libraries, or grey. default_material() returns the
  // number for faces without a name. The pixels of new textures are subtracted from pixels_left.
  // Throws std::invalid_argument that names the file, the line, the expected value and the actual one.
  std::vector<std::uint16_t> numbers(const ObjNames& names, const std::filesystem::path& obj,
                                     const std::function<std::uint16_t()>& default_material, std::size_t& pixels_left);

  // Adds a material. If its name is taken, a number is appended to it. `source` is for messages.
  std::uint16_t add(Material material, const std::string& source);

  // Reserves a name. Later materials of files with this name get a number appended.
  void take(const std::string& name) { material_names_.take(name); }

  // Describes the ignored content.
  std::vector<std::string> ignored() const;

 private:
  struct Definition;
  struct Library;
  using Place = std::pair<const Library*, std::size_t>;

  std::optional<std::filesystem::path> find(std::string name, const std::filesystem::path& folder);
  std::vector<const Library*> libraries_of(const ObjNames& names, const std::filesystem::path& folder);
  const Library* library(const std::filesystem::path& path);
  std::string read(const std::filesystem::path& path, const std::string& kind);
  std::uint16_t add(const Definition& definition, const std::filesystem::path& library, std::size_t& pixels_left);
  std::optional<std::uint16_t> texture(const std::string& name, bool is_clamped, const std::filesystem::path& library,
                                       std::size_t& pixels_left);

  SceneDescription& scene_;
  std::filesystem::path folder_;
  MeshFiles files_;
  std::map<std::string, std::uint16_t> own_;  // materials of the scene
  UnusedNames material_names_, texture_names_;
  std::map<std::filesystem::path, std::unique_ptr<const Library>> libraries_;
  std::map<Place, std::uint16_t> defined_;
  std::map<std::string, std::uint16_t> undefined_;
  std::map<std::pair<std::filesystem::path, bool>, std::uint16_t> textures_;
  std::set<std::string> missing_, outside_;
  std::size_t num_definitions_ = 0, read_bytes_ = 0;
  std::size_t transparent_ = 0, bumps_ = 0, glowing_ = 0, moved_ = 0, spectral_ = 0;
};

// --- PLY files, text or binary

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

// --- polygons, of both

inline constexpr std::size_t kMaxCorners = 1000;  // limit per face, because triangulation takes quadratic time

// Indices of a triangle's corners in its polygon.
using CornerTriple = std::array<std::size_t, 3>;

// Cuts a polygon of 3 to kMaxCorners corners into triangles with the polygon's orientation, two fewer than it has corners.
// Quads are cut at the shorter interior diagonal, larger polygons by ear clipping. Polygons may be concave.
std::vector<CornerTriple> cut_polygon(std::span<const Vec3> corners);

// --- whole scenes

// Loads an OBJ file with its materials and textures, placed as the options say. Triangles without an area are dropped.
// Descriptions of ignored content are added to `ignored`.
// Throws std::invalid_argument that names the file, the line, the expected value and the actual one.
SceneDescription load_obj_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

// Loads a PLY file in the same way, with a single material.
SceneDescription load_ply_scene(const std::filesystem::path& path, const LoadOptions& options, std::vector<std::string>& ignored);

}  // namespace flockstep
