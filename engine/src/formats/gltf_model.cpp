#include "formats/gltf_model.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "base/config_values.hpp"
#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/json_document.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/limits.hpp"
#include "formats/names.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {
namespace {

using json::integer;
using json::JsonField;
using json::text;

constexpr std::uint64_t kMaxCount = 1U << 31U;
constexpr std::uint64_t kMaxBufferBytes = static_cast<std::uint64_t>(kMaxFileBytes);  // total of all buffers
constexpr double kMaxNumber = 1e30;  // limit in transforms: products are far from overflow for some levels, and checked

// Supported extensions that a file may require.
constexpr std::array<std::string_view, 5> kExtensions{"KHR_texture_transform", "KHR_materials_unlit",
                                                      "KHR_materials_emissive_strength", "KHR_lights_punctual",
                                                      "KHR_mesh_quantization"};

// ------------------------------------------------------------------------------------------------------------- fields

void require_object(const JsonField& field) {
  if (!field.value.is_object()) refuse(field, "an object");
}

std::optional<JsonField> find_object(const JsonField& parent, std::string_view key) {
  std::optional<JsonField> field = find(parent, key);
  if (field) require_object(*field);
  return field;
}

std::optional<JsonField> find_extension(const JsonField& parent, std::string_view name) {
  const std::optional<JsonField> extensions = find_object(parent, "extensions");
  return extensions ? find_object(*extensions, name) : std::nullopt;
}

std::size_t size_of(const JsonField& parent, std::string_view key) {
  const std::optional<JsonField> field = find(parent, key);
  return field ? require_array(*field, "an array").size() : 0;
}

// ------------------------------------------------------------------------------------------------------------ document

// Reads the document into a model, list by list. Each list refers only to earlier ones.
class ModelReader {
 public:
  ModelReader(const JsonField& root, std::optional<std::string_view> chunk, GltfFiles& files)
      : root_(root), chunk_(chunk), files_(files) {}

  GltfModel read() {
    require_object(root_);
    read_asset();
    read_extensions();
    for (const char* const list :
         {"buffers", "bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes", "scenes"}) {
      size_of(root_, list);
    }
    each("buffers", [this](const JsonField& field) { check_buffer(field); });
    each("bufferViews", [this](const JsonField& field) { out_.views.push_back(view_of(field)); });
    each("accessors", [this](const JsonField& field) { out_.accessors.push_back(accessor_of(field)); });
    each("images", [this](const JsonField& field) { out_.images.push_back(image_of(field)); });
    each("samplers", [this](const JsonField& field) { wraps_.push_back(wrap_of(field)); });
    each("textures", [this](const JsonField& field) { out_.textures.push_back(texture_of(field)); });
    each("materials", [this](const JsonField& field) { out_.materials.push_back(material_of(field)); });
    each("meshes", [this](const JsonField& field) { out_.meshes.push_back(mesh_of(field)); });
    find_suns();
    each("nodes", [this](const JsonField& field) { out_.nodes.push_back(node_of(field)); });
    each("scenes", [this](const JsonField& field) { out_.scenes.push_back(scene_of(field)); });
    out_.scene = find_index(root_, "scene", "scenes");
    note_rest();
    each("buffers", [this](const JsonField& field) { read_buffer(field); });  // after everything else has been checked
    return std::move(out_);
  }

 private:
  template <class Function>
  void each(const char* list, const Function& function) {
    const std::optional<JsonField> fields = find(root_, list);
    if (!fields) return;
    for (std::size_t i = 0; i < fields->value.size(); ++i) {
      Interrupt::poll();
      const JsonField field = child(*fields, i);
      require_object(field);
      function(field);
    }
  }

  std::size_t index(const JsonField& field, const char* list) const {
    const std::size_t size = size_of(root_, list);
    const double value = field.value.is_number() ? field.value.get<double>() : -1.0;
    if (!(value >= 0.0 && value < static_cast<double>(size) && value == std::floor(value))) {
      refuse(field, std::string("an index of /") + list + " (which has " + std::to_string(size) + ')');
    }
    return static_cast<std::size_t>(value);
  }

  std::optional<std::size_t> find_index(const JsonField& object, const char* key, const char* list) const {
    const std::optional<JsonField> field = find(object, key);
    return field ? std::optional(index(*field, list)) : std::nullopt;
  }

  std::vector<std::size_t> indices(const JsonField& object, const char* key, const char* list) const {
    std::vector<std::size_t> all;
    const std::optional<JsonField> field = find(object, key);
    if (!field) return all;
    const std::size_t count = require_array(*field, "an array of indices").size();
    for (std::size_t i = 0; i < count; ++i) all.push_back(index(child(*field, i), list));
    return all;
  }

  static std::uint64_t integer_or(const JsonField& object, const char* key, std::uint64_t usual, std::uint64_t least,
                                  std::uint64_t most) {
    const std::optional<JsonField> field = find(object, key);
    return field ? integer(*field, least, most) : usual;
  }

  template <class Value>
  static std::optional<Value> find_value(const JsonField& object, const char* key, const Limits& limits) {
    std::optional<Value> value;
    if (const auto field = find(object, key)) config_values::read_value(*field, {.limits = limits}, value);
    return value;
  }
  template <std::size_t kCount>
  static auto numbers(const JsonField& object, const char* key, const Limits& limits) {
    return find_value<std::array<double, kCount>>(object, key, limits);
  }

  static std::string name_in(const JsonField& object) {
    const std::optional<JsonField> name = find(object, "name");
    return name ? text(*name) : std::string();
  }

  static int semantic_in(const JsonField& object) {
    const std::optional<JsonField> extras = find(object, "extras");
    if (!extras || !extras->value.is_object()) return 0;  // extras may be any value
    const std::optional<JsonField> field = find(*extras, "semantic");
    return field ? static_cast<int>(integer(*field, static_cast<std::uint64_t>(keys::kSemantics.least),
                                            static_cast<std::uint64_t>(keys::kSemantics.greatest)))
                 : 0;
  }

  void read_asset() {
    const JsonField asset = require(root_, "asset");
    require_object(asset);
    const JsonField version = require(asset, "version");
    if (!text(version).starts_with("2.")) refuse(version, "glTF 2");
    const auto least = find(asset, "minVersion");
    if (least && text(*least) != "2.0") refuse(*least, "glTF 2.0");
  }

  void read_extensions() {
    const auto is_read = [](const std::string& name) {
      return std::find(kExtensions.begin(), kExtensions.end(), name) != kExtensions.end();
    };
    if (const auto required = find(root_, "extensionsRequired")) {
      for (std::size_t i = 0; i < require_array(*required, "an array of names").size(); ++i) {
        const JsonField field = child(*required, i);
        if (!is_read(text(field))) {
          std::string names;
          for (const std::string_view name : kExtensions) names += (names.empty() ? "" : ", ") + std::string(name);
          refuse(field, "only supported extensions (" + names + ')');
        }
      }
    }
    if (const auto used = find(root_, "extensionsUsed")) {
      for (std::size_t i = 0; i < require_array(*used, "an array of names").size(); ++i) {
        const std::string& name = text(child(*used, i));
        if (!is_read(name)) out_.ignored.push_back("extension " + excerpt(name));
      }
    }
  }

  void check_buffer(const JsonField& field) {
    const JsonField length = require(field, "byteLength");
    total_bytes_ += integer(length, 1, kMaxBufferBytes);
    if (total_bytes_ > kMaxBufferBytes) refuse(length, "at most " + std::to_string(kMaxBufferBytes) + " bytes in all buffers");
    if (!is_chunk(field, buffer_lengths_.size())) text(require(field, "uri"));
    buffer_lengths_.push_back(integer(length, 1, kMaxBufferBytes));
  }

  // Returns whether buffer `number` is the binary chunk of a .glb file.
  bool is_chunk(const JsonField& field, std::size_t number) const {
    return number == 0 && chunk_.has_value() && !field.value.contains("uri");
  }

  void read_buffer(const JsonField& field) {
    const std::size_t length = buffer_lengths_[out_.buffers.size()];
    std::string_view bytes;
    if (is_chunk(field, out_.buffers.size())) {
      bytes = *chunk_;
    } else {
      const JsonField uri = require(field, "uri");
      std::string file = files_.read(text(uri), name_of(uri), "a buffer");
      if (file.size() > length) file = file.substr(0, length);  // in new memory: keeps only the used part
      bytes = *out_.files.emplace_back(std::make_unique<const std::string>(std::move(file)));
    }
    if (bytes.size() < length) refuse(field, std::to_string(length) + " bytes, as byteLength says", bytes.size());
    out_.buffers.push_back(bytes.substr(0, length));
  }

  GltfView view_of(const JsonField& field) const {
    GltfView view{};
    view.buffer = index(require(field, "buffer"), "buffers");
    view.offset = integer_or(field, "byteOffset", 0, 0, kMaxBufferBytes);
    view.length = integer(require(field, "byteLength"), 1, kMaxBufferBytes);
    if (const std::uint64_t length = buffer_lengths_[view.buffer]; view.offset + view.length > length) {
      refuse(field, "a buffer view within its buffer of " + std::to_string(length) + " bytes",
             "bytes " + std::to_string(view.offset) + " to " + std::to_string(view.offset + view.length));
    }
    if (const auto given = find(field, "byteStride")) {
      view.stride = integer(*given, 4, 252);
      if (view.stride % 4 != 0) refuse(*given, "a multiple of 4");
    }
    return view;
  }

  GltfAccessor accessor_of(const JsonField& field) const {
    GltfAccessor accessor{};
    const JsonField component = require(field, "componentType");
    const std::uint64_t type =
        integer(component, static_cast<std::uint64_t>(GltfComponent::int8), static_cast<std::uint64_t>(GltfComponent::float32));
    constexpr std::uint64_t kInt32 = 5124;  // not allowed in glTF
    if (type == kInt32) refuse(component, "a component type of glTF");
    accessor.component = static_cast<GltfComponent>(type);
    constexpr std::array<std::string_view, 7> kShapes{"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"};
    const JsonField shape = require(field, "type");
    const auto known = std::find(kShapes.begin(), kShapes.end(), text(shape));
    if (known == kShapes.end()) refuse(shape, "SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4");
    accessor.shape = static_cast<GltfShape>(known - kShapes.begin());
    accessor.count = integer(require(field, "count"), 1, kMaxCount);
    accessor.is_normalized = find_value<bool>(field, "normalized", {}).value_or(false);
    accessor.offset = integer_or(field, "byteOffset", 0, 0, kMaxBufferBytes);
    const std::optional<std::size_t> number = find_index(field, "bufferView", "bufferViews");
    if (!number) return accessor;
    const GltfView& view = out_.views[*number];
    const std::size_t size = accessor.element_bytes();
    const std::uint64_t end = accessor.offset + (view.stride != 0 ? view.stride : size) * (accessor.count - 1) + size;  // < 2^50
    if (end > view.length) {
      refuse(field, "an accessor within its buffer view of " + std::to_string(view.length) + " bytes",
             "one that ends at byte " + std::to_string(end));
    }
    if (!field.value.contains("sparse")) accessor.view = number;
    return accessor;
  }

  GltfImage image_of(const JsonField& field) const {
    GltfImage image{.name = name_in(field), .view = find_index(field, "bufferView", "bufferViews"), .uri = {}};
    if (!image.view) image.uri = text(require(field, "uri"));
    return image;
  }

  static std::array<TextureWrap, 2> wrap_of(const JsonField& field) {
    constexpr std::uint64_t kRepeat = 10497, kClamp = 33071, kMirror = 33648;
    std::array<TextureWrap, 2> wrap{TextureWrap::repeat, TextureWrap::repeat};
    constexpr std::array<const char*, 2> kNames{"wrapS", "wrapT"};
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const auto given = find(field, kNames[axis]);
      if (!given) continue;
      const std::uint64_t value = integer(*given, 0, kMaxCount);
      if (value != kRepeat && value != kClamp && value != kMirror) {
        refuse(*given, "10497 (repeat), 33071 (clamp) or 33648 (mirror)");
      }
      if (value == kClamp) wrap[axis] = TextureWrap::clamp;
      if (value == kMirror) wrap[axis] = TextureWrap::mirror;
    }
    return wrap;
  }

  GltfTexture texture_of(const JsonField& field) {
    GltfTexture texture;
    if (const auto sampler = find_index(field, "sampler", "samplers")) texture.wrap = wraps_[*sampler];
    texture.image = find_index(field, "source", "images");
    textures_without_image_ += texture.image ? 0U : 1U;
    return texture;
  }

  GltfMaterial material_of(const JsonField& field) {
    GltfMaterial material{.name = name_in(field), .semantic = semantic_in(field)};
    normal_maps_ += find(field, "normalTexture") ? 1U : 0U;
    occluded_ += find(field, "occlusionTexture") ? 1U : 0U;
    const auto surface = find_object(field, "pbrMetallicRoughness");
    read_alpha(field, surface, material);
    material.is_unlit = find_extension(field, "KHR_materials_unlit").has_value();
    if (!material.is_unlit) read_emission(field, surface, material);  // unlit materials emit nothing
    if (!surface) return material;
    material.base_color = base_color_in(*surface);
    if (const auto texture = find_object(*surface, "baseColorTexture")) read_base_texture(*texture, material);
    return material;
  }

  static std::array<double, 4> base_color_in(const JsonField& surface) {
    return numbers<4>(surface, "baseColorFactor", keys::kShares).value_or(std::array{1.0, 1.0, 1.0, 1.0});
  }

  void read_base_texture(const JsonField& field, GltfMaterial& material) const {
    material.texture = index(require(field, "index"), "textures");
    material.tex_coord = integer_or(field, "texCoord", 0, 0, kMaxTexCoord);
    const auto given = find_extension(field, "KHR_texture_transform");
    if (!given) return;
    GltfTextureTransform& transform = material.transform.emplace();
    transform.offset = numbers<2>(*given, "offset", keys::kCoordinates).value_or(transform.offset);
    transform.scale = numbers<2>(*given, "scale", keys::kCoordinates).value_or(transform.scale);
    transform.rotation = find_value<double>(*given, "rotation", keys::kCoordinates).value_or(transform.rotation);
    material.tex_coord = integer_or(*given, "texCoord", material.tex_coord, 0, kMaxTexCoord);
  }

  // A mask cuts if the alpha of the base colour is below the cutoff. In glTF that alpha is the factor's times the texture's;
  // here it is only the texture's, so the cutoff is divided by the factor's alpha.
  void read_alpha(const JsonField& field, const std::optional<JsonField>& surface, GltfMaterial& material) {
    const auto mode = find(field, "alphaMode");
    if (!mode || text(*mode) == "OPAQUE") return;
    if (text(*mode) != "MASK") {
      ++transparent_;
      return;
    }
    const double cutoff = find_value<double>(field, "alphaCutoff", at_least(0.0)).value_or(0.5);
    const double factor = surface ? base_color_in(*surface)[3] : 1.0;
    if (cutoff == 0.0) return;
    if (cutoff > factor) {
      ++hidden_;
      return;
    }
    material.alpha_cutoff = cutoff / factor;
  }

  // Emission is multiplied by the base colour texture. Emission by another texture is ignored.
  void read_emission(const JsonField& field, const std::optional<JsonField>& surface, GltfMaterial& material) {
    std::array<double, 3> emissive = numbers<3>(field, "emissiveFactor", keys::kShares).value_or(std::array{0.0, 0.0, 0.0});
    const auto strong = find_extension(field, "KHR_materials_emissive_strength");
    const auto strength = strong ? find_value<double>(*strong, "emissiveStrength", at_least(0.0)) : std::nullopt;
    const double times = strength.value_or(1.0);
    bool emits = false;
    for (double& factor : emissive) {
      factor = std::min(factor * times, Light::kBrightness.greatest);
      emits |= factor > 0.0;
    }
    if (!emits) return;
    const auto ours = surface ? find(*surface, "baseColorTexture") : std::nullopt;
    const auto theirs = find(field, "emissiveTexture");
    const bool is_same = ours.has_value() == theirs.has_value() && (!ours || ours->value == theirs->value);
    if (is_same) material.emissive = emissive;
    glowing_ += is_same ? 0U : 1U;
  }

  std::vector<GltfPrimitive> mesh_of(const JsonField& field) {
    std::vector<GltfPrimitive> mesh;
    const JsonField primitives = require(field, "primitives");
    for (std::size_t i = 0; i < require_array(primitives, "an array").size(); ++i) {
      Interrupt::poll();
      const JsonField primitive = child(primitives, i);
      require_object(primitive);
      if (size_of(primitive, "targets") > 0) ++morphed_;
      const std::uint64_t mode = integer_or(primitive, "mode", static_cast<std::uint64_t>(GltfMode::triangles), 0,
                                            static_cast<std::uint64_t>(GltfMode::fan));
      if (mode < static_cast<std::uint64_t>(GltfMode::triangles)) {
        ++lines_;
      } else {
        mesh.push_back(primitive_of(primitive, static_cast<GltfMode>(mode)));
      }
    }
    return mesh;
  }

  GltfPrimitive primitive_of(const JsonField& field, GltfMode mode) const {
    GltfPrimitive primitive{.mode = mode,
                            .indices = find_index(field, "indices", "accessors"),
                            .material = find_index(field, "material", "materials"),
                            .attributes = {}};
    const JsonField attributes = require(field, "attributes");
    require_object(attributes);
    for (const auto& [name, value] : attributes.value.items()) {
      if (name != "POSITION" && name != "COLOR_0" && !name.starts_with("TEXCOORD_")) continue;
      primitive.attributes[name] = index(child(attributes, name, value), "accessors");
    }
    require(attributes, "POSITION");
    return primitive;
  }

  // Finds the directional lights of the file.
  void find_suns() {
    const auto punctual = find_extension(root_, "KHR_lights_punctual");
    const auto lights = punctual ? find(*punctual, "lights") : std::nullopt;
    if (!lights) return;
    for (std::size_t i = 0; i < require_array(*lights, "an array of lights").size(); ++i) {
      const JsonField light = child(*lights, i);
      require_object(light);
      is_sun_.push_back(text(require(light, "type")) == "directional");
    }
  }

  GltfNode node_of(const JsonField& field) {
    constexpr Limits kNumbers = within(kMaxNumber);
    const std::string name = name_in(field);
    GltfNode node;
    node.children = indices(field, "children", "nodes");
    node.mesh = find_index(field, "mesh", "meshes");
    node.semantic = semantic_in(field);
    node.matrix = numbers<16>(field, "matrix", kNumbers);
    node.translation = numbers<3>(field, "translation", kNumbers);
    node.rotation = numbers<4>(field, "rotation", kNumbers);
    node.scale = numbers<3>(field, "scale", kNumbers);
    if (is_gltf_marker(name) && !field.value.contains("mesh")) node.marker = name;
    if (is_solid_name(name)) node.collision_only = true;
    read_extras(field, node);
    const auto punctual = find_extension(field, "KHR_lights_punctual");
    if (!punctual) return node;
    const JsonField light = require(*punctual, "light");
    const std::uint64_t number = integer(light, 0, kMaxCount);
    if (number >= is_sun_.size())
      refuse(light, "an index of the file's lights (which has " + std::to_string(is_sun_.size()) + ')');
    node.has_sun = is_sun_[number];
    lamps_ += node.has_sun ? 0U : 1U;
    return node;
  }

  static void read_extras(const JsonField& field, GltfNode& node) {
    const std::optional<JsonField> extras = find(field, "extras");
    if (!extras || !extras->value.is_object()) return;
    node.extras = read_gltf_node_extras(*extras);
    if ((node.extras.primitive || node.extras.object) && !field.value.contains("mesh")) {
      fail(*extras, std::string("expected a mesh on the node, for \"") + kGltfExtras + "\" to describe, found none");
    }
    if (const auto marker = find(*extras, kMarker)) {
      if (!marker->value.is_string() || !is_gltf_marker(text(*marker))) {
        refuse(*marker, "\"start\", \"goal\", \"waypoint\" or \"waypoint.\" and a number");
      }
      node.marker = text(*marker);
    }
    if (const auto body = find(*extras, kGltfBody)) node.body = read_gltf_body(*body);
    for (const auto& [key, flag] : {std::pair(kGltfVisual, &node.visual_only), std::pair(kGltfSolid, &node.collision_only)}) {
      const auto given = find(*extras, key);
      if (!given) continue;
      // Some exporters write checkboxes as numbers.
      const bool is_number = given->value.is_number() && (given->value == 0 || given->value == 1);
      if (!given->value.is_boolean() && !is_number) refuse(*given, "true or false");
      *flag = is_number ? given->value == 1 : given->value.get<bool>();
    }
    if (node.visual_only.value_or(false) && node.collision_only.value_or(false)) {
      fail(*extras, "expected one of visual_only and collision_only to be true, got both");
    }
  }

  GltfScene scene_of(const JsonField& field) const {
    GltfScene scene{.name = name_in(field), .nodes = indices(field, "nodes", "nodes"), .extras = {}};
    if (const auto extras = find(field, "extras")) scene.extras = read_gltf_scene_extras(*extras);
    return scene;
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
  static constexpr const char* kMarker = "marker";  // key in the extras of nodes

  JsonField root_;
  std::optional<std::string_view> chunk_;
  GltfFiles& files_;
  GltfModel out_;
  std::uint64_t total_bytes_ = 0;
  std::vector<std::uint64_t> buffer_lengths_;
  std::vector<std::array<TextureWrap, 2>> wraps_;  // by sampler
  std::vector<bool> is_sun_;
  std::size_t morphed_ = 0, lines_ = 0, lamps_ = 0, transparent_ = 0, textures_without_image_ = 0;
  std::size_t normal_maps_ = 0, occluded_ = 0, glowing_ = 0, hidden_ = 0;
};

// -------------------------------------------------------------------------------------------------------------- files

struct Glb {
  std::string_view json;
  std::optional<std::string_view> chunk;  // binary data
};

// Splits a .glb file into its chunks and checks their lengths.
Glb parts_of_glb(std::string_view bytes, const std::string& source) {
  const auto number = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 4; i-- > 0;) value = value << 8U | static_cast<unsigned char>(bytes[at + i]);
    return value;
  };
  constexpr std::size_t kHeader = 12, kChunkHeader = 8;
  require(bytes.size() >= kHeader + kChunkHeader, source, "a complete .glb file", std::to_string(bytes.size()) + " bytes");
  require(number(4) == 2, source, "glTF 2", "version " + std::to_string(number(4)));
  require(number(8) == bytes.size(), source, "a .glb file of the length in its header, " + std::to_string(number(8)) + " bytes",
          std::to_string(bytes.size()));
  Glb parts;
  constexpr std::uint32_t kJson = 0x4E4F534A, kBinary = 0x004E4942;
  for (std::size_t at = kHeader; at < bytes.size();) {
    require(bytes.size() - at >= kChunkHeader, source, "chunks up to the end of the file", "an incomplete chunk at its end");
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

// Decodes percent-encoded characters such as %20.
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

std::size_t GltfAccessor::component_bytes() const {
  switch (component) {
    case GltfComponent::int8:
    case GltfComponent::uint8:
      return 1;
    case GltfComponent::int16:
    case GltfComponent::uint16:
      return 2;
    default:
      return 4;
  }
}

std::size_t GltfAccessor::element_bytes() const {
  constexpr std::array<std::size_t, 7> kComponents{1, 2, 3, 4, 4, 9, 16};
  return kComponents[static_cast<std::size_t>(shape)] * component_bytes();
}

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
    if (!head.ends_with(kBase64)) refuse(field, "a data: URI in base64", quoted_excerpt(head));
    return count(bytes_of_base64(std::string_view(uri).substr(head.size()), field));
  }
  const std::string name = decoded(uri);
  if (name.empty() || name.find('\0') != name.npos || name.find("://") != name.npos) {
    refuse(field, "a data: URI or the path of a file", quoted_excerpt(uri));
  }
  if (files_ == MeshFiles::none) refuse(field, "a data: URI, because " + source_ + " is no file", quoted_excerpt(uri));
  const std::filesystem::path path = folder_ / name;
  if (files_ == MeshFiles::in_folder && !is_below(path, folder_)) {
    refuse(field, "a file in the folder of " + source_ + " or below it (load with meshes_anywhere=True to allow others)",
           quoted_excerpt(uri));
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
  return ModelReader(document->root(), parts.chunk, files).read();
}

}  // namespace flockstep
