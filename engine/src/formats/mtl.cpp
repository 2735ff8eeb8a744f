#include "formats/mtl.hpp"

#include <tiny_obj_loader.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "formats/image.hpp"
#include "formats/text_lines.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {
namespace {

// What is read of a material file, by its keyword.
enum class MtlLine : std::uint8_t { none, begin, color, number, texture };

MtlLine mtl_line_of(std::string_view keyword) {
  if (keyword == "newmtl") return MtlLine::begin;
  if (keyword == "Kd" || keyword == "Ke") return MtlLine::color;
  if (keyword == "d" || keyword == "Tr") return MtlLine::number;
  for (const char* const known : {"map_Kd", "map_Ke", "map_d", "map_bump", "map_Bump", "bump", "norm", "disp", "map_disp"}) {
    if (keyword == known) return MtlLine::texture;
  }
  return MtlLine::none;
}

// A name that scene files can hold, too, which are UTF-8.
std::string shown_name(std::string_view name) { return excerpt(name, 200); }

// "2 files that are missing (a.mtl, b.png)".
std::string list_of(const std::set<std::string>& names, const char* singular, const char* plural) {
  constexpr std::size_t kShown = 3;
  std::string text = counted(names.size(), singular, plural);
  std::size_t count = 0;
  for (const std::string& name : names) {
    text += (count == 0 ? " (" : ", ") + (count < kShown ? excerpt(name) : "...");
    if (++count > kShown) break;
  }
  return text + ')';
}

}  // namespace

// ----------------------------------------------------------------------------------------------------------- material files

struct ObjMaterials::Definition {
  std::string name;
  std::optional<std::array<float, 3>> color;
  std::array<float, 3> emission{};
  std::string texture;  // the name of a file
  bool is_clamped = false;
  bool is_transparent = false, has_bumps = false, glows_otherwise = false, is_moved = false, is_spectral = false;
};

struct ObjMaterials::Library {
  std::filesystem::path path;
  std::vector<Definition> definitions;
  std::map<std::string, std::size_t, std::less<>> by_name;  // the first of each
};

namespace {

// tinyobjloader reads a malformed number as 0. So it is given a text that has been checked and has nothing but what is read.
class MtlChecker {
 public:
  MtlChecker(const std::string& source, std::size_t most) : source_(source), most_(most) {}

  struct Known {
    std::string name;
    bool has_color = false, is_spectral = false;
  };

  std::string check(std::string_view text, std::vector<Known>& materials) {
    std::string kept;
    for (std::size_t number = 1; !text.empty(); ++number) {
      if (number % 1024 == 0) Interrupt::poll();
      line_ = next_line(text);
      number_ = number;
      std::string_view rest = line_;
      const std::string_view keyword = next_word(rest);
      const MtlLine kind = mtl_line_of(keyword);
      if (kind == MtlLine::begin) {
        require(materials.size() < most_, place(), "at most " + std::to_string(kMaxMaterials) + " materials in all", "more");
        materials.push_back({std::string(trimmed(rest))});
        kept += "newmtl " + std::to_string(materials.size()) + '\n';
      }
      if (kind == MtlLine::none || kind == MtlLine::begin || materials.empty()) continue;
      kept += keyword;
      if (kind == MtlLine::color) {
        keep_color(keyword, rest, kept, materials.back());
      } else if (kind == MtlLine::number) {
        keep_number(rest, kept);
      } else {
        kept += rest;
      }
      kept += '\n';
    }
    return kept;
  }

 private:
  std::string place() const { return source_ + ':' + std::to_string(number_); }

  // One number stands for three.
  void keep_color(std::string_view keyword, std::string_view rest, std::string& kept, Known& material) const {
    const bool is_emission = keyword == "Ke";
    const std::string_view first = next_word(rest);
    if (first == "spectral" || first == "xyz") {
      material.is_spectral = true;
      kept += " 0 0 0";
      return;
    }
    material.has_color |= !is_emission;
    std::string_view words = rest.empty() ? first : rest;
    for (int channel = 0; channel < 3; ++channel) {
      const std::string_view word = channel == 0 || rest.empty() ? first : next_word(words);
      double value = 0.0;
      const SceneKey& key = is_emission ? keys::kEmissive : keys::kBaseColor;
      if (!(parse_number(word, value) && key.limits.contain(value))) {
        refuse(place(), "three " + text_of_values(key) + " after " + std::string(keyword), '"' + excerpt(line_) + '"');
      }
      kept += ' ';
      kept += word;
    }
  }

  void keep_number(std::string_view rest, std::string& kept) const {
    std::string_view word = next_word(rest);
    if (word == "-halo") word = next_word(rest);
    double value = 0.0;
    if (!parse_number(word, value) || !std::isfinite(value)) {
      refuse(place(), "a number after d or Tr", '"' + excerpt(line_) + '"');
    }
    kept += ' ';
    kept += word;
  }

  const std::string& source_;
  std::size_t most_;
  std::string_view line_;
  std::size_t number_ = 0;
};

bool is_where_it_is(const tinyobj::texture_option_t& options) {
  const auto are = [](const tinyobj::real_t* values, double value) {
    return std::all_of(values, values + 2, [value](double v) { return v == value; });
  };
  return are(options.origin_offset, 0.0) && are(options.scale, 1.0);
}

}  // namespace

const ObjMaterials::Library* ObjMaterials::library(const std::filesystem::path& path) {
  std::unique_ptr<const Library>& known = libraries_[path];
  if (known) return known.get();
  const std::string source = path.string();
  std::vector<MtlChecker::Known> materials;
  std::istringstream text(MtlChecker(source, kMaxMaterials - num_definitions_).check(read(path, "a material file"), materials));
  std::vector<tinyobj::material_t> read;
  std::map<std::string, int> numbers;
  std::string warning, error;
  tinyobj::LoadMtl(&numbers, &read, &text, &warning, &error);

  auto library = std::make_unique<Library>();
  library->path = path;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const tinyobj::material_t& given = read[i];
    Definition& ours = library->definitions.emplace_back();
    ours.name = materials[i].name;
    const auto color = [](const tinyobj::real_t* rgb) {
      return std::array{static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])};
    };
    if (materials[i].has_color) ours.color = color(given.diffuse);
    ours.texture = given.diffuse_texname;
    ours.is_clamped = given.diffuse_texopt.clamp;
    ours.is_moved = !ours.texture.empty() && !is_where_it_is(given.diffuse_texopt);
    // What emits is multiplied by the texture of the colour, or by none where there is none.
    const bool is_same = given.emissive_texname == given.diffuse_texname;
    const bool emits = color(given.emission) != std::array<float, 3>{} || !given.emissive_texname.empty();
    if (is_same) ours.emission = color(given.emission);
    ours.glows_otherwise = emits && !is_same;
    ours.is_transparent = given.dissolve != 1.0 || !given.alpha_texname.empty();
    ours.has_bumps = !given.bump_texname.empty() || !given.normal_texname.empty() || !given.displacement_texname.empty();
    ours.is_spectral = materials[i].is_spectral;
    library->by_name.try_emplace(ours.name, i);
  }
  num_definitions_ += materials.size();
  known = std::move(library);
  return known.get();
}

// ---------------------------------------------------------------------------------------------------------------------- files

ObjMaterials::ObjMaterials(SceneDescription& scene, std::filesystem::path folder, MeshFiles files)
    : scene_(scene), folder_(std::move(folder)), files_(files) {
  for (std::size_t i = 0; i < scene.materials.size(); ++i) {
    own_.emplace(material_names_.take(scene.materials[i].name), static_cast<std::uint16_t>(i));
  }
  for (const Texture& texture : scene.textures) texture_names_.take(texture.name);
}

ObjMaterials::~ObjMaterials() = default;

// A file that may be read, and is there.
std::optional<std::filesystem::path> ObjMaterials::find(std::string name, const std::filesystem::path& folder) {
  std::replace(name.begin(), name.end(), '\\', '/');
  if (name.find('\0') != name.npos) name.clear();
  const std::filesystem::path path = folder / name;
  if (files_ == MeshFiles::in_folder && !is_below(path, folder_)) {
    outside_.insert(name);
    return std::nullopt;
  }
  std::error_code error;
  if (!name.empty() && std::filesystem::exists(path, error)) return path.lexically_normal();
  missing_.insert(name);
  return std::nullopt;
}

// Names of files may have spaces in them, and may be several behind one mtllib.
std::vector<const ObjMaterials::Library*> ObjMaterials::libraries_of(const ObjNames& names, const std::filesystem::path& folder) {
  std::vector<const Library*> found;
  for (const std::string& line : names.libraries) {
    Interrupt::poll();
    std::string_view rest = trimmed(line);
    std::error_code error;
    const bool is_one = rest.find('\0') == rest.npos && std::filesystem::exists(folder / rest, error);
    for (std::string_view name = is_one ? rest : next_word(rest); !name.empty(); name = is_one ? "" : next_word(rest)) {
      if (const auto path = find(std::string(name), folder)) found.push_back(library(*path));
    }
  }
  return found;
}

std::string ObjMaterials::read(const std::filesystem::path& path, const std::string& kind) {
  std::string bytes = read_text_file(path, kind);
  read_bytes_ += bytes.size();
  require(read_bytes_ <= kMaxReadBytes, path.string(), "at most " + std::to_string(kMaxReadBytes) + " bytes in all files",
          "more");
  return bytes;
}

// ------------------------------------------------------------------------------------------------------------------ materials

std::vector<std::uint16_t> ObjMaterials::numbers(const ObjNames& names, const std::filesystem::path& obj,
                                                 const std::function<std::uint16_t()>& default_material,
                                                 std::size_t& pixels_left) {
  const std::vector<const Library*> libraries = libraries_of(names, obj.parent_path());
  std::vector<std::uint16_t> numbers;
  for (const std::string& name : names.materials) {
    Interrupt::poll();
    if (name.empty()) {
      numbers.push_back(default_material());
      continue;
    }
    if (const auto own = own_.find(name); own != own_.end()) {
      numbers.push_back(own->second);
      continue;
    }
    std::optional<Place> place;
    for (const Library* const library : libraries) {
      const auto found = library->by_name.find(name);
      if (found != library->by_name.end() && !place) place.emplace(library, found->second);
    }
    if (place) {
      const auto known = defined_.find(*place);
      numbers.push_back(known != defined_.end() ? known->second
                                                : add(place->first->definitions[place->second], place->first->path, pixels_left));
      defined_.emplace(*place, numbers.back());
    } else {
      const auto known = undefined_.find(name);
      numbers.push_back(known != undefined_.end() ? known->second : add(Material{name}, obj.string()));
      undefined_.emplace(name, numbers.back());
    }
  }
  return numbers;
}

std::uint16_t ObjMaterials::add(Material material, const std::string& source) {
  require(scene_.materials.size() < kMaxMaterials, source, "at most " + std::to_string(kMaxMaterials) + " materials", "more");
  material.name = material_names_.take(shown_name(material.name));
  scene_.materials.push_back(std::move(material));
  return static_cast<std::uint16_t>(scene_.materials.size() - 1);
}

std::uint16_t ObjMaterials::add(const Definition& definition, const std::filesystem::path& library, std::size_t& pixels_left) {
  transparent_ += definition.is_transparent ? 1U : 0U;
  bumps_ += definition.has_bumps ? 1U : 0U;
  glowing_ += definition.glows_otherwise ? 1U : 0U;
  moved_ += definition.is_moved ? 1U : 0U;
  spectral_ += definition.is_spectral ? 1U : 0U;
  Material material{definition.name};
  if (!definition.texture.empty()) {
    material.texture = texture(definition.texture, definition.is_clamped, library, pixels_left);
  }
  material.base_color = definition.color.value_or(material.texture ? std::array{1.0F, 1.0F, 1.0F} : material.base_color);
  material.emissive = definition.emission;
  return add(std::move(material), library.string());
}

std::optional<std::uint16_t> ObjMaterials::texture(const std::string& name, bool is_clamped, const std::filesystem::path& library,
                                                   std::size_t& pixels_left) {
  const std::optional<std::filesystem::path> path = find(std::string(trimmed(name)), library.parent_path());
  if (!path) return std::nullopt;
  const auto known = textures_.find({*path, is_clamped});
  if (known != textures_.end()) return known->second;
  require(scene_.textures.size() < kMaxTextures, library.string(), "at most 65536 textures", "more");
  const std::string bytes = read(*path, "an image");
  Image image = decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path->string(), pixels_left);
  pixels_left -= image.rgba.size() / 4;
  const TextureWrap wrap = is_clamped ? TextureWrap::clamp : TextureWrap::repeat;
  const auto number = static_cast<std::uint16_t>(scene_.textures.size());
  scene_.textures.push_back({texture_names_.take(shown_name(path->filename().string())),
                             image.width_px,
                             image.height_px,
                             std::move(image.rgba),
                             {wrap, wrap}});
  textures_.emplace(std::pair(*path, is_clamped), number);
  return number;
}

std::vector<std::string> ObjMaterials::ignored() const {
  std::vector<std::string> ignored;
  if (!missing_.empty()) ignored.push_back(list_of(missing_, "file that is missing", "files that are missing"));
  if (!outside_.empty()) ignored.push_back(list_of(outside_, "file outside of the folder", "files outside of the folder"));
  const auto note = [&](std::size_t count, const char* singular, const char* plural) {
    if (count > 0) ignored.push_back(counted(count, singular, plural));
  };
  note(undefined_.size(), "material that no material file has", "materials that no material file has");
  note(transparent_, "material's transparency", "materials' transparency");
  note(bumps_, "material's bumps", "materials' bumps");
  note(glowing_, "material's emission by another texture than its colour's",
       "materials' emission by other textures than their colours'");
  note(moved_, "texture's scale or offset", "textures' scale or offset");
  note(spectral_, "material's colour by a spectrum", "materials' colours by spectra");
  return ignored;
}

}  // namespace flockstep
