// Wavefront MTL files: the materials of OBJ files, and their textures.
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

// Adds the materials and textures that mesh files name to a scene. A file that is missing is not read; neither is one outside of
// a folder, unless all may be.
class ObjMaterials {
 public:
  // A name that the scene has by now means that material of the scene.
  ObjMaterials(SceneDescription& scene, std::filesystem::path folder, MeshFiles files);
  ~ObjMaterials();

  // The numbers of materials of an OBJ file: what its libraries say of each name, or grey. default_material is asked for that of
  // faces without a name. pixels_left of all textures are counted down.
  // Throws std::invalid_argument naming the file, the line, what was expected and what came.
  std::vector<std::uint16_t> numbers(const ObjNames& names, const std::filesystem::path& obj,
                                     const std::function<std::uint16_t()>& default_material, std::size_t& pixels_left);

  // A material under its name, or one with a number behind it where that is taken. source is what messages name.
  std::uint16_t add(Material material, const std::string& source);

  // From now on materials of files that are called so get a number behind their name.
  void take(const std::string& name) { material_names_.take(name); }

  // What has not been read, in words.
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
  std::map<std::string, std::uint16_t> own_;  // of the scene
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
