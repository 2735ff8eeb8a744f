#include "formats/scene_json.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "formats/image.hpp"
#include "formats/mesh_files.hpp"
#include "formats/scene_values.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {
namespace {

using json::JsonField;

constexpr const char* kDefault = "default";  // material that exists without being listed

// Throws for a name that is not a key of the index, and suggests the nearest key. Comparing very many keys would take too long.
[[noreturn]] void refuse_name(const JsonField& field, const std::string& expected,
                              const std::unordered_map<std::string, std::uint16_t>& index) {
  constexpr std::size_t kMaxCompared = 1000;
  std::vector<std::string_view> known;
  for (const auto& [name, number] : index) known.push_back(name);
  if (known.size() > kMaxCompared) known.clear();
  refuse(field, expected, json::excerpt_of(field.value) + did_you_mean(field.value.get_ref<const std::string&>(), known));
}

Vec3d vec3(const keys::Numbers<3>& numbers) { return {numbers[0], numbers[1], numbers[2]}; }
Vec3 point(const keys::Numbers<3>& numbers) { return vec3(numbers).cast<float>(); }

Quat rotation_of(const JsonField& object, const keys::Solid& solid) {
  if (!solid.quat_wxyz) return Quat::Identity();
  const Eigen::Vector4d wxyz(solid.quat_wxyz->data());
  if (!(std::abs(wxyz.norm() - 1.0) <= kQuaternionTolerance)) {
    refuse(require(object, keys::kRotation.name), "a quaternion (w, x, y, z) of norm 1");
  }
  return unit_quaternion(wxyz);
}

Visibility visibility_of(const JsonField& object, const keys::Solid& given) {
  if (!given.visible && !given.solid) fail(object, "expected one of \"visible\" and \"solid\" to be true, got neither");
  return given.visible && given.solid ? Visibility::full : (given.visible ? Visibility::visual : Visibility::solid);
}

struct Box3d {
  Vec3d min, max;
};

// Each side must have at least the given length.
Box3d box_of(const JsonField& object, const keys::Required<keys::Numbers<3>>& min, const keys::Required<keys::Numbers<3>>& max,
             double least_side) {
  const Box3d box{vec3(*min.value), vec3(*max.value)};
  if (!((box.max - box.min).array() >= least_side).all()) refuse(object, least_side > 0.0 ? "min < max" : "min <= max");
  return box;
}

Markers markers_of(const JsonField& field, const keys::Markers& given) {
  Markers markers{.radius = given.radius};
  if (given.start) markers.start = point(*given.start);
  if (given.goal) markers.goal = point(*given.goal);
  for (const auto& waypoint : given.waypoints) markers.waypoints.push_back(point(waypoint));
  if (given.spawn_box) {
    const Box3d box = box_of(require(field, "spawn_box"), given.spawn_box->min, given.spawn_box->max, 0.0);
    markers.spawn_box = Aabb{box.min.cast<float>(), box.max.cast<float>()};
  }
  return markers;
}

// Returns the light with the direction of the file, which has more digits than float32, as a unit vector.
Light exact(const JsonField& field, Light light) {
  if (const auto given = find(field, "sun_direction")) {
    Vec3::Map(light.sun_direction.data()) = unit_direction(vec3(given->value.get<keys::Numbers<3>>()));
  }
  return light;
}

TriangleMesh inline_mesh_of(const JsonField& field, const keys::Mesh& given) {
  TriangleMesh mesh;
  for (const auto& vertex : *given.vertices.value) mesh.vertices.push_back(point(vertex));
  const std::size_t num_vertices = mesh.vertices.size();
  for (std::size_t i = 0; i < given.triangles.value->size(); ++i) {
    std::array<std::int32_t, 3>& triangle = mesh.triangles.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      triangle[k] = (*given.triangles.value)[i][k].value;
      if (triangle[k] >= 0 && static_cast<std::size_t>(triangle[k]) < num_vertices) continue;
      refuse(child(child(require(field, "triangles"), i), k), "a vertex index in [0, " + std::to_string(num_vertices) + ')');
    }
  }
  const auto take = [&](const char* name, const auto& values, auto& to) {
    if (!values) return;
    if (values->size() != num_vertices) {
      refuse(require(field, name), "one per vertex (" + std::to_string(num_vertices) + ')', values->size());
    }
    to = *values;
  };
  take("uv", given.uv.value, mesh.uv);
  take("colors", given.colors.value, mesh.colors);
  return mesh;
}

class SceneReader {
 public:
  SceneReader(const json::Document& document, std::filesystem::path base_dir, MeshFiles files)
      : document_(document), root_(document.root()), base_dir_(std::move(base_dir)), files_(files) {
    scene_.materials.clear();
  }

  SceneDescription read() {
    refuse_older_name();
    check_version(root_, keys::kVersionName, kSceneVersion);
    if (root_.value.is_object() && !find(root_, keys::kVersionName)) {
      fail(root_, "expected a field \"flockstep_scene\", found none: add \"flockstep_scene\": " + std::to_string(kSceneVersion));
    }
    check_keys<keys::Scene>(root_);
    for_each_key<keys::Scene>([&](const auto& key) {
      if (const auto field = find(root_, key.name)) read_top(*field, key);
    });
    if (scene_.materials.empty()) scene_.materials.push_back(Material{kDefault});
    if (scene_.primitives.empty() && scene_.mesh.triangles.empty() && scene_.gates.empty()) {
      refuse(root_, "at least one of room, pillars, cylinders, boxes, spheres, capsules, planes, discs, gates, meshes",
             "an empty scene");
    }
    return std::move(scene_);
  }

  // Describes the ignored content of referenced files.
  std::vector<std::string> ignored() const {
    std::vector<std::string> all = file_materials_ ? file_materials_->ignored() : std::vector<std::string>();
    all.insert(all.end(), ignored_.begin(), ignored_.end());
    return all;
  }

 private:
  // Reports files written before the project was renamed.
  void refuse_older_name() const {
    if (!root_.value.is_object() || root_.value.contains(keys::kVersionName)) return;
    for (const auto& [key, value] : root_.value.items()) {
      if (!key.ends_with("_scene")) continue;
      fail(child(root_, key, value), "expected the key \"" + std::string(keys::kVersionName) +
                                         "\" instead (only the format's name has changed: rename the key)");
    }
  }

  template <class Value>
  void read_top(const JsonField& field, const FieldPointer<keys::Scene, std::optional<Value>>&) {
    add(field, read_object<Value>(field));
  }
  template <class Value, std::size_t kMost>
  void read_top(const JsonField& list, const FieldPointer<keys::Scene, keys::List<Value, kMost>>& key) {
    const std::size_t count = require_array(list, "an array").size();
    check_count(kMost, list, key.name);
    for (std::size_t i = 0; i < count; ++i) {
      Interrupt::poll();
      const JsonField field = child(list, i);
      add(field, read_object<Value>(field));
    }
  }
  // Reads the values in the order of the file.
  template <class Value, std::size_t kMost>
  void read_top(const JsonField& map, const FieldPointer<keys::Scene, keys::ByName<Value, kMost>>& key) {
    if (!map.value.is_object()) refuse(map, "an object");
    check_count(kMost, map, key.name);
    for (const std::string& name : document_.ordered_keys(key.name)) {
      const JsonField field = require(map, name);
      add(name, field, read_object<Value>(field));
    }
  }
  template <std::size_t kMost>
  void read_top(const JsonField& field, const FieldPointer<keys::Scene, keys::List<BodyConfig, kMost>>&) {
    scene_.bodies = read_bodies(field, base_dir_, files_);
  }
  void read_top(const JsonField& field, const FieldPointer<keys::Scene, std::string>& key) {
    read_value(field, key.info, scene_.name);
  }
  void read_top(const JsonField&, const FieldPointer<keys::Scene, keys::Required<keys::Version>>&) {}
  void read_top(const JsonField&, const FieldPointer<keys::Scene, keys::Unread>&) {}

  void add(const JsonField& field, const Light& light) { scene_.light = exact(field, light); }
  void add(const JsonField& field, const keys::Markers& markers) { scene_.markers = markers_of(field, markers); }

  void add(const std::string& name, const JsonField&, const keys::Texture& given) {
    Image image = given.file.value ? read_image_file(*given.file.value->field) : read_image(*given.png_base64.value->field);
    pixels_left_ -= image.rgba.size() / 4;
    texture_index_.emplace(name, static_cast<std::uint16_t>(scene_.textures.size()));
    scene_.textures.push_back({name, image.width_px, image.height_px, std::move(image.rgba), given.wrap});
  }

  Image read_image(const JsonField& field) const {
    const std::string bytes = bytes_of_base64(field.value.get_ref<const std::string&>(), json::name_of(field));
    return decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, json::name_of(field), pixels_left_);
  }

  Image read_image_file(const JsonField& file) const {
    const std::filesystem::path path = path_of(file);
    try {
      const std::string bytes = read_text_file(path, "an image");
      return decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path.string(), pixels_left_);
    } catch (const std::invalid_argument& error) {
      fail(file, error.what());
    }
  }

  // Returns the path of a file that the scene references.
  std::filesystem::path path_of(const JsonField& file) const {
    std::filesystem::path path = base_dir_ / file.value.get<std::string>();
    if (files_ == MeshFiles::none || (files_ == MeshFiles::in_folder && !is_below(path, base_dir_))) {
      fail(file, "expected a file in the scene's folder or below it (load with meshes_anywhere=True to allow others), got " +
                     json::excerpt_of(file.value));
    }
    return path;
  }

  void add(const std::string& name, const JsonField&, const keys::Material& given) {
    Material material{.name = name,
                      .base_color = *given.base_color.value,
                      .semantic = given.semantic.value_or(0),
                      .emissive = given.emissive,
                      .alpha_cutoff = given.alpha_cutoff};
    if (given.texture.field) material.texture = named_texture(*given.texture.field);
    add_material(std::move(material));
  }

  std::uint16_t named_texture(const JsonField& field) {
    const auto found = texture_index_.find(field.value.get_ref<const std::string&>());
    if (found == texture_index_.end()) refuse_name(field, "a name listed in /textures", texture_index_);
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
    if (found == material_index_.end()) refuse_name(field, "a name listed in /materials", material_index_);
    return found->second;
  }

  std::uint16_t default_material(const JsonField& object) {
    const auto found = material_index_.find(kDefault);
    if (found != material_index_.end()) return found->second;
    if (scene_.materials.size() == kMaxMaterials) {
      fail(object, "expected a field \"material\" (/materials is full, so \"default\" cannot be added), found none");
    }
    return add_material(Material{kDefault});
  }

  std::uint16_t material_of(const JsonField& object, const keys::Text& material) {
    return material.field ? named_material(*material.field) : default_material(object);
  }

  void add(const JsonField& field, const keys::Room& room) {
    room_ = box_of(field, room.min, room.max, 2.0 * static_cast<float>(kMinSize));
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::room,
                                          .center = ((room_->min + room_->max) / 2.0).cast<float>(),
                                          .half_extents = ((room_->max - room_->min) / 2.0).cast<float>(),
                                          .material = material_of(field, room.material)});
  }

  // A pillar is a vertical cylinder from the floor to the ceiling of the room, unless z is given.
  void add(const JsonField& field, keys::Pillar pillar) {
    if (pillar.z && !((*pillar.z)[1] - (*pillar.z)[0] >= 2.0 * kMinSize)) refuse(require(field, "z"), "low < high");
    if (!pillar.z && !room_) fail(field, "expected a field \"z\" (the scene has no room to take the height from), found none");
    const auto [low, high] = pillar.z ? *pillar.z : keys::Numbers<2>{room_->min.z(), room_->max.z()};
    const auto [x, y] = *pillar.xy.value;
    pillar.center.value = keys::Numbers<3>{x, y, (low + high) / 2.0};
    add_round(field, PrimitiveKind::cylinder, pillar, (high - low) / 2.0);
  }

  void add(const JsonField& field, const keys::Cylinder& cylinder) {
    add_round(field, PrimitiveKind::cylinder, cylinder, *cylinder.height.value / 2.0);
  }

  void add(const JsonField& field, const keys::Capsule& capsule) {
    const double half_height = *capsule.height.value / 2.0;
    if (static_cast<float>(half_height) < static_cast<float>(*capsule.radius.value)) {
      refuse(require(field, "height"), "a number >= twice the radius");
    }
    add_round(field, PrimitiveKind::capsule, capsule, half_height);
  }

  void add(const JsonField& field, const keys::Box& box) {
    add_solid(field, PrimitiveKind::box, box, (vec3(*box.size.value) / 2.0).cast<float>());
  }

  void add(const JsonField& field, const keys::Sphere& sphere) {
    add_round(field, PrimitiveKind::sphere, sphere, *sphere.radius.value);
  }

  void add(const JsonField& field, const keys::Plane& plane) {
    const auto [x, y] = *plane.size.value;
    add_solid(field, PrimitiveKind::plane, plane, Vec3d(x / 2.0, y / 2.0, 0.0).cast<float>());
  }

  void add(const JsonField& field, const keys::Disc& disc) { add_round(field, PrimitiveKind::disc, disc, 0.0); }

  void add(const JsonField& field, const keys::Gate& gate) {
    scene_.gates.push_back({.shape = gate.shape,
                            .center = point(*gate.center.value),
                            .rotation = rotation_of(field, gate),
                            .size = gate.size,
                            .bar = gate.bar,
                            .material = material_of(field, gate.material),
                            .visibility = visibility_of(field, gate)});
  }

  void add_round(const JsonField& field, PrimitiveKind kind, const keys::Solid& solid, double half_height) {
    const double radius = *solid.radius.value;
    add_solid(field, kind, solid, Vec3d(radius, radius, half_height).cast<float>());
  }

  void add_solid(const JsonField& field, PrimitiveKind kind, const keys::Solid& solid, const Vec3& half_extents) {
    scene_.primitives.push_back(Primitive{.kind = kind,
                                          .center = point(*solid.center.value),
                                          .rotation = rotation_of(field, solid),
                                          .half_extents = half_extents,
                                          .material = material_of(field, solid.material),
                                          .visibility = visibility_of(field, solid)});
  }

  // Appends a mesh from a file or given inline. It is scaled, rotated and then moved.
  void add(const JsonField& field, const keys::Mesh& given) {
    const auto object = static_cast<std::uint16_t>(scene_.mesh.visibility.size());
    const bool has_file = given.file.value.has_value();
    const TriangleMesh part = has_file ? read_mesh_file(field, given) : inline_mesh_of(field, given);
    const Quat rotation = rotation_of(field, given);

    TriangleMesh& mesh = scene_.mesh;
    const auto first_vertex = static_cast<std::int32_t>(mesh.vertices.size());
    const bool is_placed = given.position || given.quat_wxyz || field.value.contains("scale");
    const Vec3 origin = given.position ? point(*given.position) : Vec3::Zero();
    for (const Vec3& vertex : part.vertices) {
      const Vec3 placed = is_placed ? Vec3(rotation * (vertex * given.scale) + origin) : vertex;
      if (!(placed.cwiseAbs().maxCoeff() <= static_cast<float>(kMaxCoordinate))) {
        fail(field, "expected all vertices " + keys::kCoordinates.text() + " m of the origin");
      }
      mesh.vertices.push_back(placed);
    }
    for (std::size_t i = 0; i < part.triangles.size(); ++i) {
      std::array<std::int32_t, 3> triangle = part.triangles[i];
      for (std::int32_t& index : triangle) index += first_vertex;
      const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
      if (is_degenerate(corner(0), corner(1), corner(2))) {
        const JsonField at = has_file ? *given.file.value->field : child(require(field, "triangles"), i);
        const std::string where = has_file ? " (triangle " + std::to_string(i) + " of the file)" : "";
        refuse(at, "a triangle with an area", "a degenerate one" + where);
      }
      mesh.triangles.push_back(triangle);
    }
    if (!part.uv.empty()) {  // earlier parts may have no uv
      mesh.uv.resize(static_cast<std::size_t>(first_vertex));
      mesh.uv.insert(mesh.uv.end(), part.uv.begin(), part.uv.end());
    } else if (!mesh.uv.empty()) {
      mesh.uv.resize(mesh.vertices.size());
    }
    append_colors(part.colors, part.vertices.size(), mesh);
    mesh.objects.insert(mesh.objects.end(), part.triangles.size(), object);
    mesh.visibility.push_back(visibility_of(field, given));
    if (part.materials.empty()) {
      read_mesh_materials(field, given.materials, part.triangles.size());
    } else {
      mesh.materials.insert(mesh.materials.end(), part.materials.begin(), part.materials.end());
    }
  }

  // Reads a mesh file. The result's materials are scene indices if the mesh has no "material", otherwise they are empty.
  TriangleMesh read_mesh_file(const JsonField& field, const keys::Mesh& given) {
    const JsonField& file = *given.file.value->field;
    const std::filesystem::path path = path_of(file);
    const bool has_own = !given.materials.field;
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

  // "material" is one name for the whole mesh, or an array with a name per triangle.
  void read_mesh_materials(const JsonField& field, const keys::TextOrTexts& given, std::size_t num_triangles) {
    std::vector<std::uint16_t>& materials = scene_.mesh.materials;
    const std::optional<JsonField>& material = given.field;
    if (!material || !material->value.is_array()) {
      materials.insert(materials.end(), num_triangles, material ? named_material(*material) : default_material(field));
      return;
    }
    if (material->value.size() != num_triangles) {
      refuse(*material, "one name, or one per triangle (" + std::to_string(num_triangles) + ')', material->value.size());
    }
    for (std::size_t i = 0; i < num_triangles; ++i) materials.push_back(named_material(child(*material, i)));
  }

  const json::Document& document_;
  JsonField root_;
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

}  // namespace

Markers read_markers(const JsonField& field) { return markers_of(field, read_object<keys::Markers>(field)); }

Light read_light(const JsonField& field) { return exact(field, read_object<Light>(field)); }

SceneDescription parse_scene(const std::string& text, const std::string& source, const std::filesystem::path& base_dir,
                             MeshFiles files, std::vector<std::string>* ignored) {
  const auto document = json::Document::parse(text, source, {"materials", "textures"});
  SceneReader reader(*document, base_dir, files);
  SceneDescription scene = reader.read();
  if (ignored != nullptr) *ignored = reader.ignored();
  return scene;
}

}  // namespace flockstep
