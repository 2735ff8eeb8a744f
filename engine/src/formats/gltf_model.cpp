#include "formats/gltf_model.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <memory>
#include <set>
#include <span>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/json_document.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/limits.hpp"
#include "formats/base64.hpp"
#include "formats/solid_names.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"

#define TINYGLTF_IMPLEMENTATION
#include <tiny_gltf.h>  // once more: its functions

namespace flockstep {
namespace {

using json::Json;
using json::JsonField;

constexpr std::uint64_t kMaxCount = 1U << 31U;
constexpr std::uint64_t kMaxBufferBytes = static_cast<std::uint64_t>(kMaxFileBytes);  // of all buffers together
constexpr double kMaxNumber = 1e30;  // of transforms: their products stay far from overflow for some levels, and are checked

// What a file may require and is read.
constexpr std::array<std::string_view, 5> kExtensions{"KHR_texture_transform", "KHR_materials_unlit",
                                                      "KHR_materials_emissive_strength", "KHR_lights_punctual",
                                                      "KHR_mesh_quantization"};

// ------------------------------------------------------------------------------------------------------------- fields

std::uint64_t integer(const JsonField& field, std::uint64_t least, std::uint64_t most) {
  const double value = field.value.is_number() ? field.value.get<double>() : -1.0;
  if (!(value >= static_cast<double>(least) && value <= static_cast<double>(most) && value == std::floor(value))) {
    refuse(field, "an integer in [" + std::to_string(least) + ", " + std::to_string(most) + ']');
  }
  return static_cast<std::uint64_t>(value);
}

double number(const JsonField& field, double least, double most, const std::string& expected) {
  const double value = field.value.is_number() ? field.value.get<double>() : NAN;
  if (!(value >= least && value <= most)) refuse(field, expected);
  return value;
}

const std::string& text(const JsonField& field) {
  if (!field.value.is_string()) refuse(field, "a string");
  return field.value.get_ref<const std::string&>();
}

void require_object(const JsonField& field) {
  if (!field.value.is_object()) refuse(field, "an object");
}

std::optional<JsonField> find_object(const JsonField& parent, std::string_view key) {
  std::optional<JsonField> field = find(parent, key);
  if (field) require_object(*field);
  return field;
}

std::size_t size_of(const JsonField& parent, std::string_view key) {
  const std::optional<JsonField> field = find(parent, key);
  return field ? require_array(*field, "an array").size() : 0;
}

// ------------------------------------------------------------------------------------------------------------- checks

// Goes through the document and puts what is read of it into another one, for tinygltf, which has no wrong type, no index out of
// range and nothing deep in it. tinygltf itself reads a field of a wrong type as if it were missing.
class Checker {
 public:
  Checker(const JsonField& root, bool has_chunk, GltfModel& out) : root_(root), has_chunk_(has_chunk), out_(out) {}

  Json check() {
    require_object(root_);
    check_asset();
    check_extensions();
    for (const char* const list :
         {"buffers", "bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes", "scenes"}) {
      size_of(root_, list);
    }
    each("buffers", [this](const JsonField& field, Json& kept) { check_buffer(field, kept); });
    each("bufferViews", [this](const JsonField& field, Json& kept) { check_view(field, kept); });
    each("accessors", [this](const JsonField& field, Json& kept) { check_accessor(field, kept); });
    each("images", [this](const JsonField& field, Json&) { check_image(field); });
    kept_.erase("images");
    each("samplers", [](const JsonField& field, Json& kept) { check_sampler(field, kept); });
    each("textures", [this](const JsonField& field, Json& kept) { check_texture(field, kept); });
    each("materials", [this](const JsonField& field, Json& kept) { check_material(field, kept); });
    each("meshes", [this](const JsonField& field, Json& kept) { check_mesh(field, kept); });
    find_suns();
    each("nodes", [this](const JsonField& field, Json& kept) { check_node(field, kept); });
    each("scenes", [this](const JsonField& field, Json& kept) { check_scene(field, kept); });
    keep_index(root_, "scene", "scenes", kept_);
    note_rest();
    return std::move(kept_);
  }

 private:
  template <class Function>
  void each(const char* list, const Function& function) {
    const std::optional<JsonField> fields = find(root_, list);
    if (!fields) return;
    Json& all = kept_[list] = Json::array();
    for (std::size_t i = 0; i < fields->value.size(); ++i) {
      Interrupt::poll();
      const JsonField field = child(*fields, i);
      require_object(field);
      Json& kept = all.emplace_back(Json::object());
      function(field, kept);
    }
  }

  std::uint64_t index(const JsonField& field, const char* list) const {
    const std::size_t size = size_of(root_, list);
    const double value = field.value.is_number() ? field.value.get<double>() : -1.0;
    if (!(value >= 0.0 && value < static_cast<double>(size) && value == std::floor(value))) {
      refuse(field, std::string("an index of /") + list + " (which has " + std::to_string(size) + ')');
    }
    return static_cast<std::uint64_t>(value);
  }

  std::optional<std::uint64_t> keep_index(const JsonField& object, const char* key, const char* list, Json& kept) const {
    const std::optional<JsonField> field = find(object, key);
    if (!field) return std::nullopt;
    const std::uint64_t value = index(*field, list);
    kept[key] = value;
    return value;
  }

  void keep_indices(const JsonField& object, const char* key, const char* list, Json& kept) const {
    const std::optional<JsonField> field = find(object, key);
    if (!field) return;
    Json& all = kept[key] = Json::array();
    const std::size_t count = require_array(*field, "an array of indices").size();
    for (std::size_t i = 0; i < count; ++i) all.push_back(index(child(*field, i), list));
  }

  static std::uint64_t keep_integer(const JsonField& object, const char* key, std::uint64_t usual, std::uint64_t least,
                                    std::uint64_t most, Json& kept) {
    const std::optional<JsonField> field = find(object, key);
    const std::uint64_t value = field ? integer(*field, least, most) : usual;
    kept[key] = value;
    return value;
  }

  static void keep_numbers(const JsonField& object, const char* key, std::size_t count, double least, double most,
                           const std::string& expected, Json& kept) {
    const std::optional<JsonField> field = find(object, key);
    if (!field) return;
    if (!field->value.is_array() || field->value.size() != count) {
      refuse(*field, "an array of " + std::to_string(count) + " numbers");
    }
    Json& all = kept[key] = Json::array();
    for (std::size_t i = 0; i < count; ++i) all.push_back(number(child(*field, i), least, most, expected));
  }

  static void keep_name(const JsonField& object, Json& kept) {
    if (const auto name = find(object, "name")) kept["name"] = text(*name);
  }

  static void keep_semantic(const JsonField& object, Json& kept) {
    const std::optional<JsonField> extras = find(object, "extras");
    if (!extras || !extras->value.is_object()) return;  // they may be anything
    if (const auto field = find(*extras, kGltfSemantic)) {
      kept["extras"][kGltfSemantic] = integer(*field, static_cast<std::uint64_t>(keys::kSemantic.limits.least),
                                              static_cast<std::uint64_t>(keys::kSemantic.limits.greatest));
    }
  }

  void check_asset() {
    const JsonField asset = require(root_, "asset");
    require_object(asset);
    const JsonField version = require(asset, "version");
    if (!text(version).starts_with("2.")) refuse(version, "glTF 2");
    const auto least = find(asset, "minVersion");
    if (least && text(*least) != "2.0") refuse(*least, "glTF 2.0");
    kept_["asset"]["version"] = "2.0";
  }

  void check_extensions() {
    const auto is_read = [](const std::string& name) {
      return std::find(kExtensions.begin(), kExtensions.end(), name) != kExtensions.end();
    };
    if (const auto required = find(root_, "extensionsRequired")) {
      for (std::size_t i = 0; i < require_array(*required, "an array of names").size(); ++i) {
        const JsonField field = child(*required, i);
        if (!is_read(text(field)))
          refuse(field,
                 "no extension that is required but those read (KHR_texture_transform, "
                 "KHR_materials_unlit, KHR_materials_emissive_strength, KHR_lights_punctual, KHR_mesh_quantization)");
      }
    }
    if (const auto used = find(root_, "extensionsUsed")) {
      for (std::size_t i = 0; i < require_array(*used, "an array of names").size(); ++i) {
        const std::string& name = text(child(*used, i));
        if (!is_read(name)) out_.ignored.push_back("extension " + excerpt(name));
      }
    }
  }

  void check_buffer(const JsonField& field, Json& kept) {
    const JsonField length = require(field, "byteLength");
    total_bytes_ += integer(length, 1, kMaxBufferBytes);
    if (total_bytes_ > kMaxBufferBytes) refuse(length, "at most " + std::to_string(kMaxBufferBytes) + " bytes in all buffers");
    kept["byteLength"] = integer(length, 1, kMaxBufferBytes);
    const bool is_chunk = buffer_lengths_.empty() && has_chunk_ && !field.value.contains("uri");
    if (!is_chunk) text(require(field, "uri"));
    kept["uri"] = std::to_string(buffer_lengths_.size());  // for read_buffer
    buffer_lengths_.push_back(integer(length, 1, kMaxBufferBytes));
  }

  void check_view(const JsonField& field, Json& kept) {
    require(field, "buffer");
    const std::uint64_t length_of_buffer = buffer_lengths_[*keep_index(field, "buffer", "buffers", kept)];
    const std::uint64_t offset = keep_integer(field, "byteOffset", 0, 0, kMaxBufferBytes, kept);
    require(field, "byteLength");
    const std::uint64_t length = keep_integer(field, "byteLength", 0, 1, kMaxBufferBytes, kept);
    if (offset + length > length_of_buffer) {
      refuse(field, "a buffer view within its buffer of " + std::to_string(length_of_buffer) + " bytes",
             "bytes " + std::to_string(offset) + " to " + std::to_string(offset + length));
    }
    std::uint64_t stride = 0;
    if (const auto given = find(field, "byteStride")) {
      stride = integer(*given, 4, 252);
      if (stride % 4 != 0) refuse(*given, "a multiple of 4");
      kept["byteStride"] = stride;
    }
    views_.push_back({length, stride});
  }

  void check_accessor(const JsonField& field, Json& kept) {
    keep_integer(field, "componentType", 0, TINYGLTF_COMPONENT_TYPE_BYTE, TINYGLTF_COMPONENT_TYPE_FLOAT, kept);
    const JsonField component = require(field, "componentType");
    const std::uint64_t type = integer(component, 0, kMaxCount);
    std::uint64_t size = 4;
    if (type == TINYGLTF_COMPONENT_TYPE_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) size = 1;
    if (type == TINYGLTF_COMPONENT_TYPE_SHORT || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) size = 2;
    if (type == TINYGLTF_COMPONENT_TYPE_INT) refuse(component, "a component type of glTF");
    const JsonField shape = require(field, "type");
    constexpr std::array<std::pair<std::string_view, std::uint64_t>, 7> kShapes{
        {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT2", 4}, {"MAT3", 9}, {"MAT4", 16}}};
    const auto known =
        std::find_if(kShapes.begin(), kShapes.end(), [&](const auto& entry) { return entry.first == text(shape); });
    if (known == kShapes.end()) refuse(shape, "SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4");
    kept["type"] = text(shape);
    size *= known->second;
    require(field, "count");
    const std::uint64_t count = keep_integer(field, "count", 0, 1, kMaxCount, kept);
    if (const auto normalized = find(field, "normalized")) {
      if (!normalized->value.is_boolean()) refuse(*normalized, "true or false");
      kept["normalized"] = normalized->value;
    }
    const std::uint64_t offset = keep_integer(field, "byteOffset", 0, 0, kMaxBufferBytes, kept);
    const auto view_index = find(field, "bufferView");
    if (!view_index) return;
    const auto& [length, stride] = views_[index(*view_index, "bufferViews")];
    const std::uint64_t end = offset + (stride != 0 ? stride : size) * (count - 1) + size;  // below 2^50
    if (end > length) {
      refuse(field, "an accessor within its buffer view of " + std::to_string(length) + " bytes",
             "one that ends at byte " + std::to_string(end));
    }
    if (!field.value.contains("sparse")) kept["bufferView"] = index(*view_index, "bufferViews");  // else it is not read
  }

  void check_image(const JsonField& field) {
    GltfImage image;
    if (const auto name = find(field, "name")) image.name = text(*name);
    if (const auto view = find(field, "bufferView")) {
      image.buffer_view = index(*view, "bufferViews");
    } else {
      image.uri = text(require(field, "uri"));
    }
    out_.images.push_back(std::move(image));
  }

  static void check_sampler(const JsonField& field, Json& kept) {
    for (const char* const key : {"wrapS", "wrapT"}) {
      const auto wrap = find(field, key);
      if (!wrap) continue;
      const std::uint64_t value = integer(*wrap, 0, kMaxCount);
      const bool is_known = value == TINYGLTF_TEXTURE_WRAP_REPEAT || value == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE ||
                            value == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT;
      if (!is_known) refuse(*wrap, "10497 (repeat), 33071 (clamp) or 33648 (mirror)");
      kept[key] = value;
    }
  }

  void check_texture(const JsonField& field, Json& kept) {
    keep_index(field, "sampler", "samplers", kept);
    if (!keep_index(field, "source", "images", kept)) ++textures_without_image_;
  }

  void check_material(const JsonField& field, Json& kept) {
    keep_name(field, kept);
    keep_semantic(field, kept);
    normal_maps_ += find(field, "normalTexture") ? 1U : 0U;
    occluded_ += find(field, "occlusionTexture") ? 1U : 0U;
    const auto surface = find_object(field, "pbrMetallicRoughness");
    check_alpha(field, surface, kept);
    const auto extensions_of_material = find_object(field, "extensions");
    if (extensions_of_material && find_object(*extensions_of_material, "KHR_materials_unlit")) {
      kept["extras"][kGltfUnlit] = true;  // and emits nothing of its own
    } else {
      check_emission(field, surface, extensions_of_material, kept);
    }
    if (!surface) return;
    Json& kept_surface = kept["pbrMetallicRoughness"] = Json::object();
    keep_numbers(*surface, "baseColorFactor", 4, 0.0, 1.0, "a number in [0, 1]", kept_surface);
    const auto texture = find_object(*surface, "baseColorTexture");
    if (!texture) return;
    Json& kept_texture = kept_surface["baseColorTexture"];
    require(*texture, "index");
    keep_index(*texture, "index", "textures", kept_texture);
    keep_integer(*texture, "texCoord", 0, 0, kMaxTexCoord, kept_texture);
    const auto extensions = find_object(*texture, "extensions");
    const auto transform = extensions ? find_object(*extensions, "KHR_texture_transform") : std::nullopt;
    if (!transform) return;
    Json& kept_transform = kept_texture["extensions"]["KHR_texture_transform"] = Json::object();
    const std::string expected = "a number " + within(kMaxCoordinate).text();
    keep_numbers(*transform, "offset", 2, -kMaxCoordinate, kMaxCoordinate, expected, kept_transform);
    keep_numbers(*transform, "scale", 2, -kMaxCoordinate, kMaxCoordinate, expected, kept_transform);
    if (const auto angle = find(*transform, "rotation")) {
      kept_transform["rotation"] = number(*angle, -kMaxCoordinate, kMaxCoordinate, expected);
    }
    if (transform->value.contains("texCoord")) keep_integer(*transform, "texCoord", 0, 0, kMaxTexCoord, kept_texture);
  }

  // A mask cuts where the alpha of the base colour is below the cutoff. That alpha is the factor's times the texture's; ours is
  // the texture's alone, so the cutoff is divided by the factor's.
  void check_alpha(const JsonField& field, const std::optional<JsonField>& surface, Json& kept) {
    const auto mode = find(field, "alphaMode");
    if (!mode || text(*mode) == "OPAQUE") return;
    if (text(*mode) != "MASK") {
      ++transparent_;
      return;
    }
    const auto given = find(field, "alphaCutoff");
    const double cutoff = given ? number(*given, 0.0, kMaxNumber, "a number >= 0") : 0.5;
    Json factors = Json::object();
    if (surface) keep_numbers(*surface, "baseColorFactor", 4, 0.0, 1.0, "a number in [0, 1]", factors);
    const double factor = factors.empty() ? 1.0 : factors["baseColorFactor"][3].get<double>();
    if (cutoff == 0.0) return;
    if (cutoff > factor) {
      ++hidden_;
      return;
    }
    kept["alphaMode"] = "MASK";
    kept["alphaCutoff"] = cutoff / factor;
  }

  // Emission is multiplied by the texture of the base colour: what a file has by another is not read.
  void check_emission(const JsonField& field, const std::optional<JsonField>& surface, const std::optional<JsonField>& extensions,
                      Json& kept) {
    Json factors = Json::object();
    keep_numbers(field, "emissiveFactor", 3, 0.0, 1.0, "a number in [0, 1]", factors);
    const auto strong = extensions ? find_object(*extensions, "KHR_materials_emissive_strength") : std::nullopt;
    const auto strength = strong ? find(*strong, "emissiveStrength") : std::nullopt;
    const double times = strength ? number(*strength, 0.0, kMaxNumber, "a number >= 0") : 1.0;
    bool emits = false;
    for (Json& factor : factors["emissiveFactor"]) {
      factor = std::min(factor.get<double>() * times, keys::kEmissive.limits.greatest);
      emits |= factor.get<double>() > 0.0;
    }
    if (!emits) return;
    const auto ours = surface ? find(*surface, "baseColorTexture") : std::nullopt;
    const auto theirs = find(field, "emissiveTexture");
    const bool is_same = ours.has_value() == theirs.has_value() && (!ours || ours->value == theirs->value);
    if (is_same) kept["emissiveFactor"] = factors["emissiveFactor"];
    glowing_ += is_same ? 0U : 1U;
  }

  void check_mesh(const JsonField& field, Json& kept) {
    Json& all = kept["primitives"] = Json::array();
    const JsonField primitives = require(field, "primitives");
    for (std::size_t i = 0; i < require_array(primitives, "an array").size(); ++i) {
      Interrupt::poll();
      const JsonField primitive = child(primitives, i);
      require_object(primitive);
      if (size_of(primitive, "targets") > 0) ++morphed_;
      if (keep_integer(primitive, "mode", TINYGLTF_MODE_TRIANGLES, 0, 6, all.emplace_back(Json::object())) < 4) {
        ++lines_;
        all.erase(all.size() - 1);
        continue;
      }
      check_primitive(primitive, all.back());
    }
  }

  void check_primitive(const JsonField& field, Json& kept) {
    keep_index(field, "indices", "accessors", kept);
    keep_index(field, "material", "materials", kept);
    const JsonField attributes = require(field, "attributes");
    require_object(attributes);
    Json& kept_attributes = kept["attributes"] = Json::object();
    for (const auto& [name, value] : attributes.value.items()) {
      if (name != "POSITION" && name != "COLOR_0" && !name.starts_with("TEXCOORD_")) continue;
      kept_attributes[name] = index(child(attributes, name, value), "accessors");
    }
    require(attributes, "POSITION");
  }

  // Which lights of the file are directional.
  void find_suns() {
    const auto extensions = find_object(root_, "extensions");
    const auto punctual = extensions ? find_object(*extensions, "KHR_lights_punctual") : std::nullopt;
    const auto lights = punctual ? find(*punctual, "lights") : std::nullopt;
    if (!lights) return;
    for (std::size_t i = 0; i < require_array(*lights, "an array of lights").size(); ++i) {
      const JsonField light = child(*lights, i);
      require_object(light);
      is_sun_.push_back(text(require(light, "type")) == "directional");
    }
  }

  void check_node(const JsonField& field, Json& kept) {
    keep_name(field, kept);
    keep_indices(field, "children", "nodes", kept);
    keep_index(field, "mesh", "meshes", kept);
    keep_semantic(field, kept);
    constexpr const char* kExpected = "a number within +-1e+30";
    keep_numbers(field, "matrix", 16, -kMaxNumber, kMaxNumber, kExpected, kept);
    keep_numbers(field, "translation", 3, -kMaxNumber, kMaxNumber, kExpected, kept);
    keep_numbers(field, "rotation", 4, -kMaxNumber, kMaxNumber, kExpected, kept);
    keep_numbers(field, "scale", 3, -kMaxNumber, kMaxNumber, kExpected, kept);
    check_extras(field, kept);
    const auto extensions = find_object(field, "extensions");
    const auto punctual = extensions ? find_object(*extensions, "KHR_lights_punctual") : std::nullopt;
    if (!punctual) return;
    const JsonField light = require(*punctual, "light");
    const std::uint64_t number = integer(light, 0, kMaxCount);
    if (number >= is_sun_.size())
      refuse(light, "an index of the file's lights (which has " + std::to_string(is_sun_.size()) + ')');
    if (is_sun_[number]) {
      kept["extras"][kGltfSun] = true;
    } else {
      ++lamps_;
    }
  }

  void check_extras(const JsonField& field, Json& kept) {
    if (const auto name = find(field, "name"); name && is_gltf_marker(text(*name)) && !field.value.contains("mesh")) {
      kept["extras"][kGltfMarker] = text(*name);
    }
    if (const auto name = find(field, "name"); name && is_solid_name(text(*name))) kept["extras"][kGltfSolid] = true;
    GltfNodeExtras& ours = out_.node_extras.emplace_back();
    const std::optional<JsonField> extras = find(field, "extras");
    if (!extras || !extras->value.is_object()) return;
    ours = read_gltf_node_extras(*extras);
    if ((ours.primitive || ours.object) && !field.value.contains("mesh")) {
      fail(*extras, std::string("expected a mesh of the node, which \"") + kGltfExtras + "\" tells more about, found none");
    }
    if (const auto marker = find(*extras, kGltfMarker)) {
      if (!marker->value.is_string() || !is_gltf_marker(text(*marker))) {
        refuse(*marker, "\"start\", \"goal\", \"waypoint\" or \"waypoint.\" and a number");
      }
      kept["extras"][kGltfMarker] = text(*marker);
    }
    for (const char* const key : {kGltfVisual, kGltfSolid}) {
      const auto flag = find(*extras, key);
      if (!flag) continue;
      // What is exported from a box to tick comes as a number.
      const bool is_number = flag->value.is_number() && (flag->value == 0 || flag->value == 1);
      if (!flag->value.is_boolean() && !is_number) refuse(*flag, "true or false");
      kept["extras"][key] = is_number ? flag->value == 1 : flag->value.get<bool>();
    }
    if (is_true(kept, kGltfVisual) && is_true(kept, kGltfSolid)) {
      fail(*extras, "expected one of visual_only and collision_only to be true, got both");
    }
  }

  static bool is_true(const Json& kept, const char* key) {
    const auto extras = kept.find("extras");
    return extras != kept.end() && extras->contains(key) && (*extras)[key] == true;
  }

  void check_scene(const JsonField& field, Json& kept) {
    keep_name(field, kept);
    keep_indices(field, "nodes", "nodes", kept);
    const std::optional<JsonField> extras = find(field, "extras");
    out_.scene_extras.push_back(extras ? read_gltf_scene_extras(*extras) : std::nullopt);
  }

  void note_rest() {
    const auto note = [this](std::size_t count, const char* singular, const char* plural) {
      if (count > 0) out_.ignored.push_back(counted(count, singular, plural));
    };
    note(size_of(root_, "animations"), "animation", "animations");
    note(size_of(root_, "skins"), "skin", "skins");
    note(size_of(root_, "cameras"), "camera", "cameras");
    note(morphed_, "mesh primitive's morph targets", "mesh primitives' morph targets");
    note(lines_, "mesh primitive of points or lines", "mesh primitives of points or lines");
    note(lamps_, "light that is not directional", "lights that are not directional");
    note(transparent_, "material's transparency", "materials' transparency");
    note(hidden_, "material's mask that hides all of it", "materials' masks that hide all of them");
    note(normal_maps_, "material's normal map", "materials' normal maps");
    note(occluded_, "material's occlusion", "materials' occlusion");
    note(glowing_, "material's emission by another texture than its base colour's",
         "materials' emission by other textures than their base colours'");
    note(textures_without_image_, "texture without a PNG or JPEG image", "textures without a PNG or JPEG image");
  }

  static constexpr std::uint64_t kMaxTexCoord = 15;

  struct View {
    std::uint64_t length, stride;
  };

  JsonField root_;
  bool has_chunk_;
  GltfModel& out_;
  Json kept_ = Json::object();
  std::uint64_t total_bytes_ = 0;
  std::vector<std::uint64_t> buffer_lengths_;
  std::vector<View> views_;
  std::vector<bool> is_sun_;
  std::size_t morphed_ = 0, lines_ = 0, lamps_ = 0, transparent_ = 0, textures_without_image_ = 0;
  std::size_t normal_maps_ = 0, occluded_ = 0, glowing_ = 0, hidden_ = 0;
};

// -------------------------------------------------------------------------------------------------------------- files

struct Glb {
  std::string_view json;
  std::optional<std::string_view> chunk;  // of binary data
};

// The parts of a .glb file, of which the lengths are checked.
Glb parts_of_glb(std::string_view bytes, const std::string& source) {
  const auto number = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 4; i-- > 0;) value = value << 8U | static_cast<unsigned char>(bytes[at + i]);
    return value;
  };
  constexpr std::size_t kHeader = 12, kChunkHeader = 8;
  require(bytes.size() >= kHeader + kChunkHeader, source, "a .glb file that is whole", std::to_string(bytes.size()) + " bytes");
  require(number(4) == 2, source, "glTF 2", "version " + std::to_string(number(4)));
  require(number(8) == bytes.size(), source, "a .glb file that is as long as it says, " + std::to_string(number(8)) + " bytes",
          std::to_string(bytes.size()));
  Glb parts;
  constexpr std::uint32_t kJson = 0x4E4F534A, kBinary = 0x004E4942;
  for (std::size_t at = kHeader; at < bytes.size();) {
    require(bytes.size() - at >= kChunkHeader, source, "chunks that end with the file", "a part of one at its end");
    const std::uint32_t length = number(at);
    const std::uint32_t type = number(at + 4);
    const bool is_first = at == kHeader;
    at += kChunkHeader;
    require(length <= bytes.size() - at, source, "chunks within the file", "one of " + std::to_string(length) + " bytes");
    require(!is_first || type == kJson, source, "a first chunk of JSON", "another");
    if (is_first) parts.json = bytes.substr(at, length);
    if (type == kBinary && !parts.chunk) parts.chunk = bytes.substr(at, length);
    at += length;
  }
  return parts;
}

// What tinygltf is given in place of a file system: the buffers of the document by their number.
struct Buffers {
  const JsonField& root;
  std::optional<std::string_view> chunk;
  GltfFiles& files;

  static bool exists(const std::string&, void*) { return true; }
  static std::string same(const std::string& path, void*) { return path; }
  static bool read(std::vector<unsigned char>* out, std::string*, const std::string& path, void* self) {
    static_cast<const Buffers*>(self)->fill(*out, path);
    return true;
  }
  static bool write(std::string*, const std::string&, const std::vector<unsigned char>&, void*) { return false; }

  void fill(std::vector<unsigned char>& out, const std::string& path) const {
    std::size_t number = 0;
    std::from_chars(path.data(), path.data() + path.size(), number);
    const JsonField list = require(root, "buffers");
    const JsonField field = child(list, number);
    const std::uint64_t length = require(field, "byteLength").value.get<std::uint64_t>();
    const auto copy = [&](std::string_view bytes) {
      if (bytes.size() < length) refuse(field, std::to_string(length) + " bytes, as byteLength says", bytes.size());
      out.assign(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
    };
    const auto uri = find(field, "uri");
    if (!uri) return copy(*chunk);
    copy(files.read(uri->value.get_ref<const std::string&>(), name_of(*uri), "a buffer"));
  }
};

// Later versions of tinygltf ask for the size first, too.
template <class Callbacks>
void set_size(Callbacks& callbacks) {
  if constexpr (requires { callbacks.GetFileSizeInBytes; }) {
    callbacks.GetFileSizeInBytes = [](std::size_t* size, std::string*, const std::string&, void*) {
      *size = 1;
      return true;
    };
  }
}

// %20 and the like.
std::string decoded(std::string_view uri) {
  std::string path;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    unsigned value = 0;
    const char* const digits = uri.data() + i + 1;
    const bool is_code = uri[i] == '%' && uri.size() - i > 2 && std::from_chars(digits, digits + 2, value, 16).ptr == digits + 2;
    path += is_code ? static_cast<char>(value) : uri[i];
    if (is_code) i += 2;
  }
  return path;
}

}  // namespace

bool is_gltf_marker(std::string_view name) {
  if (name == "start" || name == "goal" || name == "waypoint") return true;
  constexpr std::string_view kPrefix = "waypoint.";
  constexpr std::size_t kMaxDigits = 9;
  if (!name.starts_with(kPrefix)) return false;
  name.remove_prefix(kPrefix.size());
  return !name.empty() && name.size() <= kMaxDigits && name.find_first_not_of("0123456789") == name.npos;
}

std::string GltfFiles::read(const std::string& uri, const std::string& field, const std::string& kind) {
  const auto count = [&](std::string bytes) {
    read_bytes_ += bytes.size();
    if (read_bytes_ > kMaxReadBytes) refuse(field, "at most " + std::to_string(kMaxReadBytes) + " bytes in all", "more");
    return bytes;
  };
  if (uri.starts_with("data:")) {
    constexpr std::string_view kBase64 = ";base64,";
    const std::size_t comma = std::min(uri.find(','), uri.size() - 1);
    const std::string_view head = std::string_view(uri).substr(0, comma + 1);
    if (!head.ends_with(kBase64)) refuse(field, "a data: that is base64", '"' + excerpt(head) + '"');
    return count(bytes_of_base64(std::string_view(uri).substr(head.size()), field));
  }
  const std::string name = decoded(uri);
  if (name.empty() || name.find('\0') != name.npos || name.find("://") != name.npos) {
    refuse(field, "data: or the path of a file", '"' + excerpt(uri) + '"');
  }
  const std::filesystem::path path = folder_ / name;
  if (files_ == MeshFiles::in_folder && !is_below(path, folder_)) {
    refuse(field, "a file in the folder of " + source_ + " or below it (load with meshes_anywhere=True to allow others)",
           '"' + excerpt(uri) + '"');
  }
  try {
    return count(read_text_file(path, kind));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(field + ": " + error.what());
  }
}

GltfModel read_gltf_model(const std::string& bytes, const std::string& source, GltfFiles& files) {
  Glb parts{bytes, std::nullopt};
  if (bytes.starts_with("glTF")) parts = parts_of_glb(bytes, source);
  const auto document = json::Document::parse(std::string(parts.json), source);
  GltfModel result;
  const JsonField root = document->root();
  const std::string checked = Checker(root, parts.chunk.has_value(), result).check().dump();

  Buffers buffers{root, parts.chunk, files};
  tinygltf::FsCallbacks callbacks{};
  callbacks.FileExists = Buffers::exists;
  callbacks.ExpandFilePath = Buffers::same;
  callbacks.ReadWholeFile = Buffers::read;
  callbacks.WriteWholeFile = Buffers::write;
  callbacks.user_data = &buffers;
  set_size(callbacks);
  tinygltf::TinyGLTF reader;
  reader.SetFsCallbacks(callbacks);
  std::string error, warning;
  if (!reader.LoadASCIIFromString(&result.model, &error, &warning, checked.data(), static_cast<unsigned>(checked.size()), "")) {
    throw std::invalid_argument(source + ": tinygltf: " + excerpt(error, 300));
  }
  return result;
}

}  // namespace flockstep
