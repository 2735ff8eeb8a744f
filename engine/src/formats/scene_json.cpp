#include "formats/scene_json.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
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

class SceneReader {
 public:
  SceneReader(const json::Document& document, std::filesystem::path base_dir, MeshFiles files)
      : root_(document.root()),
        material_names_(document.ordered_keys(keys::kMaterials.name)),
        texture_names_(document.ordered_keys(keys::kTextures.name)),
        base_dir_(std::move(base_dir)),
        files_(files) {
    scene_.materials.clear();
  }

  SceneDescription read() {
    refuse_older_name();
    check_version(root_, keys::kVersion.name, kSceneVersion);
    check_keys(root_, keys::kSceneKeys);
    if (!find(root_, keys::kVersion)) {
      fail(root_, "expected a field \"flockstep_scene\", found none: add \"flockstep_scene\": " + std::to_string(kSceneVersion));
    }
    if (const auto name = find(root_, keys::kName)) {
      if (!name->value.is_string()) refuse(*name, "a string");
      scene_.name = name->value.get<std::string>();
    }
    for_each_name(keys::kTextures, texture_names_, &SceneReader::read_texture);
    for_each_name(keys::kMaterials, material_names_, &SceneReader::read_material);
    if (const auto room = find(root_, keys::kRoom)) read_room(*room);
    for_each(keys::kPillars, &SceneReader::read_pillar);
    for_each(keys::kCylinders, &SceneReader::read_cylinder);
    for_each(keys::kBoxes, &SceneReader::read_box);
    for_each(keys::kSpheres, &SceneReader::read_sphere);
    for_each(keys::kCapsules, &SceneReader::read_capsule);
    for_each(keys::kPlanes, &SceneReader::read_plane);
    for_each(keys::kDiscs, &SceneReader::read_disc);
    for_each(keys::kGates, &SceneReader::read_gate);
    for_each(keys::kMeshes, &SceneReader::read_mesh);
    if (const auto bodies = find(root_, keys::kBodies)) scene_.bodies = read_bodies(*bodies, base_dir_, files_);
    if (const auto markers = find(root_, keys::kMarkers)) scene_.markers = read_markers(*markers);
    if (const auto light = find(root_, keys::kLight)) scene_.light = read_light(*light);
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
    if (!root_.value.is_object() || root_.value.contains(keys::kVersion.name)) return;
    for (const auto& [key, value] : root_.value.items()) {
      if (!key.ends_with("_scene")) continue;
      fail(child(root_, key, value), "expected the key \"" + std::string(keys::kVersion.name) +
                                         "\" instead (only the format's name has changed: rename the key)");
    }
  }

  void for_each(const SceneKey& key, void (SceneReader::*read)(const JsonField& field)) {
    const std::optional<JsonField> list = find(root_, key);
    if (!list) return;
    const std::size_t count = require_array(*list, "an array").size();
    check_count(*list, key);
    for (std::size_t i = 0; i < count; ++i) {
      Interrupt::poll();
      const JsonField field = child(*list, i);
      check_keys(field, key.keys);
      (this->*read)(field);
    }
  }

  // Reads the named values of a key in the order of the file.
  void for_each_name(const SceneKey& key, std::span<const std::string> names,
                     void (SceneReader::*read)(const std::string& name, const JsonField& field)) {
    const std::optional<JsonField> map = find(root_, key);
    if (!map) return;
    if (!map->value.is_object()) refuse(*map, "an object");
    check_count(*map, key);
    for (const std::string& name : names) {
      const JsonField field = require(*map, name);
      check_keys(field, key.keys);
      (this->*read)(name, field);
    }
  }

  static void check_count(const JsonField& field, const SceneKey& key) {
    if (key.most == 0 || field.value.size() <= key.most) return;
    refuse(field, "at most " + std::to_string(key.most) + ' ' + std::string(key.name), field.value.size());
  }

  void read_texture(const std::string& name, const JsonField& field) {
    const std::optional<JsonField> file = find(field, keys::kTextureFile);
    const std::optional<JsonField> bytes = find(field, keys::kTextureBytes);
    if (file.has_value() == bytes.has_value()) fail(field, "expected either \"file\" or \"png_base64\"");
    Image image = file ? read_image_file(*file) : read_image(*bytes);
    pixels_left_ -= image.rgba.size() / 4;
    Texture texture{name, image.width_px, image.height_px, std::move(image.rgba)};
    if (const auto wrap = find(field, keys::kWrap)) texture.wrap = wrap_of(*wrap);
    texture_index_.emplace(name, static_cast<std::uint16_t>(scene_.textures.size()));
    scene_.textures.push_back(std::move(texture));
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

  // Returns the path of a file that the scene references.
  std::filesystem::path path_of(const JsonField& file, const char* expected) const {
    if (!file.value.is_string()) refuse(file, expected);
    std::filesystem::path path = base_dir_ / file.value.get<std::string>();
    if (files_ == MeshFiles::none || (files_ == MeshFiles::in_folder && !is_below(path, base_dir_))) {
      fail(file, "expected a file in the scene's folder or below it (load with meshes_anywhere=True to allow others), got " +
                     json::excerpt_of(file.value));
    }
    return path;
  }

  void read_material(const std::string& name, const JsonField& field) {
    Material material{name};
    material.base_color = color(require(field, keys::kBaseColor), keys::kBaseColor);
    if (const auto semantic = find(field, keys::kSemantic)) material.semantic = integer(*semantic, keys::kSemantic);
    if (const auto texture = find(field, keys::kTexture)) material.texture = named_texture(*texture);
    read_to(material.emissive, field, keys::kEmissive);
    read_to(material.alpha_cutoff, field, keys::kAlphaCutoff);
    add_material(std::move(material));
  }

  std::uint16_t named_texture(const JsonField& field) {
    if (!field.value.is_string()) refuse(field, "the name of a texture");
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

  std::uint16_t material_of(const JsonField& object) {
    const std::optional<JsonField> field = find(object, keys::kMaterial);
    return field ? named_material(*field) : default_material(object);
  }

  void read_room(const JsonField& field) {
    check_keys(field, keys::kRoomKeys);
    room_ = box_of(field, keys::kMin, keys::kMax, 2.0 * static_cast<float>(kMinSize));
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::room,
                                          .center = ((room_->min + room_->max) / 2.0).cast<float>(),
                                          .half_extents = ((room_->max - room_->min) / 2.0).cast<float>(),
                                          .material = material_of(field)});
  }

  // Reads a pillar: a vertical cylinder from the floor to the ceiling of the room, unless z is given.
  void read_pillar(const JsonField& field) {
    const auto [x, y] = pair(require(field, keys::kPillarCenter), keys::kPillarCenter, "an array of 2 numbers (x, y)");
    const float radius = radius_of(field);
    std::array<double, 2> ends{};
    if (const auto z = find(field, keys::kPillarEnds)) {
      ends = pair(*z, keys::kPillarEnds, "an array of 2 numbers (low, high)");
      if (!(ends[1] - ends[0] >= 2.0 * kMinSize)) refuse(*z, "low < high");
    } else if (room_) {
      ends = {room_->min.z(), room_->max.z()};
    } else {
      fail(field, "expected a field \"z\" (the scene has no room to take the height from), found none");
    }
    const auto [low, high] = ends;
    scene_.primitives.push_back(Primitive{.kind = PrimitiveKind::cylinder,
                                          .center = Vec3d(x, y, (low + high) / 2.0).cast<float>(),
                                          .half_extents = Vec3(radius, radius, static_cast<float>((high - low) / 2.0)),
                                          .material = material_of(field),
                                          .visibility = visibility_of(field)});
  }

  void read_cylinder(const JsonField& field) {
    const float radius = radius_of(field);
    add_solid(field, PrimitiveKind::cylinder, Vec3(radius, radius, half_of(require(field, keys::kHeight), keys::kHeight)));
  }

  void read_capsule(const JsonField& field) {
    const float radius = radius_of(field);
    const JsonField height = require(field, keys::kHeight);
    const float half_height = half_of(height, keys::kHeight);
    if (half_height < radius) refuse(height, "a number >= twice the radius");
    add_solid(field, PrimitiveKind::capsule, Vec3(radius, radius, half_height));
  }

  void read_box(const JsonField& field) {
    const Vec3d size = vec3(require(field, keys::kBoxSize), keys::kBoxSize);
    add_solid(field, PrimitiveKind::box, (size / 2.0).cast<float>());
  }

  void read_sphere(const JsonField& field) { add_solid(field, PrimitiveKind::sphere, Vec3::Constant(radius_of(field))); }

  void read_plane(const JsonField& field) {
    const auto [x, y] = pair(require(field, keys::kPlaneSize), keys::kPlaneSize, "an array of 2 numbers (along local x, y)");
    add_solid(field, PrimitiveKind::plane, Vec3d(x / 2.0, y / 2.0, 0.0).cast<float>());
  }

  void read_disc(const JsonField& field) {
    const float radius = radius_of(field);
    add_solid(field, PrimitiveKind::disc, Vec3(radius, radius, 0.0F));
  }

  void read_gate(const JsonField& field) {
    Gate gate{.center = point(require(field, keys::kCenter), keys::kCenter), .rotation = rotation_of(field)};
    if (const auto shape = find(field, keys::kGateShape)) gate.shape = gate_shape_of(*shape);
    read_to(gate.size, field, keys::kGateSize);
    read_to(gate.bar, field, keys::kGateBar);
    gate.material = material_of(field);
    gate.visibility = visibility_of(field);
    scene_.gates.push_back(gate);
  }

  static float radius_of(const JsonField& field) {
    return static_cast<float>(number(require(field, keys::kRadius), keys::kRadius));
  }

  void add_solid(const JsonField& field, PrimitiveKind kind, const Vec3& half_extents) {
    scene_.primitives.push_back(Primitive{.kind = kind,
                                          .center = point(require(field, keys::kCenter), keys::kCenter),
                                          .rotation = rotation_of(field),
                                          .half_extents = half_extents,
                                          .material = material_of(field),
                                          .visibility = visibility_of(field)});
  }

  // Appends a mesh from a file or given inline. It is scaled, rotated and then moved.
  void read_mesh(const JsonField& field) {
    const auto object = static_cast<std::uint16_t>(scene_.mesh.visibility.size());
    const bool has_file = find(field, keys::kMeshFile).has_value();
    const auto is_there = [&](const SceneKey& key) { return find(field, key).has_value(); };
    if (has_file == (is_there(keys::kVertices) || is_there(keys::kTriangles) || is_there(keys::kUv) || is_there(keys::kColors))) {
      fail(field, "expected either \"file\" or \"vertices\" and \"triangles\"");
    }
    const TriangleMesh part = has_file ? read_mesh_file(field) : inline_mesh_of(field);
    const Quat rotation = rotation_of(field);
    std::optional<Vec3> position;
    read_to(position, field, keys::kPosition);
    float scale = 1.0F;
    read_to(scale, field, keys::kScale);

    TriangleMesh& mesh = scene_.mesh;
    const auto first_vertex = static_cast<std::int32_t>(mesh.vertices.size());
    const bool is_placed = position || is_there(keys::kScale) || is_there(keys::kRotation);
    const Vec3 origin = position.value_or(Vec3::Zero());
    for (const Vec3& vertex : part.vertices) {
      const Vec3 placed = is_placed ? Vec3(rotation * (vertex * scale) + origin) : vertex;
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
        const JsonField at = has_file ? require(field, keys::kMeshFile) : child(require(field, keys::kTriangles), i);
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
    mesh.visibility.push_back(visibility_of(field));
    if (part.materials.empty()) {
      read_mesh_materials(field, part.triangles.size());
    } else {
      mesh.materials.insert(mesh.materials.end(), part.materials.begin(), part.materials.end());
    }
  }

  // Reads a mesh file. The result's materials are scene indices if the mesh has no "material", otherwise they are empty.
  TriangleMesh read_mesh_file(const JsonField& field) {
    const JsonField file = require(field, keys::kMeshFile);
    const std::filesystem::path path = path_of(file, "the path of an OBJ or PLY file");
    const bool has_own = !find(field, keys::kMeshMaterial);
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
  void read_mesh_materials(const JsonField& field, std::size_t num_triangles) {
    std::vector<std::uint16_t>& materials = scene_.mesh.materials;
    const std::optional<JsonField> material = find(field, keys::kMeshMaterial);
    if (!material || !material->value.is_array()) {
      materials.insert(materials.end(), num_triangles, material_of(field));
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

}  // namespace

Markers read_markers(const JsonField& field) {
  check_keys(field, keys::kMarkerKeys);
  Markers markers;
  read_to(markers.radius, field, keys::kMarkerRadius);
  read_to(markers.start, field, keys::kStart);
  read_to(markers.goal, field, keys::kGoal);
  if (const auto waypoints = find(field, keys::kWaypoints)) {
    const std::size_t count = require_array(*waypoints, "an array of (x, y, z)").size();
    for (std::size_t i = 0; i < count; ++i) markers.waypoints.push_back(point(child(*waypoints, i), keys::kWaypoints));
  }
  if (const auto spawn_box = find(field, keys::kSpawnBox)) {
    check_keys(*spawn_box, keys::kSpawnBoxKeys);
    const Box3d box = box_of(*spawn_box, keys::kLow, keys::kHigh, 0.0);
    markers.spawn_box = Aabb{box.min.cast<float>(), box.max.cast<float>()};
  }
  return markers;
}

Light read_light(const JsonField& field) {
  check_keys(field, keys::kLightKeys);
  Light light;
  const SceneKey* key = keys::kLightKeys.data();
  for_each_field(light, [&](const auto&, auto& value) { read_to(value, field, *key++); });
  return light;
}

SceneDescription parse_scene(const std::string& text, const std::string& source, const std::filesystem::path& base_dir,
                             MeshFiles files, std::vector<std::string>* ignored) {
  const auto document = json::Document::parse(text, source, {keys::kMaterials.name, keys::kTextures.name});
  SceneReader reader(*document, base_dir, files);
  SceneDescription scene = reader.read();
  if (ignored != nullptr) *ignored = reader.ignored();
  return scene;
}

}  // namespace flockstep
