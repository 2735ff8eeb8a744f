// Reads Wavefront MTL files: materials and textures of OBJ files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "flockstep/world.hpp"
#include "formats/obj.hpp"
#include "formats/unused_names.hpp"

namespace flockstep {

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

}  // namespace flockstep
