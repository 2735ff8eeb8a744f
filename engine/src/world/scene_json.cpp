#include "world/scene_json.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "world/base64.hpp"
#include "world/image.hpp"
#include "world/json_document.hpp"
#include "world/mtl.hpp"
#include "world/obj.hpp"
#include "world/ply.hpp"
#include "world/scene_description.hpp"
#include "world/text_file.hpp"

namespace flockstep {
namespace {

using json::JsonField;
using OrderedJson = nlohmann::ordered_json;  // keeps the order of keys, and searches them one by one
using Vec3d = Eigen::Vector3d;               // numbers are rounded to float32 once, after all arithmetic

constexpr int kVersion = 1;

// ---------------------------------------------------------------------------------------------------------------- reading

// limit: what is written may lie a float32 step beyond the largest coordinate, or be twice as large where it is a size.
double number(const JsonField& field, double limit = kMaxCoordinate) {
  if (!field.value.is_number()) refuse(field, "a number");
  const double value = field.value.get<double>();
  if (!(std::abs(value) <= limit))
    refuse(field, limit < 1.5 * kMaxCoordinate ? "a number within +-1e+06" : "a number within +-2e+06");
  return value;
}

double positive(const JsonField& field, double limit = kMaxCoordinate) {
  const double value = number(field, limit);
  if (value <= 0.0) refuse(field, "a number > 0");
  if (value < kMinSize) refuse(field, "a number >= 1e-06");
  return value;
}

Vec3d vec3(const JsonField& field, double limit = kMaxCoordinate) {
  if (!field.value.is_array() || field.value.size() != 3) refuse(field, "an array of 3 numbers");
  return Vec3d(number(child(field, 0), limit), number(child(field, 1), limit), number(child(field, 2), limit));
}

Vec3 point(const JsonField& field) { return vec3(field).cast<float>(); }

Vec3 optional_point(const JsonField& object, std::string_view key) {
  const std::optional<JsonField> field = find(object, key);
  return field ? point(*field) : Vec3::Zero();
}

Quat optional_quaternion(const JsonField& object) {
  const std::optional<JsonField> field = find(object, "quat_wxyz");
  if (!field) return Quat::Identity();
  if (!field->value.is_array() || field->value.size() != 4) refuse(*field, "an array of 4 numbers (w, x, y, z)");
  Eigen::Vector4d wxyz;
  for (std::size_t i = 0; i < 4; ++i) wxyz[static_cast<Eigen::Index>(i)] = number(child(*field, i));
  if (!(std::abs(wxyz.norm() - 1.0) <= kQuaternionTolerance)) refuse(*field, "a quaternion (w, x, y, z) of norm 1");
  return unit_quaternion(wxyz);
}

struct Box3d {
  Vec3d min, max;
};

constexpr double kMaxSize = 2.0 * kMaxCoordinate;

Box3d min_max(const JsonField& field, bool needs_volume) {
  const Box3d box{vec3(require(field, "min"), kMaxCorner), vec3(require(field, "max"), kMaxCorner)};
  const double least = needs_volume ? 2.0 * static_cast<float>(kMinSize) : 0.0;
  if (!((box.max - box.min).array() >= least).all()) refuse(field, needs_volume ? "min < max" : "min <= max");
  return box;
}

// A number that JSON Schema calls an integer: 7 or 7.0.
std::uint16_t semantic_id(const JsonField& field) {
  constexpr double kMax = kSemanticStart - 1;
  const bool is_number = field.value.is_number();
  const double value = is_number ? field.value.get<double>() : 0.0;
  if (!(value >= 1.0 && value <= kMax && value == std::floor(value))) refuse(field, "an integer in [1, 65532]");
  return static_cast<std::uint16_t>(value);
}

float share(const JsonField& field) {
  const double value = number(field);
  if (!(value >= 0.0 && value <= 1.0)) refuse(field, "a number in [0, 1]");
  return static_cast<float>(value);
}

std::array<float, 3> color(const JsonField& field, double max, const char* expected) {
  const Vec3d rgb = vec3(field);
  if (!((rgb.array() >= 0.0).all() && (rgb.array() <= max).all())) refuse(field, expected);
  return {static_cast<float>(rgb.x()), static_cast<float>(rgb.y()), static_cast<float>(rgb.z())};
}

// The colours of a Light by their names in the file.
struct LightColor {
  const char* key;
  std::array<float, 3> Light::* color;
};
constexpr const char* kInLight = "3 numbers in [0, 100]";
constexpr std::array<LightColor, 5> kLightColors{{{"sun_color", &Light::sun_color},
                                                  {"sky_ambient", &Light::sky_ambient},
                                                  {"ground_ambient", &Light::ground_ambient},
                                                  {"zenith_color", &Light::zenith_color},
                                                  {"horizon_color", &Light::horizon_color}}};

// The key that says what the file is, and its version.
constexpr const char* kVersionKey = "flockstep_scene";
constexpr const char* kMaterialsKey = "materials";
constexpr const char* kTexturesKey = "textures";
constexpr const char* kDefault = "default";  // a material that is there without being listed
constexpr const auto& kWraps = EnumNames<TextureWrap>::kNames;

class SceneReader {
 public:
  SceneReader(const json::Document& document, std::filesystem::path base_dir, MeshFiles files)
      : root_(document.root()),
        material_names_(document.ordered_keys(kMaterialsKey)),
        texture_names_(document.ordered_keys(kTexturesKey)),
        base_dir_(std::move(base_dir)),
        files_(files) {
    scene_.materials.clear();
  }

  SceneDescription read() {
    refuse_older_name();
    check_object(root_, {kVersionKey, "$schema", "name", kTexturesKey, kMaterialsKey, "room", "pillars", "cylinders", "boxes",
                         "spheres", "capsules", "planes", "discs", "meshes", "markers", "light"});
    const JsonField version = require(root_, kVersionKey);
    if (version.value != kVersion) refuse(version, "version 1");
    if (const auto name = find(root_, "name")) {
      if (!name->value.is_string()) refuse(*name, "a string");
      scene_.name = name->value.get<std::string>();
    }
    read_textures();
    read_materials();
    if (const auto room = find(root_, "room")) read_room(*room);
    for_each("pillars", [this](const JsonField& field) { read_pillar(field); });
    for_each("cylinders", [this](const JsonField& field) { read_round(field, PrimitiveKind::cylinder); });
    for_each("boxes", [this](const JsonField& field) { read_box(field); });
    for_each("spheres", [this](const JsonField& field) { read_sphere(field); });
    for_each("capsules", [this](const JsonField& field) { read_round(field, PrimitiveKind::capsule); });
    for_each("planes", [this](const JsonField& field) { read_plane(field); });
    for_each("discs", [this](const JsonField& field) { read_disc(field); });
    read_meshes();
    if (const auto markers = find(root_, "markers")) scene_.markers = read_markers(*markers);
    if (const auto light = find(root_, "light")) scene_.light = read_light(*light);
    if (scene_.materials.empty()) scene_.materials.push_back(Material{kDefault});
    if (scene_.primitives.empty() && scene_.mesh.triangles.empty()) {
      refuse(root_, "at least one of room, pillars, cylinders, boxes, spheres, capsules, planes, discs, meshes",
             "an empty scene");
    }
    return std::move(scene_);
  }

  // What has not been read of the files that it names.
  std::vector<std::string> ignored() const {
    std::vector<std::string> all = file_materials_ ? file_materials_->ignored() : std::vector<std::string>();
    all.insert(all.end(), ignored_.begin(), ignored_.end());
    return all;
  }

 private:
  // Files written before the project had its present name.
  void refuse_older_name() const {
    if (!root_.value.is_object() || root_.value.contains(kVersionKey)) return;
    for (const auto& [key, value] : root_.value.items()) {
      if (!key.ends_with("_scene")) continue;
      fail(child(root_, key, value), std::string("expected the key \"") + kVersionKey +
                                         "\" instead (the format's name has changed, and nothing else: rename the key)");
    }
  }

  template <class Function>
  void for_each(const char* key, const Function& function) {
    const std::optional<JsonField> list = find(root_, key);
    if (!list) return;
    const std::size_t count = require_array(*list, "an array").size();
    for (std::size_t i = 0; i < count; ++i) {
      Interrupt::poll();
      function(child(*list, i));
    }
  }

  void read_textures() {
    const std::optional<JsonField> textures = find(root_, kTexturesKey);
    if (!textures) return;
    if (!textures->value.is_object()) refuse(*textures, "an object");
    if (textures->value.size() > kMaxTextures) refuse(*textures, "at most 65536 textures", textures->value.size());
    for (const std::string& name : texture_names_) {
      const JsonField field = require(*textures, name);
      check_object(field, {"file", "png_base64", "wrap"});
      if (field.value.contains("file") == field.value.contains("png_base64")) {
        fail(field, "expected either \"file\" or \"png_base64\"");
      }
      Image image =
          field.value.contains("file") ? read_image_file(require(field, "file")) : read_image(require(field, "png_base64"));
      pixels_left_ -= image.rgba.size() / 4;
      Texture texture{name, image.width_px, image.height_px, std::move(image.rgba)};
      if (const auto wrap = find(field, "wrap")) texture.wrap = read_wrap(*wrap);
      texture_index_.emplace(name, static_cast<std::uint16_t>(scene_.textures.size()));
      scene_.textures.push_back(std::move(texture));
    }
  }

  Image read_image(const JsonField& field) const {
    if (!field.value.is_string()) refuse(field, "a PNG file in base64");
    const std::string bytes = bytes_of_base64(field.value.get_ref<const std::string&>(), json::name_of(field));
    return decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, json::name_of(field), pixels_left_);
  }

  Image read_image_file(const JsonField& file) const {
    const std::filesystem::path path = path_of(file, "the path of a PNG or JPEG file");
    try {
      const std::string bytes = read_text_file(path, "an image");
      return decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path.string(), pixels_left_);
    } catch (const std::invalid_argument& error) {
      fail(file, error.what());
    }
  }

  static std::array<TextureWrap, 2> read_wrap(const JsonField& field) {
    if (!field.value.is_array() || field.value.size() != 2) refuse(field, "an array of 2 names (across, down)");
    std::array<TextureWrap, 2> wrap{};
    for (std::size_t i = 0; i < 2; ++i) {
      const JsonField name = child(field, i);
      const auto found = std::find_if(kWraps.begin(), kWraps.end(), [&](const char* known) { return name.value == known; });
      if (found == kWraps.end()) refuse(name, "\"repeat\", \"mirror\" or \"clamp\"");
      wrap[i] = static_cast<TextureWrap>(found - kWraps.begin());
    }
    return wrap;
  }

  // Of a file that the scene names.
  std::filesystem::path path_of(const JsonField& file, const char* expected) const {
    if (!file.value.is_string()) refuse(file, expected);
    std::filesystem::path path = base_dir_ / file.value.get<std::string>();
    if (files_ == MeshFiles::in_folder && !is_below(path, base_dir_)) {
      fail(file, "expected a file in the scene's folder or below it (load with meshes_anywhere=True to allow others), got " +
                     json::excerpt_of(file.value));
    }
    return path;
  }

  void read_materials() {
    const std::optional<JsonField> materials = find(root_, "materials");
    if (!materials) return;
    if (!materials->value.is_object()) refuse(*materials, "an object");
    if (materials->value.size() > kMaxMaterials) refuse(*materials, "fewer than 65533 materials", materials->value.size());
    for (const std::string& name : material_names_) {
      const JsonField field = require(*materials, name);
      check_object(field, {"base_color", "semantic", "texture", "emissive", "alpha_cutoff"});
      Material material{name};
      material.base_color = color(require(field, "base_color"), 1.0, "3 numbers in [0, 1]");
      if (const auto semantic = find(field, "semantic")) material.semantic = semantic_id(*semantic);
      if (const auto texture = find(field, "texture")) material.texture = named_texture(*texture);
      if (const auto emissive = find(field, "emissive")) material.emissive = color(*emissive, kMaxLightColor, kInLight);
      if (const auto cutoff = find(field, "alpha_cutoff")) material.alpha_cutoff = share(*cutoff);
      add_material(std::move(material));
    }
  }

  std::uint16_t named_texture(const JsonField& field) {
    if (!field.value.is_string()) refuse(field, "the name of a texture");
    const auto found = texture_index_.find(field.value.get_ref<const std::string&>());
    if (found == texture_index_.end()) refuse(field, "a name listed in /textures");
    has_textured_material_ = true;
    return found->second;
  }

  std::uint16_t add_material(Material material) {
    const auto index = static_cast<std::uint16_t>(scene_.materials.size());
    material_index_.emplace(material.name, index);
    scene_.materials.push_back(std::move(material));
    return index;
  }

  std::uint16_t named_material(const JsonField& field) const {
    if (!field.value.is_string()) refuse(field, "the name of a material");
    const auto found = material_index_.find(field.value.get_ref<const std::string&>());
    if (found == material_index_.end()) refuse(field, "a name listed in /materials");
    return found->second;
  }

  std::uint16_t default_material(const JsonField& object) {
    const auto found = material_index_.find(kDefault);
    if (found != material_index_.end()) return found->second;
    if (scene_.materials.size() == kMaxMaterials) {
      fail(object, "expected a field \"material\" (/materials leaves no room for \"default\"), found none");
    }
    return add_material(Material{kDefault});
  }

  std::uint16_t read_material(const JsonField& object) {
    const std::optional<JsonField> field = find(object, "material");
    return field ? named_material(*field) : default_material(object);
  }

  static Presence read_presence(const JsonField& field) {
    const auto flag = [&](const char* key) {
      const std::optional<JsonField> given = find(field, key);
      if (given && !given->value.is_boolean()) refuse(*given, "true or false");
      return !given || given->value.get<bool>();
    };
    const bool is_visible = flag("visible"), is_solid = flag("solid");
    if (!is_visible && !is_solid) fail(field, "expected one of \"visible\" and \"solid\" to be true, got neither");
    return is_visible && is_solid ? Presence::full : (is_visible ? Presence::visual : Presence::solid);
  }

  void read_room(const JsonField& field) {
    check_object(field, {"min", "max", "material"});
    room_ = min_max(field, true);
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::room,
                                          .center = ((room_->min + room_->max) / 2.0).cast<float>(),
                                          .half_extents = ((room_->max - room_->min) / 2.0).cast<float>(),
                                          .material = read_material(field)});
  }

  // A vertical cylinder that stands on the floor of the room and reaches its ceiling, unless z says otherwise.
  void read_pillar(const JsonField& field) {
    check_object(field, {"center", "radius", "z", "material", "visible", "solid"});
    const JsonField center = require(field, "center");
    if (!center.value.is_array() || center.value.size() != 2) refuse(center, "an array of 2 numbers (x, y)");
    const double x = number(child(center, 0));
    const double y = number(child(center, 1));
    const float radius = static_cast<float>(positive(require(field, "radius")));
    double low = 0.0;
    double high = 0.0;
    if (const auto z = find(field, "z")) {
      if (!z->value.is_array() || z->value.size() != 2) refuse(*z, "an array of 2 numbers (low, high)");
      low = number(child(*z, 0));
      high = number(child(*z, 1));
      if (!(high - low >= 2.0 * kMinSize)) refuse(*z, "low < high");
    } else if (room_) {
      low = room_->min.z();
      high = room_->max.z();
    } else {
      fail(field, "expected a field \"z\" (the scene has no room to take the height from), found none");
    }
    const float half_height = static_cast<float>((high - low) / 2.0);
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::cylinder,
                                          .center = Vec3d(x, y, (low + high) / 2.0).cast<float>(),
                                          .half_extents = Vec3(radius, radius, half_height),
                                          .material = read_material(field),
                                          .presence = read_presence(field)});
  }

  // A cylinder, or a capsule, whose height includes its round caps.
  void read_round(const JsonField& field, PrimitiveKind kind) {
    check_object(field, {"center", "radius", "height", "quat_wxyz", "material", "visible", "solid"});
    const float radius = static_cast<float>(positive(require(field, "radius")));
    const JsonField height = require(field, "height");
    const float half_height = half_size(height, positive(height, kMaxSize));
    if (kind == PrimitiveKind::capsule && half_height < radius) refuse(height, "a number >= twice the radius");
    scene_.primitives.push_back(Primitive{.kind = kind,
                                          .center = point(require(field, "center")),
                                          .rotation = optional_quaternion(field),
                                          .half_extents = Vec3(radius, radius, half_height),
                                          .material = read_material(field),
                                          .presence = read_presence(field)});
  }

  void read_box(const JsonField& field) {
    check_object(field, {"center", "size", "quat_wxyz", "material", "visible", "solid"});
    const JsonField size = require(field, "size");
    Vec3 half_extents = vec3(size, kMaxSize).cast<float>();
    for (std::size_t i = 0; i < 3; ++i) {
      const JsonField side = child(size, i);
      half_extents[static_cast<Eigen::Index>(i)] = half_size(side, positive(side, kMaxSize));
    }
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::box,
                                          .center = point(require(field, "center")),
                                          .rotation = optional_quaternion(field),
                                          .half_extents = half_extents,
                                          .material = read_material(field),
                                          .presence = read_presence(field)});
  }

  void read_sphere(const JsonField& field) {
    check_object(field, {"center", "radius", "material", "visible", "solid"});
    const float radius = static_cast<float>(positive(require(field, "radius")));
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::sphere,
                                          .center = point(require(field, "center")),
                                          .half_extents = Vec3::Constant(radius),
                                          .material = read_material(field),
                                          .presence = read_presence(field)});
  }

  void read_plane(const JsonField& field) {
    check_object(field, {"center", "size", "quat_wxyz", "material", "visible", "solid"});
    const JsonField size = require(field, "size");
    if (!size.value.is_array() || size.value.size() != 2) refuse(size, "an array of 2 numbers (along local x, y)");
    const JsonField x = child(size, 0);
    const JsonField y = child(size, 1);
    scene_.primitives.push_back(
        Primitive{.kind = PrimitiveKind::plane,
                  .center = point(require(field, "center")),
                  .rotation = optional_quaternion(field),
                  .half_extents = Vec3(half_size(x, positive(x, kMaxSize)), half_size(y, positive(y, kMaxSize)), 0.0F),
                  .material = read_material(field),
                  .presence = read_presence(field)});
  }

  void read_disc(const JsonField& field) {
    check_object(field, {"center", "radius", "quat_wxyz", "material", "visible", "solid"});
    const float radius = static_cast<float>(positive(require(field, "radius")));
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::disc,
                                          .center = point(require(field, "center")),
                                          .rotation = optional_quaternion(field),
                                          .half_extents = Vec3(radius, radius, 0.0F),
                                          .material = read_material(field),
                                          .presence = read_presence(field)});
  }

  static float half_size(const JsonField& field, double size) {
    if (size < 2.0 * kMinSize) refuse(field, "a number >= 2e-06");
    return static_cast<float>(size / 2.0);
  }

  void read_meshes() {
    const std::optional<JsonField> meshes = find(root_, "meshes");
    if (!meshes) return;
    const std::size_t count = require_array(*meshes, "an array").size();
    if (count > kMaxObjects) refuse(*meshes, "at most 65536 meshes", count);
    for (std::size_t i = 0; i < count; ++i) read_mesh(child(*meshes, i), static_cast<std::uint16_t>(i));
  }

  // Appends a mesh, from a file or given inline, scaled, then rotated, then moved.
  void read_mesh(const JsonField& field, std::uint16_t object) {
    check_object(field, {"file", "vertices", "triangles", "uv", "colors", "position", "quat_wxyz", "scale", "material", "visible",
                         "solid"});
    const bool has_file = field.value.contains("file");
    const auto is_inline = [&](const char* key) { return field.value.contains(key); };
    if (has_file == (is_inline("vertices") || is_inline("triangles") || is_inline("uv") || is_inline("colors"))) {
      fail(field, "expected either \"file\" or \"vertices\" and \"triangles\"");
    }
    const TriangleMesh part = has_file ? read_mesh_file(field) : read_inline_mesh(field);
    const Quat rotation = optional_quaternion(field);
    const Vec3 position = optional_point(field, "position");
    const auto scale_field = find(field, "scale");
    const float scale = scale_field ? static_cast<float>(positive(*scale_field)) : 1.0F;

    TriangleMesh& mesh = scene_.mesh;
    const auto first_vertex = static_cast<std::int32_t>(mesh.vertices.size());
    const bool is_placed = scale_field || field.value.contains("quat_wxyz") || field.value.contains("position");
    for (const Vec3& vertex : part.vertices) {
      const Vec3 placed = is_placed ? Vec3(rotation * (vertex * scale) + position) : vertex;
      if (!(placed.cwiseAbs().maxCoeff() <= static_cast<float>(kMaxCoordinate))) {
        fail(field, "expected all vertices within +-1e+06 m of the origin");
      }
      mesh.vertices.push_back(placed);
    }
    for (std::size_t i = 0; i < part.triangles.size(); ++i) {
      std::array<std::int32_t, 3> triangle = part.triangles[i];
      for (std::int32_t& index : triangle) index += first_vertex;
      const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
      if (is_degenerate(corner(0), corner(1), corner(2))) {
        const JsonField at = has_file ? require(field, "file") : child(require(field, "triangles"), i);
        const std::string where = has_file ? " (triangle " + std::to_string(i) + " of the file)" : "";
        refuse(at, "a triangle with an area", "a degenerate one" + where);
      }
      mesh.triangles.push_back(triangle);
    }
    if (!part.uv.empty()) {  // which begin with this part, or go on with it: parts before it may have had none
      mesh.uv.resize(static_cast<std::size_t>(first_vertex));
      mesh.uv.insert(mesh.uv.end(), part.uv.begin(), part.uv.end());
    } else if (!mesh.uv.empty()) {
      mesh.uv.resize(mesh.vertices.size());
    }
    append_colors(part.colors, part.vertices.size(), mesh);
    mesh.objects.insert(mesh.objects.end(), part.triangles.size(), object);
    mesh.presence.resize(object, Presence::full);
    mesh.presence.push_back(read_presence(field));
    if (part.materials.empty()) {
      read_mesh_materials(field, part.triangles.size());
    } else {
      mesh.materials.insert(mesh.materials.end(), part.materials.begin(), part.materials.end());
    }
  }

  // materials: of the scene, where the mesh names none; else there are none.
  TriangleMesh read_mesh_file(const JsonField& field) {
    const JsonField file = require(field, "file");
    const std::filesystem::path path = path_of(file, "the path of an OBJ or PLY file");
    const bool has_own = !field.value.contains("material");
    try {
      if (extension_of(path) == ".ply") {
        PlyMesh read = load_ply(path);
        note_ignored(read.ignored, path);
        return std::move(read.mesh);
      }
      std::vector<std::uint16_t> numbers;
      ObjMesh read = load_obj(path, [&](const ObjNames& names) {
        if (has_own) numbers = materials_of(names, path, field);
        const auto is_textured = [this](std::uint16_t number) { return scene_.materials[number].texture.has_value(); };
        return has_textured_material_ || std::any_of(numbers.begin(), numbers.end(), is_textured);
      });
      note_ignored(read.ignored, path);
      for (std::uint16_t& material : read.mesh.materials) material = has_own ? numbers[material] : 0;
      if (!has_own) read.mesh.materials.clear();
      return std::move(read.mesh);
    } catch (const std::invalid_argument& error) {
      fail(file, error.what());
    }
  }

  void note_ignored(const std::vector<std::string>& ignored, const std::filesystem::path& path) {
    for (const std::string& what : ignored) ignored_.push_back(what + " of " + excerpt(path.filename().string()));
  }

  std::vector<std::uint16_t> materials_of(const ObjNames& names, const std::filesystem::path& path, const JsonField& field) {
    if (!file_materials_) {
      const bool has_default = material_index_.contains(kDefault);
      file_materials_.emplace(scene_, base_dir_, files_);
      if (!has_default) file_materials_->take(kDefault);
    }
    return file_materials_->numbers(names, path, [&] { return default_material(field); }, pixels_left_);
  }

  static TriangleMesh read_inline_mesh(const JsonField& field) {
    TriangleMesh mesh;
    const JsonField vertices = require(field, "vertices");
    const JsonField triangles = require(field, "triangles");
    const std::size_t num_vertices = require_array(vertices, "an array of (x, y, z)").size();
    for (std::size_t i = 0; i < num_vertices; ++i) {
      Interrupt::poll();
      mesh.vertices.push_back(point(child(vertices, i)));
    }
    const std::size_t num_triangles = require_array(triangles, "an array of vertex index triples").size();
    for (std::size_t i = 0; i < num_triangles; ++i) {
      Interrupt::poll();
      const JsonField triangle = child(triangles, i);
      if (!triangle.value.is_array() || triangle.value.size() != 3) refuse(triangle, "an array of 3 vertex indices");
      std::array<std::int32_t, 3> indices{};
      for (std::size_t k = 0; k < 3; ++k) {
        const JsonField index = child(triangle, k);
        const bool in_range = index.value.is_number_unsigned() && index.value.get<std::uint64_t>() < num_vertices;
        if (!in_range) refuse(index, "a vertex index in [0, " + std::to_string(num_vertices) + ')');
        indices[k] = index.value.get<std::int32_t>();
      }
      mesh.triangles.push_back(indices);
    }
    if (const auto uv = find(field, "uv")) {
      const std::size_t count = require_array(*uv, "an array of (u, v)").size();
      if (count != num_vertices) refuse(*uv, "one per vertex (" + std::to_string(num_vertices) + ')', count);
      for (std::size_t i = 0; i < count; ++i) {
        Interrupt::poll();
        const JsonField pair = child(*uv, i);
        if (!pair.value.is_array() || pair.value.size() != 2) refuse(pair, "an array of 2 numbers (u, v)");
        mesh.uv.push_back({static_cast<float>(number(child(pair, 0))), static_cast<float>(number(child(pair, 1)))});
      }
    }
    if (const auto colors = find(field, "colors")) {
      const std::size_t count = require_array(*colors, "an array of (r, g, b)").size();
      if (count != num_vertices) refuse(*colors, "one per vertex (" + std::to_string(num_vertices) + ')', count);
      for (std::size_t i = 0; i < count; ++i) {
        Interrupt::poll();
        mesh.colors.push_back(color(child(*colors, i), 1.0, "3 numbers in [0, 1]"));
      }
    }
    return mesh;
  }

  // "material" is one name for the whole mesh, or an array with a name per triangle.
  void read_mesh_materials(const JsonField& field, std::size_t num_triangles) {
    std::vector<std::uint16_t>& materials = scene_.mesh.materials;
    const std::optional<JsonField> material = find(field, "material");
    if (!material || !material->value.is_array()) {
      materials.insert(materials.end(), num_triangles, read_material(field));
      return;
    }
    if (material->value.size() != num_triangles) {
      refuse(*material, "one name, or one per triangle (" + std::to_string(num_triangles) + ')', material->value.size());
    }
    for (std::size_t i = 0; i < num_triangles; ++i) materials.push_back(named_material(child(*material, i)));
  }

  JsonField root_;
  std::span<const std::string> material_names_, texture_names_;  // in the order of the file
  std::filesystem::path base_dir_;
  MeshFiles files_;
  std::unordered_map<std::string, std::uint16_t> material_index_;
  std::unordered_map<std::string, std::uint16_t> texture_index_;
  bool has_textured_material_ = false;
  std::size_t pixels_left_ = kMaxScenePixels;
  std::optional<Box3d> room_;
  SceneDescription scene_;
  std::optional<ObjMaterials> file_materials_;
  std::vector<std::string> ignored_;
};

// ---------------------------------------------------------------------------------------------------------------- writing

OrderedJson numbers(const Vec3d& v) {
  return OrderedJson::array({json::shortest(v.x()), json::shortest(v.y()), json::shortest(v.z())});
}

OrderedJson numbers(const Vec3& v) { return numbers(Vec3d(v.cast<double>())); }

OrderedJson numbers(const std::array<float, 3>& v) { return numbers(Vec3(v[0], v[1], v[2])); }

// As text, since an object of OrderedJson with many keys takes their number squared to build.
std::string write_materials(const SceneDescription& description) {
  std::string text = "{";
  for (const Material& material : description.materials) {
    OrderedJson object = {{"base_color", numbers(material.base_color)}};
    if (material.semantic != 0) object["semantic"] = material.semantic;
    if (material.texture) object["texture"] = description.textures[*material.texture].name;
    if (material.emissive != Material().emissive) object["emissive"] = numbers(material.emissive);
    if (material.alpha_cutoff != 0.0F) object["alpha_cutoff"] = json::shortest(material.alpha_cutoff);
    text += (text.size() > 1 ? "," : "") + OrderedJson(material.name).dump() + ':' + object.dump();
  }
  return text + '}';
}

std::string write_textures(const std::vector<Texture>& textures) {
  std::string text = "{";
  for (const Texture& texture : textures) {
    OrderedJson object = {{"png_base64", base64_of(encode_png(texture.width_px, texture.height_px, texture.rgba))}};
    if (texture.wrap != Texture().wrap) {
      object["wrap"] = {kWraps[static_cast<std::size_t>(texture.wrap[0])], kWraps[static_cast<std::size_t>(texture.wrap[1])]};
    }
    text += (text.size() > 1 ? "," : "") + OrderedJson(texture.name).dump() + ':' + object.dump();
  }
  return text + '}';
}

// Halves of sums and differences of the corners must give the room's centre and half extents again: their digits are cut short
// only if they still do.
OrderedJson write_room(const Primitive& room, const std::string& material) {
  const Vec3d center = room.center.cast<double>();
  const Vec3d half = room.half_extents.cast<double>();
  OrderedJson min = OrderedJson::array();
  OrderedJson max = OrderedJson::array();
  for (int axis = 0; axis < 3; ++axis) {
    const double low = center[axis] - half[axis];
    const double high = center[axis] + half[axis];
    const double short_low = json::shortest(low);
    const double short_high = json::shortest(high);
    const bool same = static_cast<float>((short_low + short_high) / 2.0) == room.center[axis] &&
                      static_cast<float>((short_high - short_low) / 2.0) == room.half_extents[axis];
    min.push_back(same ? short_low : low);
    max.push_back(same ? short_high : high);
  }
  return {{"min", min}, {"max", max}, {"material", material}};
}

void write_rotation(OrderedJson& object, const Quat& q) {
  if (q.w() == 1.0F && q.vec().isZero(0.0F)) return;
  object["quat_wxyz"] =
      OrderedJson::array({json::shortest(q.w()), json::shortest(q.x()), json::shortest(q.y()), json::shortest(q.z())});
}

void write_presence(OrderedJson& object, Presence presence) {
  if (!is_visible(presence)) object["visible"] = false;
  if (!is_solid(presence)) object["solid"] = false;
}

void write_primitive(OrderedJson& document, const Primitive& primitive, const std::string& material) {
  const Vec3d center = primitive.center.cast<double>();
  const Vec3d half = primitive.half_extents.cast<double>();
  OrderedJson object;
  switch (primitive.kind) {
    case PrimitiveKind::room:
      document["room"] = write_room(primitive, material);
      return;
    case PrimitiveKind::box:
      object = {{"center", numbers(center)}, {"size", numbers(Vec3d(2.0 * half))}};
      write_rotation(object, primitive.rotation);
      break;
    case PrimitiveKind::cylinder:
    case PrimitiveKind::capsule:
      object = {{"center", numbers(center)}, {"radius", json::shortest(half.x())}, {"height", json::shortest(2.0 * half.z())}};
      write_rotation(object, primitive.rotation);
      break;
    case PrimitiveKind::sphere:
      object = {{"center", numbers(center)}, {"radius", json::shortest(half.x())}};
      break;
    case PrimitiveKind::plane:
      object = {{"center", numbers(center)}, {"size", {json::shortest(2.0 * half.x()), json::shortest(2.0 * half.y())}}};
      write_rotation(object, primitive.rotation);
      break;
    case PrimitiveKind::disc:
      object = {{"center", numbers(center)}, {"radius", json::shortest(half.x())}};
      write_rotation(object, primitive.rotation);
      break;
  }
  object["material"] = material;
  write_presence(object, primitive.presence);
  constexpr const char* kLists[] = {"room", "boxes", "cylinders", "spheres", "capsules", "planes", "discs"};
  document[kLists[static_cast<std::size_t>(primitive.kind)]].push_back(std::move(object));
}

// The triangles [first, last), whose vertices are [first_vertex, last_vertex).
OrderedJson write_mesh(const TriangleMesh& mesh, std::size_t first, std::size_t last, std::size_t first_vertex,
                       std::size_t last_vertex, const std::vector<Material>& materials) {
  OrderedJson object = {
      {"vertices", OrderedJson::array()}, {"triangles", OrderedJson::array()}, {"material", OrderedJson::array()}};
  for (std::size_t i = first_vertex; i < last_vertex; ++i) object["vertices"].push_back(numbers(mesh.vertices[i]));
  if (!mesh.uv.empty() && first != last) {
    OrderedJson& uv = object["uv"] = OrderedJson::array();
    for (std::size_t i = first_vertex; i < last_vertex; ++i) {
      uv.push_back(OrderedJson::array({json::shortest(mesh.uv[i][0]), json::shortest(mesh.uv[i][1])}));
    }
  }
  // Of a mesh of its own colours; those that are white have none.
  const auto is_white = [](const std::array<float, 3>& color) { return color == std::array{1.0F, 1.0F, 1.0F}; };
  const auto colors = std::span(mesh.colors)
                          .subspan(mesh.colors.empty() ? 0 : first_vertex, mesh.colors.empty() ? 0 : last_vertex - first_vertex);
  if (!std::all_of(colors.begin(), colors.end(), is_white)) {
    OrderedJson& written = object["colors"] = OrderedJson::array();
    for (const std::array<float, 3>& color : colors) written.push_back(numbers(color));
  }
  bool is_of_one_material = first != last;
  for (std::size_t i = first; i < last; ++i) {
    std::array<std::int32_t, 3> triangle = mesh.triangles[i];
    for (std::int32_t& index : triangle) index -= static_cast<std::int32_t>(first_vertex);
    object["triangles"].push_back(triangle);
    is_of_one_material &= mesh.materials[i] == mesh.materials[first];
  }
  if (is_of_one_material) {
    object["material"] = materials[mesh.materials[first]].name;
  } else {
    for (std::size_t i = first; i < last; ++i) object["material"].push_back(materials[mesh.materials[i]].name);
  }
  if (first != last) write_presence(object, mesh.presence_of(first));
  return object;
}

// One for each object; their triangles, and the vertices of these, lie one after another.
OrderedJson write_meshes(const TriangleMesh& mesh, const std::vector<Material>& materials) {
  OrderedJson meshes = OrderedJson::array();
  std::size_t first = 0;
  std::size_t first_vertex = 0;
  for (unsigned object = 0; first < mesh.triangles.size(); ++object) {
    std::size_t last = first;
    std::size_t last_vertex = first_vertex;
    for (; last < mesh.triangles.size() && mesh.objects[last] == object; ++last) {
      for (const std::int32_t index : mesh.triangles[last]) {
        last_vertex = std::max(last_vertex, static_cast<std::size_t>(index) + 1);
      }
    }
    meshes.push_back(write_mesh(mesh, first, last, first_vertex, last_vertex, materials));
    first = last;
    first_vertex = last_vertex;
  }
  return meshes;
}

// One line per top-level field, and per element where a field is a list of objects.
std::string format(const OrderedJson& document, const SceneDescription& description) {
  std::string text = "{";
  const char* separator = "\n";
  for (const auto& [key, value] : document.items()) {
    text += separator + ("  " + OrderedJson(key).dump() + ": ");
    separator = ",\n";
    if (key == kMaterialsKey || key == kTexturesKey) {
      text += key == kMaterialsKey ? write_materials(description) : write_textures(description.textures);
      continue;
    }
    if (!value.is_array()) {
      text += value.dump();
      continue;
    }
    const char* element_separator = "[\n";
    for (const OrderedJson& element : value) {
      text += element_separator + ("    " + element.dump());
      element_separator = ",\n";
    }
    text += "\n  ]";
  }
  return text + "\n}\n";
}

}  // namespace

Markers read_markers(const JsonField& field) {
  check_object(field, {"radius", "start", "waypoints", "goal", "spawn_box"});
  Markers markers;
  if (const auto radius = find(field, "radius")) markers.radius = static_cast<float>(positive(*radius));
  if (const auto start = find(field, "start")) markers.start = point(*start);
  if (const auto goal = find(field, "goal")) markers.goal = point(*goal);
  if (const auto waypoints = find(field, "waypoints")) {
    const std::size_t count = require_array(*waypoints, "an array of (x, y, z)").size();
    for (std::size_t i = 0; i < count; ++i) markers.waypoints.push_back(point(child(*waypoints, i)));
  }
  if (const auto spawn_box = find(field, "spawn_box")) {
    check_object(*spawn_box, {"min", "max"});
    const Box3d box = min_max(*spawn_box, false);
    markers.spawn_box = Aabb{box.min.cast<float>(), box.max.cast<float>()};
  }
  return markers;
}

Light read_light(const JsonField& field) {
  check_object(field, {"sun_direction", "sun_color", "sky_ambient", "ground_ambient", "zenith_color", "horizon_color", "gamma",
                       "sun_radius_deg", "sun_glow"});
  Light light;
  if (const auto sun_direction = find(field, "sun_direction")) {
    const Vec3d given = vec3(*sun_direction);
    if (given.isZero(0.0)) refuse(*sun_direction, "a direction that is not 0");
    const Vec3 direction = unit_direction(given);
    light.sun_direction = {direction.x(), direction.y(), direction.z()};
  }
  for (const auto& [key, member] : kLightColors) {
    if (const auto given = find(field, key)) light.*member = color(*given, kMaxLightColor, "3 numbers in [0, 100]");
  }
  if (const auto gamma = find(field, "gamma")) {
    const double value = number(*gamma);
    if (!(value >= kMinGamma && value <= kMaxGamma)) refuse(*gamma, "a number in [1, 4]");
    light.gamma = static_cast<float>(value);
  }
  if (const auto radius = find(field, "sun_radius_deg")) {
    const double value = number(*radius);
    const bool is_radius = value == 0.0 || (value >= kMinSunRadiusDeg && value <= kMaxSunRadiusDeg);
    if (!is_radius) refuse(*radius, "0 or a number in [0.1, 45]");
    light.sun_radius_deg = static_cast<float>(value);
  }
  if (const auto glow = find(field, "sun_glow")) light.sun_glow = share(*glow);
  return light;
}

OrderedJson write_markers(const Markers& markers) {
  OrderedJson object = {{"radius", json::shortest(markers.radius)}};
  if (markers.start) object["start"] = numbers(*markers.start);
  if (!markers.waypoints.empty()) {
    OrderedJson& waypoints = object["waypoints"] = OrderedJson::array();
    for (const Vec3& waypoint : markers.waypoints) waypoints.push_back(numbers(waypoint));
  }
  if (markers.goal) object["goal"] = numbers(*markers.goal);
  if (markers.spawn_box) {
    object["spawn_box"] = {{"min", numbers(markers.spawn_box->min)}, {"max", numbers(markers.spawn_box->max)}};
  }
  return object;
}

OrderedJson write_light(const Light& light) {
  const Light usual;
  OrderedJson object = OrderedJson::object();
  if (light.sun_direction != usual.sun_direction) object["sun_direction"] = numbers(light.sun_direction);
  for (const auto& [key, member] : kLightColors) {
    if (light.*member != usual.*member) object[key] = numbers(light.*member);
  }
  if (light.gamma != usual.gamma) object["gamma"] = json::shortest(light.gamma);
  if (light.sun_radius_deg != usual.sun_radius_deg) object["sun_radius_deg"] = json::shortest(light.sun_radius_deg);
  if (light.sun_glow != usual.sun_glow) object["sun_glow"] = json::shortest(light.sun_glow);
  return object;
}

SceneDescription parse_scene(const std::string& text, const std::string& source, const std::filesystem::path& base_dir,
                             MeshFiles files, std::vector<std::string>* ignored) {
  const auto document = json::Document::parse(text, source, {kMaterialsKey, kTexturesKey});
  SceneReader reader(*document, base_dir, files);
  SceneDescription scene = reader.read();
  if (ignored != nullptr) *ignored = reader.ignored();
  return scene;
}

std::string write_scene(const SceneDescription& description) {
  OrderedJson document = {{kVersionKey, kVersion}, {"name", description.name}};
  if (!description.textures.empty()) document[kTexturesKey] = nullptr;
  document[kMaterialsKey] = nullptr;
  for (const Primitive& primitive : description.primitives) {
    write_primitive(document, primitive, description.materials[primitive.material].name);
  }
  if (!description.mesh.triangles.empty()) document["meshes"] = write_meshes(description.mesh, description.materials);
  document["markers"] = write_markers(description.markers);
  if (OrderedJson light = write_light(description.light); !light.empty()) document["light"] = std::move(light);
  return format(document, description);
}

}  // namespace flockstep
