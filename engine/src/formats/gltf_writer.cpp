#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "base/json_document.hpp"
#include "base/require.hpp"
#include "formats/gltf.hpp"
#include "formats/gltf_extras.hpp"
#include "formats/image.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;
using Triangle = std::array<std::int32_t, 3>;

// Constants of glTF
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;  // component types
constexpr int kVertices = 34962, kIndices = 34963;                        // targets of buffer views
constexpr std::size_t kMaxShortVertices = 65535;                          // index 65535 is reserved
constexpr const char* kLights = "KHR_lights_punctual";
constexpr const char* kStrength = "KHR_materials_emissive_strength";

int wrap_mode(TextureWrap wrap) {
  constexpr std::array<int, 3> kModes{10497, 33648, 33071};  // repeat, mirror, clamp
  return kModes[static_cast<std::size_t>(wrap)];
}

// Converts to y up, as (x, z, -y). This is exact: it only moves values and flips a sign.
Vec3 to_file(const Vec3& v) { return {v.x(), v.z(), -v.y()}; }

OrderedJson in_file(const Vec3& v) {
  return OrderedJson::array({json::shortest(v.x()), json::shortest(v.y()), json::shortest(v.z())});
}

// A list of the document, as text. JSON objects would take many times the memory.
class List {
 public:
  std::size_t add(const OrderedJson& item) {
    text_ += (count_ == 0 ? "" : ",\n") + item.dump();
    return count_++;
  }
  std::size_t size() const { return count_; }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::size_t count_ = 0;
};

template <class T>
std::string_view raw_bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string word(std::size_t value) {  // 32 bits, little-endian
  std::string bytes;
  for (unsigned i = 0; i < 4; ++i) bytes += static_cast<char>(value >> (8 * i) & 0xffU);
  return bytes;
}

class GltfWriter {
 public:
  GltfWriter(const SceneDescription& description, const std::string& source, std::size_t max_bytes)
      : world_(description), source_(source), max_bytes_(max_bytes) {}

  std::string write(GltfForm form) {
    write_textures();
    write_materials();
    for (const Primitive& primitive : world_.primitives) write_primitive(primitive);
    for (const Gate& gate : world_.gates) write_gate(gate);
    write_meshes();
    write_markers();
    write_sun();
    OrderedJson buffer = {{"byteLength", bytes_.size()}};
    if (form == GltfForm::text) {
      require_size(bytes_.size() / 3 * 4);
      buffer["uri"] = "data:application/octet-stream;base64," + base64_of(bytes_);
      std::string text = document(buffer);
      require_size(text.size());
      return text;
    }
    std::string json = document(buffer);
    json.resize((json.size() + 3) / 4 * 4, ' ');
    constexpr std::size_t kHeaders = 12 + 8 + 8;
    const std::size_t size = kHeaders + json.size() + bytes_.size();
    require_size(size);
    std::string file = "glTF" + word(2) + word(size) + word(json.size()) + "JSON" + json + word(bytes_.size());
    file.append("BIN\0", 4);
    return file += bytes_;
  }

 private:
  using ShapeKey = std::tuple<std::string, float, float>;

  // ------------------------------------------------------------------------------------------------------------- bytes

  void require_size(std::size_t bytes) const {
    require(bytes <= max_bytes_, source_, "a world that fits in a glTF file of " + std::to_string(max_bytes_) + " bytes",
            "a larger one");
  }

  // target 0: neither attributes nor indices.
  std::size_t view(std::string_view bytes, int target) {
    Interrupt::poll();
    require_size(bytes_.size() + bytes.size());
    OrderedJson view = {{"buffer", 0}, {"byteOffset", bytes_.size()}, {"byteLength", bytes.size()}};
    if (target != 0) view["target"] = target;
    bytes_ += bytes;
    bytes_.resize((bytes_.size() + 3) / 4 * 4, '\0');
    return views_.add(view);
  }

  std::size_t accessor(std::string_view bytes, int target, int component, const char* type, std::size_t count,
                       OrderedJson more = OrderedJson::object()) {
    more.update({{"bufferView", view(bytes, target)}, {"componentType", component}, {"count", count}, {"type", type}});
    return accessors_.add(more);
  }

  std::size_t positions(std::span<const Vec3> points) {
    std::vector<Vec3> turned;
    turned.reserve(points.size());
    Eigen::AlignedBox3f box;
    for (const Vec3& point : points) box.extend(turned.emplace_back(to_file(point)));
    return accessor(raw_bytes(turned), kVertices, kFloat, "VEC3", turned.size(),
                    {{"min", in_file(Vec3(box.min()))}, {"max", in_file(Vec3(box.max()))}});
  }

  std::size_t texture_coordinates(std::span<const std::array<float, 2>> uv) {
    const std::vector<std::array<float, 2>> copy(uv.begin(), uv.end());
    return accessor(raw_bytes(copy), kVertices, kFloat, "VEC2", copy.size());
  }

  // Adds the indices of triangles. `first` is the number of their first vertex.
  std::size_t indices(std::span<const Triangle> triangles, std::size_t first, std::size_t num_vertices) {
    std::vector<std::uint16_t> narrow;
    std::vector<std::uint32_t> wide;
    const bool is_narrow = num_vertices <= kMaxShortVertices;
    for (const Triangle& triangle : triangles) {
      for (const std::int32_t corner : triangle) {
        const std::size_t index = static_cast<std::size_t>(corner) - first;
        if (is_narrow) narrow.push_back(static_cast<std::uint16_t>(index));
        if (!is_narrow) wide.push_back(static_cast<std::uint32_t>(index));
      }
    }
    return accessor(is_narrow ? raw_bytes(narrow) : raw_bytes(wide), kIndices, is_narrow ? kUnsignedShort : kUnsignedInt,
                    "SCALAR", 3 * triangles.size());
  }

  // --------------------------------------------------------------------------------------------------------- materials

  void write_textures() {
    std::size_t pixels_left = kMaxScenePixels;
    for (const Texture& texture : world_.textures) {
      const std::size_t pixels = texture.rgba.size() / 4;
      require(pixels <= pixels_left, source_, "textures of at most " + std::to_string(kMaxScenePixels) + " pixels in all",
              "more");
      pixels_left -= pixels;
      const std::size_t image =
          images_.add({{"name", texture.name},
                       {"mimeType", "image/png"},
                       {"bufferView", view(encode_png(texture.width_px, texture.height_px, texture.rgba), 0)}});
      const auto [sampler, is_new] = sampler_of_.try_emplace(texture.wrap, samplers_.size());
      if (is_new) samplers_.add({{"wrapS", wrap_mode(texture.wrap[0])}, {"wrapT", wrap_mode(texture.wrap[1])}});
      textures_.add({{"sampler", sampler->second}, {"source", image}});
    }
  }

  // Triangles, planes and discs are two-sided. Solids show their outside. A room shows its inside, so that the view into it is
  // free.
  void write_materials() {
    std::vector<bool> is_double(world_.materials.size(), false);
    for (const std::uint16_t material : world_.mesh.materials) is_double[material] = true;
    for (const Primitive& primitive : world_.primitives) {
      if (primitive.kind == PrimitiveKind::plane || primitive.kind == PrimitiveKind::disc) is_double[primitive.material] = true;
    }
    for (std::size_t i = 0; i < world_.materials.size(); ++i) {
      const auto& [name, color, semantic, texture, emissive, alpha_cutoff] = world_.materials[i];
      OrderedJson surface = {
          {"baseColorFactor", {json::shortest(color[0]), json::shortest(color[1]), json::shortest(color[2]), 1.0}},
          {"metallicFactor", 0.0}};
      if (texture) surface["baseColorTexture"] = {{"index", *texture}};
      OrderedJson material = {{"name", name}, {"pbrMetallicRoughness", surface}};
      if (is_double[i]) material["doubleSided"] = true;
      if (alpha_cutoff != 0.0F) {
        material["alphaMode"] = "MASK";
        material["alphaCutoff"] = json::shortest(alpha_cutoff);
      }
      if (emissive != Material().emissive) {
        // Factors are at most 1, so the strength holds a power of two. This loses no bits.
        float strength = 1.0F;
        while (*std::max_element(emissive.begin(), emissive.end()) > strength) strength *= 2.0F;
        material["emissiveFactor"] = in_file(Vec3(emissive.data()) / strength);
        if (texture) material["emissiveTexture"] = surface["baseColorTexture"];
        if (strength > 1.0F) {
          material["extensions"] = {{kStrength, {{"emissiveStrength", strength}}}};
          has_strength_ = true;
        }
      }
      if (semantic != 0) material["extras"] = {{"semantic", semantic}};
      materials_.add(material);
    }
  }

  // -------------------------------------------------------------------------------------------------------- primitives

  void write_primitive(const Primitive& primitive) {
    const auto& [kind, center, rotation, half, material, visibility] = primitive;
    const std::string name = EnumNames<PrimitiveKind>::kNames[static_cast<std::size_t>(kind)];
    const bool is_capsule = kind == PrimitiveKind::capsule, is_flat = half.z() == 0.0F;
    GltfNodeExtras extras;
    extras.primitive = Primitive{.kind = kind, .half_extents = is_capsule ? half : Vec3(1.0F, 1.0F, is_flat ? 0.0F : 1.0F)};
    OrderedJson node = {{"name", name + ' ' + std::to_string(num_primitives_[kind]++)},
                        {"mesh", tessellation(*extras.primitive, material)},
                        {"translation", in_file(to_file(center))}};
    write_rotation(node, rotation);
    if (!is_capsule) node["scale"] = in_file(Vec3(half.x(), is_flat ? 1.0F : half.z(), half.y()));
    node["extras"] = with_visibility(write_gltf_extras(extras), visibility);
    nodes_.add(node);
  }

  void write_gate(const Gate& gate) {
    GltfNodeExtras extras;
    extras.gate = gate;
    OrderedJson node = {{"name", "gate " + std::to_string(num_gates_++)},
                        {"mesh", tessellation(gate, gate.material)},
                        {"translation", in_file(to_file(gate.center))}};
    write_rotation(node, gate.rotation);
    node["extras"] = with_visibility(write_gltf_extras(extras), gate.visibility);
    nodes_.add(node);
  }

  static void write_rotation(OrderedJson& node, const Quat& rotation) {
    const Vec3 axis = to_file(rotation.vec());
    if (rotation.w() == 1.0F && axis.isZero(0.0F)) return;
    node["rotation"] = in_file(axis);
    node["rotation"].push_back(json::shortest(rotation.w()));
  }

  // The kind of a shape in messages and names, and its key.
  static std::pair<std::string, ShapeKey> shape_of(const Primitive& primitive) {
    const std::string name = EnumNames<PrimitiveKind>::kNames[static_cast<std::size_t>(primitive.kind)];
    return {name, {name, primitive.half_extents.x(), primitive.half_extents.z()}};
  }
  static std::pair<std::string, ShapeKey> shape_of(const Gate& gate) {
    const std::string name = "gate " + std::string(EnumNames<GateShape>::kNames[static_cast<std::size_t>(gate.shape)]);
    return {name, {name, gate.size, gate.bar}};
  }

  // Returns the mesh that all primitives or gates with this shape and material share.
  template <class Solid>
  std::size_t tessellation(const Solid& solid, std::uint16_t material) {
    const auto [name, key] = shape_of(solid);
    const auto [shape, is_new_shape] = shapes_.try_emplace(key);
    auto& [position, corners, num_vertices, num_triangles, uv] = shape->second;
    if (is_new_shape) {
      const TriangleMesh mesh = gltf_tessellation(solid);
      position = positions(mesh.vertices);
      corners = indices(mesh.triangles, 0, mesh.vertices.size());
      num_vertices = mesh.vertices.size();
      num_triangles = mesh.triangles.size();
    }
    const auto [known, is_new] = tessellations_.try_emplace({position, material}, meshes_.size());
    if (!is_new) return known->second;
    OrderedJson attributes = {{"POSITION", position}};
    if (world_.materials[material].texture) {  // glTF requires uv for the texture, which primitives do not show
      if (!uv) uv = texture_coordinates(std::vector<std::array<float, 2>>(num_vertices));
      attributes["TEXCOORD_0"] = *uv;
    }
    const OrderedJson whole = {{"attributes", attributes}, {"indices", corners}, {"material", material}};
    return add_mesh(name, OrderedJson::array({whole}), num_triangles);
  }

  std::size_t add_mesh(const std::string& name, const OrderedJson& primitives, std::size_t num_triangles) {
    num_triangles_ += num_triangles + 1;
    require(num_triangles_ <= kMaxGltfTriangles, source_, "at most " + std::to_string(kMaxGltfTriangles) + " triangles", "more");
    return meshes_.add({{"name", name}, {"primitives", primitives}});
  }

  // ------------------------------------------------------------------------------------------------------------ meshes

  // Writes one mesh per object. An object's triangles and their vertices are contiguous.
  void write_meshes() {
    const TriangleMesh& mesh = world_.mesh;
    for (std::size_t first = 0, first_vertex = 0; first < mesh.triangles.size();) {
      std::size_t last = first, last_vertex = first_vertex;
      for (; last < mesh.triangles.size() && mesh.objects[last] == mesh.objects[first]; ++last) {
        for (const std::int32_t index : mesh.triangles[last]) {
          last_vertex = std::max(last_vertex, static_cast<std::size_t>(index) + 1);
        }
      }
      write_mesh(first, last, first_vertex, last_vertex);
      first = last;
      first_vertex = last_vertex;
    }
  }

  // Writes the triangles [first, last) with the vertices [first_vertex, last_vertex), as one glTF primitive per material.
  void write_mesh(std::size_t first, std::size_t last, std::size_t first_vertex, std::size_t last_vertex) {
    const TriangleMesh& mesh = world_.mesh;
    const std::size_t num_vertices = last_vertex - first_vertex;
    OrderedJson attributes = {{"POSITION", positions(std::span(mesh.vertices).subspan(first_vertex, num_vertices))}};
    if (!mesh.uv.empty()) {
      attributes["TEXCOORD_0"] = texture_coordinates(std::span(mesh.uv).subspan(first_vertex, num_vertices));
    }
    if (!mesh.colors.empty()) {
      const auto colors = std::span(mesh.colors).subspan(first_vertex, num_vertices);
      attributes["COLOR_0"] =
          accessor(raw_bytes(std::vector(colors.begin(), colors.end())), kVertices, kFloat, "VEC3", num_vertices);
    }
    GltfNodeExtras extras;
    extras.object = mesh.objects[first];
    std::vector<std::vector<Triangle>> parts;
    std::vector<std::uint16_t> materials;
    std::map<std::uint16_t, std::size_t> part_of;
    for (std::size_t i = first; i < last; ++i) {
      const auto [part, is_new] = part_of.try_emplace(mesh.materials[i], parts.size());
      if (is_new) {
        parts.emplace_back();
        materials.push_back(mesh.materials[i]);
      }
      parts[part->second].push_back(mesh.triangles[i]);
      if (extras.order.empty() || extras.order.end()[-2] != part->second) {
        extras.order.insert(extras.order.end(), {static_cast<std::uint32_t>(part->second), 0});
      }
      ++extras.order.back();
    }
    if (extras.order.size() == 2 * parts.size()) extras.order.clear();
    OrderedJson primitives = OrderedJson::array();
    for (std::size_t i = 0; i < parts.size(); ++i) {
      primitives.push_back(
          {{"attributes", attributes}, {"indices", indices(parts[i], first_vertex, num_vertices)}, {"material", materials[i]}});
    }
    const std::string name = "mesh " + std::to_string(*extras.object);
    const std::size_t index = add_mesh(name, primitives, last - first);
    nodes_.add(
        {{"name", name}, {"mesh", index}, {"extras", with_visibility(write_gltf_extras(extras), mesh.visibility_of(first))}});
  }

  static OrderedJson with_visibility(OrderedJson extras, Visibility visibility) {
    if (!is_solid(visibility)) extras[kGltfVisual] = true;
    if (!is_visible(visibility)) extras[kGltfSolid] = true;
    return extras;
  }

  // ------------------------------------------------------------------------------------------------------------ others

  void write_markers() {
    const auto write = [this](const std::string& name, const Vec3& point) {
      nodes_.add({{"name", name}, {"translation", in_file(to_file(point))}});
    };
    const Markers& markers = world_.markers;
    if (markers.start) write("start", *markers.start);
    for (std::size_t i = 0; i < markers.waypoints.size(); ++i) write("waypoint." + std::to_string(i + 1), markers.waypoints[i]);
    if (markers.goal) write("goal", *markers.goal);
  }

  // The light shines along its node's -z.
  void write_sun() {
    const auto& direction = world_.light.sun_direction;
    const Eigen::Vector3d towards = to_file(Vec3(direction.data())).cast<double>().normalized();
    // Rotates +z to the sun around the cross product of the two, or by half a turn around x if the sun is at -z.
    // (FromTwoVectors() would pull in a singular value decomposition, a tenth of this folder's compile time.)
    const bool is_opposite = towards.z() < -1.0 + 1e-12;
    const Eigen::Quaterniond q = is_opposite ? Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0)
                                             : Eigen::Quaterniond(1.0 + towards.z(), -towards.y(), towards.x(), 0.0).normalized();
    nodes_.add({{"name", "sun"}, {"rotation", {q.x(), q.y(), q.z(), q.w()}}, {"extensions", {{kLights, {{"light", 0}}}}}});
  }

  // A surface of colour c that faces the sun shows c * sun_color here, and c / pi * intensity * color in glTF.
  OrderedJson sun() const {
    const auto& sun_color = world_.light.sun_color;
    const double most = *std::max_element(sun_color.begin(), sun_color.end());
    OrderedJson color = OrderedJson::array();
    for (const float value : sun_color) color.push_back(most > 0.0 ? static_cast<double>(value) / most : 1.0);
    return {{"name", "sun"}, {"type", "directional"}, {"color", color}, {"intensity", most * std::numbers::pi}};
  }

  std::string document(const OrderedJson& buffer) const {
    OrderedJson roots = OrderedJson::array();
    for (std::size_t i = 0; i < nodes_.size(); ++i) roots.push_back(i);
    const OrderedJson scene = {{"name", world_.name},
                               {"nodes", roots},
                               {"extras", write_gltf_extras(GltfSceneExtras{world_.light, world_.markers, world_.bodies})}};
    OrderedJson used = OrderedJson::array({kLights});
    if (has_strength_) used.push_back(kStrength);
    const OrderedJson head = {{"asset", {{"version", "2.0"}, {"generator", "flockstep"}}},
                              {"extensionsUsed", used},
                              {"extensions", {{kLights, {{"lights", OrderedJson::array({sun()})}}}}},
                              {"scene", 0},
                              {"scenes", OrderedJson::array({scene})},
                              {"buffers", OrderedJson::array({buffer})}};
    std::string text = head.dump();
    text.pop_back();
    const std::array<std::pair<const char*, const List*>, 8> lists{{{"nodes", &nodes_},
                                                                    {"meshes", &meshes_},
                                                                    {"materials", &materials_},
                                                                    {"textures", &textures_},
                                                                    {"images", &images_},
                                                                    {"samplers", &samplers_},
                                                                    {"accessors", &accessors_},
                                                                    {"bufferViews", &views_}}};
    for (const auto& [name, list] : lists) {
      if (list->size() > 0) text += std::string(",\n\"") + name + "\":[\n" + list->text() + ']';
    }
    return text += "}\n";
  }

  struct MeshAccessors {
    std::size_t position, corners, num_vertices, num_triangles;
    std::optional<std::size_t> uv;
  };

  const SceneDescription& world_;
  const std::string& source_;
  std::size_t max_bytes_;
  std::string bytes_;
  List nodes_, meshes_, materials_, textures_, images_, samplers_, accessors_, views_;
  std::size_t num_triangles_ = 0;
  bool has_strength_ = false;  // emission strength is used
  std::map<PrimitiveKind, std::size_t> num_primitives_;
  std::size_t num_gates_ = 0;
  std::map<std::array<TextureWrap, 2>, std::size_t> sampler_of_;
  std::map<ShapeKey, MeshAccessors> shapes_;
  std::map<std::pair<std::size_t, std::uint16_t>, std::size_t> tessellations_;  // by positions and material
};

}  // namespace

std::string write_gltf(const SceneDescription& description, GltfForm form, const std::string& source, std::size_t max_bytes) {
  return GltfWriter(description, source, max_bytes).write(form);
}

}  // namespace flockstep
