#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <system_error>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "formats/image.hpp"
#include "formats/mesh_files.hpp"
#include "formats/text_lines.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {
namespace {

// Makes a name valid for scene files, which are UTF-8.
std::string shown_name(std::string_view name) { return excerpt(name, 200); }

// Lists names after their count: "2 missing files (a.mtl, b.png)".
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

namespace {

struct TextureUse {
  std::string file;
  bool is_clamped = false, is_moved = false;
};

}  // namespace

struct ObjMaterials::Definition {
  std::string name;
  std::optional<std::array<float, 3>> color;
  std::array<float, 3> emission{};
  float opacity = 1.0F;
  TextureUse texture;
  std::string emission_texture;
  bool has_opacity = false, has_opacity_texture = false, has_bumps = false, is_spectral = false;
};

struct ObjMaterials::Library {
  std::filesystem::path path;
  std::vector<Definition> definitions;
  std::map<std::string, std::size_t, std::less<>> by_name;  // first definition of each name

  // `most` is the maximum number of definitions.
  void read(std::string_view text, std::size_t most);
};

namespace {

// Parses a colour. A single number is used for all three channels. Returns nothing if a number is outside the limits.
std::optional<std::array<float, 3>> color_of(std::string_view words, const Limits& limits) {
  std::array<float, 3> color{};
  words = trimmed(words);
  const bool is_one = words.find_first_of(" \t") == words.npos;
  for (float& channel : color) {
    std::string_view same = words;
    double value = 0.0;
    if (!parse_number(next_word(is_one ? same : words), value) || !limits.contain(value)) return std::nullopt;
    channel = static_cast<float>(value);
  }
  return color;
}

// Parses a texture statement: options, then the file name, which is the rest of the line.
TextureUse texture_of(std::string_view rest) {
  constexpr std::array<std::string_view, 11> kWithWords{"-blendu",     "-blendv",  "-boost", "-bm",     "-cc",  "-clamp",
                                                        "-colorspace", "-imfchan", "-mm",    "-texres", "-type"};
  TextureUse use;
  for (;;) {
    std::string_view behind = rest;
    const std::string_view option = next_word(behind);
    if (option == "-o" || option == "-s" || option == "-t") {  // one to three numbers
      double value = 0.0;
      for (int axis = 0; axis < 3; ++axis) {
        std::string_view next = behind;
        if (!parse_number(next_word(next), value)) break;
        use.is_moved |= axis < 2 && option != "-t" && value != (option == "-s" ? 1.0 : 0.0);
        behind = next;
      }
    } else if (std::find(kWithWords.begin(), kWithWords.end(), option) != kWithWords.end()) {
      const std::string_view word = next_word(behind);
      if (option == "-clamp") use.is_clamped = word != "off";
      if (option == "-mm") next_word(behind);  // has two numbers
    } else {
      use.file = trimmed(rest);
      return use;
    }
    rest = behind;
  }
}

}  // namespace

void ObjMaterials::Library::read(std::string_view text, std::size_t most) {
  constexpr std::array<std::string_view, 6> kBumps{"map_bump", "map_Bump", "bump", "norm", "disp", "map_disp"};
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (number % 1024 == 0) Interrupt::poll();
    const std::string_view line = next_line(text);
    std::string_view rest = line;
    const std::string_view keyword = next_word(rest);
    const auto place = [&] { return path.string() + ':' + std::to_string(number); };
    const auto refuse_line = [&](const std::string& expected) { refuse(place(), expected, quoted_excerpt(line)); };
    if (keyword == "newmtl") {
      require(definitions.size() < most, place(), "at most " + std::to_string(kMaxMaterials) + " materials in all", "more");
      by_name.try_emplace(std::string(trimmed(rest)), definitions.size());
      definitions.emplace_back().name = trimmed(rest);
    }
    if (definitions.empty()) continue;
    Definition& material = definitions.back();
    if (keyword == "Kd" || keyword == "Ke") {
      std::string_view words = rest;
      const std::string_view first = next_word(words);
      if (first == "spectral" || first == "xyz") {
        material.is_spectral = true;
        continue;
      }
      const Limits& limits = keyword == "Ke" ? Light::kBrightness : keys::kShares;
      const auto color = color_of(rest, limits);
      if (!color) refuse_line("three numbers " + limits.text() + " after " + std::string(keyword));
      (keyword == "Ke" ? material.emission : material.color.emplace()) = *color;
    } else if (keyword == "d" || keyword == "Tr") {
      std::string_view word = next_word(rest);
      if (word == "-halo") word = next_word(rest);
      double value = 0.0;
      if (!parse_number(word, value) || !std::isfinite(value)) refuse_line("a number after d or Tr");
      if (keyword == "d" || !material.has_opacity) material.opacity = static_cast<float>(keyword == "d" ? value : 1.0 - value);
      material.has_opacity |= keyword == "d";
    } else if (TextureUse use = texture_of(rest); !use.file.empty()) {
      if (keyword == "map_Kd") material.texture = std::move(use);
      if (keyword == "map_Ke") material.emission_texture = std::move(use.file);
      if (keyword == "map_d") material.has_opacity_texture = true;
      material.has_bumps |= std::find(kBumps.begin(), kBumps.end(), keyword) != kBumps.end();
    }
  }
}

const ObjMaterials::Library* ObjMaterials::library(const std::filesystem::path& path) {
  std::unique_ptr<const Library>& known = libraries_[path];
  if (known) return known.get();
  auto library = std::make_unique<Library>();
  library->path = path;
  library->read(read(path, "a material file"), kMaxMaterials - num_definitions_);
  num_definitions_ += library->definitions.size();
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

// Returns the path of a file if it exists and may be read.
std::optional<std::filesystem::path> ObjMaterials::find(std::string name, const std::filesystem::path& folder) {
  std::replace(name.begin(), name.end(), '\\', '/');
  if (name.find('\0') != name.npos) name.clear();
  const std::filesystem::path path = folder / name;
  if (files_ == MeshFiles::none || (files_ == MeshFiles::in_folder && !is_below(path, folder_))) {
    outside_.insert(name);
    return std::nullopt;
  }
  std::error_code error;
  if (!name.empty() && std::filesystem::exists(path, error)) return path.lexically_normal();
  missing_.insert(name);
  return std::nullopt;
}

// Finds the libraries of the mtllib lines. A line may have several file names, and names may contain spaces.
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
  // Emission is multiplied by the colour texture, so it is kept only if it has the same texture, or if both have none.
  const bool is_same = definition.emission_texture == definition.texture.file;
  const bool emits = definition.emission != std::array<float, 3>{} || !definition.emission_texture.empty();
  transparent_ += definition.opacity != 1.0F || definition.has_opacity_texture ? 1U : 0U;
  bumps_ += definition.has_bumps ? 1U : 0U;
  glowing_ += emits && !is_same ? 1U : 0U;
  moved_ += definition.texture.is_moved ? 1U : 0U;
  spectral_ += definition.is_spectral ? 1U : 0U;
  Material material{definition.name};
  if (!definition.texture.file.empty()) {
    material.texture = texture(definition.texture.file, definition.texture.is_clamped, library, pixels_left);
  }
  material.base_color = definition.color.value_or(material.texture ? std::array{1.0F, 1.0F, 1.0F} : material.base_color);
  if (is_same) material.emissive = definition.emission;
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
  if (!missing_.empty()) ignored.push_back(list_of(missing_, "missing file", "missing files"));
  if (!outside_.empty()) ignored.push_back(list_of(outside_, "file outside of the folder", "files outside of the folder"));
  const auto note = [&](std::size_t count, const char* singular, const char* plural) {
    if (count > 0) ignored.push_back(counted(count, singular, plural));
  };
  note(undefined_.size(), "material that no material file defines", "materials that no material file defines");
  note(transparent_, "material's transparency", "materials' transparency");
  note(bumps_, "material's bump map", "materials' bump maps");
  note(glowing_, "material's emission by another texture than its colour's",
       "materials' emission by other textures than their colours'");
  note(moved_, "texture's scale or offset", "textures' scale or offset");
  note(spectral_, "material's colour by a spectrum", "materials' colours by spectra");
  return ignored;
}

}  // namespace flockstep
