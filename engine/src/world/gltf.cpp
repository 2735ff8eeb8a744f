#include "world/gltf.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <set>
#include <span>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "world/gltf_model.hpp"
#include "world/image.hpp"
#include "world/placement.hpp"
#include "world/scene_description.hpp"
#include "world/text_file.hpp"

namespace flockstep {
namespace {

using Vec3d = Eigen::Vector3d;
using Vec2d = Eigen::Vector2d;

std::string written(const Vec3d& v) {
  std::ostringstream out;
  out << '(' << v.x() << ", " << v.y() << ", " << v.z() << ')';
  return out.str();
}

// An accessor's elements, which the model has within its buffers.
class Elements {
 public:
  Elements(const tinygltf::Model& model, std::size_t accessor)
      : accessor_(model.accessors[accessor]),
        size_(static_cast<std::size_t>(tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(accessor_.componentType)))) {
    const tinygltf::BufferView& view = model.bufferViews[static_cast<std::size_t>(accessor_.bufferView)];
    const std::size_t components =
        static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(accessor_.type)));
    stride_ = view.byteStride != 0 ? view.byteStride : size_ * components;
    first_ = model.buffers[static_cast<std::size_t>(view.buffer)].data.data() + view.byteOffset + accessor_.byteOffset;
  }

  std::size_t size() const { return accessor_.count; }

  std::uint32_t index(std::size_t element) const {
    const unsigned char* const at = first_ + element * stride_;
    if (size_ == 1) return *at;
    return size_ == 2 ? as<std::uint16_t>(at) : as<std::uint32_t>(at);
  }

  double number(std::size_t element, std::size_t component) const {
    const unsigned char* const at = first_ + element * stride_ + component * size_;
    switch (accessor_.componentType) {
      case TINYGLTF_COMPONENT_TYPE_BYTE:
        return whole<std::int8_t>(at);
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return whole<std::uint8_t>(at);
      case TINYGLTF_COMPONENT_TYPE_SHORT:
        return whole<std::int16_t>(at);
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return whole<std::uint16_t>(at);
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return whole<std::uint32_t>(at);
      default:
        return as<float>(at);
    }
  }

 private:
  template <class T>
  static T as(const unsigned char* at) {  // which may lie anywhere
    T value;
    std::memcpy(&value, at, sizeof value);
    return value;
  }
  template <class T>
  double whole(const unsigned char* at) const {
    const double value = as<T>(at);
    return accessor_.normalized ? std::max(value / std::numeric_limits<T>::max(), -1.0) : value;
  }

  const tinygltf::Accessor& accessor_;
  std::size_t size_;  // of a component, in bytes
  std::size_t stride_ = 0;
  const unsigned char* first_ = nullptr;
};

// KHR_texture_transform: scaled, then turned counter-clockwise as the image is seen, then moved.
struct UvTransform {
  Eigen::Matrix2d turn = Eigen::Matrix2d::Identity();
  Vec2d offset = Vec2d::Zero();

  explicit UvTransform(const tinygltf::TextureInfo& texture) {
    const auto found = texture.extensions.find("KHR_texture_transform");
    if (found == texture.extensions.end()) return;
    const tinygltf::Value& given = found->second;
    const auto pair = [&](const char* key, const Vec2d& usual) -> Vec2d {
      if (!given.Has(key)) return usual;
      return {given.Get(key).Get(0).GetNumberAsDouble(), given.Get(key).Get(1).GetNumberAsDouble()};
    };
    const double angle = given.Has("rotation") ? given.Get("rotation").GetNumberAsDouble() : 0.0;
    const Vec2d scale = pair("scale", Vec2d::Ones());
    turn << std::cos(angle) * scale.x(), std::sin(angle) * scale.y(), -std::sin(angle) * scale.x(), std::cos(angle) * scale.y();
    offset = pair("offset", Vec2d::Zero());
  }
};

// Names that are all different.
class Names {
 public:
  std::string unused(const std::string& wanted) {
    std::string name = wanted;
    for (std::size_t& number = numbers_.try_emplace(wanted, 1).first->second; !used_.insert(name).second;) {
      name = wanted + ' ' + std::to_string(++number);
    }
    return name;
  }

 private:
  std::set<std::string> used_;
  std::map<std::string, std::size_t> numbers_;  // the last suffix of each
};

class GltfReader {
 public:
  GltfReader(const GltfModel& gltf, const std::string& source, GltfFiles& files, const LoadOptions& options)
      : gltf_(gltf), model_(gltf.model), source_(source), files_(files), place_(placement(options, UpAxis::y)) {
    file_.ignored = gltf.ignored;
    file_.scene.materials.clear();
  }

  GltfFile read() {
    for (std::size_t i = 0; i < model_.materials.size(); ++i) add_material(i, 0);
    read_nodes();
    for (const Shown& shown : shown_) read_mesh(shown);
    order_waypoints();
    if (scene().materials.empty()) material_of(-1, 0);
    if (dropped_ > 0) {
      file_.ignored.push_back(std::to_string(dropped_) + (dropped_ == 1 ? " triangle" : " triangles") + " without an area");
    }
    if (suns_ > 1) file_.ignored.push_back("all but the first of " + std::to_string(suns_) + " directional lights");
    if (scene().mesh.triangles.empty()) {
      std::string others;
      for (const std::string& what : file_.ignored) others += (others.empty() ? ", but " : ", ") + what;
      refuse(source_, "at least one triangle with an area", "none" + others);
    }
    return std::move(file_);
  }

 private:
  SceneDescription& scene() { return file_.scene; }

  std::string field(const char* list, std::size_t index) const { return source_ + ": /" + list + '/' + std::to_string(index); }

  static int semantic_of(const tinygltf::Value& extras) {
    return extras.Has(kGltfSemantic) ? extras.Get(kGltfSemantic).GetNumberAsInt() : 0;
  }

  // ----------------------------------------------------------------------------------------------------- materials

  std::uint16_t push_material(Material material, const std::string& wanted_name) {
    require(scene().materials.size() < kMaxMaterials, source_,
            "fewer than 65533 materials, those of nodes with a semantic included", "more");
    material.name = material_names_.unused(wanted_name);
    scene().materials.push_back(std::move(material));
    return static_cast<std::uint16_t>(scene().materials.size() - 1);
  }

  // Material i of the file, with the class of a node where that has one.
  std::uint16_t add_material(std::size_t i, int semantic) {
    const tinygltf::Material& given = model_.materials[i];
    Material material;
    const auto& factor = given.pbrMetallicRoughness.baseColorFactor;
    for (std::size_t c = 0; c < 3; ++c) {
      material.base_color[c] = static_cast<float>(factor[c]);
      material.emissive[c] = static_cast<float>(given.emissiveFactor[c]);
    }
    if (given.extras.Has(kGltfUnlit)) material.emissive = std::exchange(material.base_color, {});
    material.semantic = static_cast<std::uint16_t>(semantic != 0 ? semantic : semantic_of(given.extras));
    const int texture = given.pbrMetallicRoughness.baseColorTexture.index;
    if (texture >= 0) material.texture = texture_of(static_cast<std::size_t>(texture));
    const std::string name = given.name.empty() ? "material " + std::to_string(i) : given.name;
    const std::uint16_t index = push_material(std::move(material), name);
    materials_.emplace(std::pair(static_cast<int>(i), semantic), index);
    return index;
  }

  std::uint16_t material_of(int material, int semantic) {
    const auto found = materials_.find({material, semantic});
    if (found != materials_.end()) return found->second;
    if (material >= 0) return add_material(static_cast<std::size_t>(material), semantic);
    const std::uint16_t index =
        push_material(Material{"", {1.0F, 1.0F, 1.0F}, static_cast<std::uint16_t>(semantic)}, "default");  // glTF's own
    materials_.emplace(std::pair(material, semantic), index);
    return index;
  }

  static TextureWrap wrap_of(int value) {
    if (value == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return TextureWrap::clamp;
    return value == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT ? TextureWrap::mirror : TextureWrap::repeat;
  }

  std::optional<std::uint16_t> texture_of(std::size_t index) {
    const tinygltf::Texture& given = model_.textures[index];
    if (given.source < 0) return std::nullopt;
    std::array<TextureWrap, 2> wrap{TextureWrap::repeat, TextureWrap::repeat};
    if (given.sampler >= 0) {
      const tinygltf::Sampler& sampler = model_.samplers[static_cast<std::size_t>(given.sampler)];
      wrap = {wrap_of(sampler.wrapS), wrap_of(sampler.wrapT)};
    }
    const auto image = static_cast<std::size_t>(given.source);
    const auto [found, is_new] = textures_.try_emplace({image, wrap}, static_cast<std::uint16_t>(scene().textures.size()));
    if (!is_new) return found->second;
    require(scene().textures.size() < kMaxTextures, source_, "at most 65536 textures", "more");
    Texture texture = image_of(image);
    texture.wrap = wrap;
    scene().textures.push_back(std::move(texture));
    return found->second;
  }

  // An image with other borders is a texture of its own.
  Texture image_of(std::size_t index) {
    const GltfImage& given = gltf_.images[index];
    Texture texture;
    texture.name = texture_names_.unused(given.name.empty() ? "image " + std::to_string(index) : given.name);
    const std::string name = field("images", index);
    Image image;
    if (given.buffer_view) {
      const tinygltf::BufferView& view = model_.bufferViews[*given.buffer_view];
      const auto& bytes = model_.buffers[static_cast<std::size_t>(view.buffer)].data;
      image = decode_image(std::span(bytes).subspan(view.byteOffset, view.byteLength), name, pixels_left_);
    } else {
      const std::string bytes = files_.read(given.uri, name + "/uri", "an image");
      image = decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, name, pixels_left_);
    }
    pixels_left_ -= image.rgba.size() / 4;
    texture.width_px = image.width_px;
    texture.height_px = image.height_px;
    texture.rgba = std::move(image.rgba);
    return texture;
  }

  // --------------------------------------------------------------------------------------------------------- nodes

  struct Placed {
    std::size_t node;
    Eigen::Affine3d place;  // of its parent
    int semantic;           // that it inherits, 0 for none
  };

  void read_nodes() {
    std::vector<int> roots;
    if (model_.defaultScene >= 0) {
      roots = model_.scenes[static_cast<std::size_t>(model_.defaultScene)].nodes;
    } else {
      std::vector<bool> is_child(model_.nodes.size(), false);
      for (const tinygltf::Node& node : model_.nodes) {
        for (const int child : node.children) is_child[static_cast<std::size_t>(child)] = true;
      }
      for (std::size_t i = 0; i < is_child.size(); ++i) {
        if (!is_child[i]) roots.push_back(static_cast<int>(i));
      }
    }
    // Each node is met once, so that the tree is one, and neither its depth nor a circle in it matters.
    std::vector<bool> is_met(model_.nodes.size(), false);
    std::vector<Placed> open;
    const auto push = [&](const std::vector<int>& nodes, const Eigen::Affine3d& place, int semantic) {
      for (auto i = nodes.rbegin(); i != nodes.rend(); ++i) open.push_back({static_cast<std::size_t>(*i), place, semantic});
      for (const int i : nodes) {
        const auto node = static_cast<std::size_t>(i);
        if (is_met[node]) refuse(field("nodes", node), "a node in one place of the scene", "one that is in two, or in itself");
        is_met[node] = true;
      }
    };
    push(roots, place_, 0);
    while (!open.empty()) {
      Interrupt::poll();
      const Placed at = open.back();
      open.pop_back();
      const tinygltf::Node& node = model_.nodes[at.node];
      const Eigen::Affine3d place = at.place * transform_of(node, at.node);
      if (!place.matrix().allFinite()) refuse(field("nodes", at.node), "a finite transform", "one that overflows");
      const int own = semantic_of(node.extras);
      const int semantic = own != 0 ? own : at.semantic;
      read_node(node, at.node, place, semantic);
      push(node.children, place, semantic);
    }
  }

  Eigen::Affine3d transform_of(const tinygltf::Node& node, std::size_t index) const {
    if (!node.matrix.empty()) {
      const Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix4d>(node.matrix.data());  // column by column
      if (!matrix.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), 1e-6)) {
        refuse(field("nodes", index) + "/matrix", "0, 0, 0, 1 as the last row", "another");
      }
      return Eigen::Affine3d(Eigen::AffineCompact3d(matrix.topRows<3>()));
    }
    Eigen::Affine3d place = Eigen::Affine3d::Identity();
    if (!node.translation.empty()) place.translate(Vec3d(node.translation[0], node.translation[1], node.translation[2]));
    if (!node.rotation.empty()) {
      const Eigen::Quaterniond q(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
      constexpr double kTolerance = 0.01;  // exporters round, and it is made unit
      require(std::abs(q.norm() - 1.0) <= kTolerance, field("nodes", index) + "/rotation", "a quaternion of norm 1", q.norm());
      place.rotate(q.normalized());
    }
    if (!node.scale.empty()) place.scale(Vec3d(node.scale[0], node.scale[1], node.scale[2]));
    return place;
  }

  void read_node(const tinygltf::Node& node, std::size_t index, const Eigen::Affine3d& place, int semantic) {
    if (node.extras.Has(kGltfMarker)) read_marker(node.extras.Get(kGltfMarker).Get<std::string>(), index, place.translation());
    if (node.extras.Has(kGltfSun)) {
      const Vec3d towards = place.linear() * Vec3d::UnitZ();  // a light shines along its -z
      if (!(towards.norm() > 0.0)) refuse(field("nodes", index), "a light with a direction", "one scaled to nothing");
      const Vec3d unit = towards.normalized();
      if (++suns_ == 1)
        scene().light.sun_direction = {static_cast<float>(unit.x()), static_cast<float>(unit.y()), static_cast<float>(unit.z())};
    }
    if (node.mesh < 0) return;
    require(shown_.size() < kMaxObjects, field("nodes", index), "at most 65536 nodes with a mesh", "more");
    const auto mesh = static_cast<std::size_t>(node.mesh);
    if (triangles_of_.empty()) count_triangles();
    num_triangles_ += triangles_of_[mesh];
    require(num_triangles_ <= kMaxGltfTriangles, source_, "at most " + std::to_string(kMaxGltfTriangles) + " triangles", "more");
    shown_.push_back({mesh, place, semantic});
  }

  void read_marker(std::string_view name, std::size_t index, const Vec3d& place) {
    const auto point = [&] {
      const bool is_near = place.cwiseAbs().maxCoeff() <= kMaxCoordinate;
      if (!is_near) refuse(field("nodes", index), "a marker within +-1e+06 m", written(place));
      return Vec3(place.cast<float>());
    };
    Markers& markers = scene().markers;
    if (name == "start" || name == "goal") {
      std::optional<Vec3>& marker = name == "start" ? markers.start : markers.goal;
      if (marker) refuse(field("nodes", index), "one " + std::string(name), "a second");
      marker = point();
      return;
    }
    std::uint32_t number = 0;
    const std::size_t dot = name.find('.');
    if (dot != name.npos) std::from_chars(name.data() + dot + 1, name.data() + name.size(), number);
    waypoints_.push_back({number, point()});
  }

  // By their numbers, and as the nodes come where these are equal.
  void order_waypoints() {
    std::stable_sort(waypoints_.begin(), waypoints_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [number, point] : waypoints_) scene().markers.waypoints.push_back(point);
  }

  // -------------------------------------------------------------------------------------------------------- meshes

  // A mesh of a node, an object.
  struct Shown {
    std::size_t mesh;
    Eigen::Affine3d place;
    int semantic;
  };

  static std::size_t num_triangles(const tinygltf::Primitive& primitive, std::size_t num_corners) {
    return primitive.mode == TINYGLTF_MODE_TRIANGLES ? num_corners / 3 : std::max<std::size_t>(num_corners, 2) - 2;
  }

  // Of each mesh, one for a primitive that has none: its part in what many nodes that show it cost.
  void count_triangles() {
    for (const tinygltf::Mesh& mesh : model_.meshes) {
      std::size_t& sum = triangles_of_.emplace_back(1);
      for (const tinygltf::Primitive& primitive : mesh.primitives) {
        const int corners = primitive.indices >= 0 ? primitive.indices : primitive.attributes.at("POSITION");
        const std::size_t count = num_triangles(primitive, model_.accessors[static_cast<std::size_t>(corners)].count);
        sum = std::min(sum + std::max<std::size_t>(count, 1), kMaxGltfTriangles + 1);
      }
    }
  }

  void read_mesh(const Shown& shown) {
    const auto object = static_cast<std::uint16_t>(objects_++);
    for (const tinygltf::Primitive& primitive : model_.meshes[shown.mesh].primitives) {
      read_primitive(primitive, shown.place, shown.semantic, object);
    }
  }

  Elements elements_of(int index, std::initializer_list<int> types, const char* expected) const {
    const auto accessor = static_cast<std::size_t>(index);
    const tinygltf::Accessor& given = model_.accessors[accessor];
    if (std::find(types.begin(), types.end(), given.type) == types.end())
      refuse(field("accessors", accessor), expected, "others");
    if (given.bufferView < 0) {
      refuse(field("accessors", accessor), "an accessor with a bufferView, and not sparse", "another");
    }
    return Elements(model_, accessor);
  }

  // Of each triangle, its three corners as numbers of vertices.
  std::vector<std::uint32_t> corners_of(const tinygltf::Primitive& primitive, std::size_t num_vertices) {
    std::optional<Elements> indices;
    if (primitive.indices >= 0) {
      const auto accessor = static_cast<std::size_t>(primitive.indices);
      const int type = model_.accessors[accessor].componentType;
      const bool is_unsigned = type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
                               type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
      if (!is_unsigned) refuse(field("accessors", accessor), "unsigned integers as indices", "others");
      indices.emplace(elements_of(primitive.indices, {TINYGLTF_TYPE_SCALAR}, "SCALAR indices"));
    }
    const std::size_t count = indices ? indices->size() : num_vertices;
    if (primitive.mode == TINYGLTF_MODE_TRIANGLES && count % 3 != 0) {
      const int accessor = primitive.indices >= 0 ? primitive.indices : primitive.attributes.at("POSITION");
      refuse(field("accessors", static_cast<std::size_t>(accessor)), "three corners for each triangle", count);
    }

    const std::size_t triangles = num_triangles(primitive, count);
    std::vector<std::uint32_t> corners;
    corners.reserve(3 * triangles);
    const auto push = [&](std::size_t i) {
      const std::uint32_t vertex = indices ? indices->index(i) : static_cast<std::uint32_t>(i);
      if (vertex >= num_vertices) {
        refuse(field("accessors", static_cast<std::size_t>(primitive.indices)),
               "indices of " + std::to_string(num_vertices) + " vertices", vertex);
      }
      corners.push_back(vertex);
    };
    for (std::size_t i = 0; i < triangles; ++i) {
      if (i % 4096 == 0) Interrupt::poll();
      std::array<std::size_t, 3> triangle{3 * i, 3 * i + 1, 3 * i + 2};
      if (primitive.mode == TINYGLTF_MODE_TRIANGLE_STRIP) triangle = {i, i + 1 + i % 2, i + 2 - i % 2};
      if (primitive.mode == TINYGLTF_MODE_TRIANGLE_FAN) triangle = {i + 1, i + 2, 0};
      for (const std::size_t corner : triangle) push(corner);
    }
    return corners;
  }

  // Where in its texture each vertex of a primitive is.
  std::optional<Elements> uv_of(const tinygltf::Primitive& primitive, std::size_t num_vertices) const {
    const tinygltf::TextureInfo& texture =
        model_.materials[static_cast<std::size_t>(primitive.material)].pbrMetallicRoughness.baseColorTexture;
    const auto found = primitive.attributes.find("TEXCOORD_" + std::to_string(texture.texCoord));
    if (found == primitive.attributes.end()) return std::nullopt;
    const Elements uv = elements_of(found->second, {TINYGLTF_TYPE_VEC2}, "VEC2 texture coordinates");
    require(uv.size() == num_vertices, field("accessors", static_cast<std::size_t>(found->second)),
            "as many texture coordinates as positions (" + std::to_string(num_vertices) + ')', uv.size());
    return uv;
  }

  // The colour of each vertex of a primitive. Alpha is not read.
  std::optional<Elements> colors_of(const tinygltf::Primitive& primitive, std::size_t num_vertices) const {
    const auto found = primitive.attributes.find("COLOR_0");
    if (found == primitive.attributes.end()) return std::nullopt;
    const Elements colors = elements_of(found->second, {TINYGLTF_TYPE_VEC3, TINYGLTF_TYPE_VEC4}, "VEC3 or VEC4 colours");
    require(colors.size() == num_vertices, field("accessors", static_cast<std::size_t>(found->second)),
            "as many colours as positions (" + std::to_string(num_vertices) + ')', colors.size());
    return colors;
  }

  void read_primitive(const tinygltf::Primitive& primitive, const Eigen::Affine3d& place, int semantic, std::uint16_t object) {
    Interrupt::poll();
    const int position = primitive.attributes.at("POSITION");
    const Elements positions = elements_of(position, {TINYGLTF_TYPE_VEC3}, "VEC3 positions");
    const std::vector<std::uint32_t> corners = corners_of(primitive, positions.size());
    const std::uint16_t material = material_of(primitive.material, semantic);
    const bool is_textured = scene().materials[material].texture.has_value();
    const std::optional<Elements> uv = is_textured ? uv_of(primitive, positions.size()) : std::nullopt;
    const UvTransform to_image(
        uv ? model_.materials[static_cast<std::size_t>(primitive.material)].pbrMetallicRoughness.baseColorTexture
           : tinygltf::TextureInfo());

    const std::optional<Elements> colors = colors_of(primitive, positions.size());

    // Many primitives may share their vertices: of these, those that are used.
    std::vector<std::uint32_t> used = corners;
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    TriangleMesh& mesh = scene().mesh;
    std::vector<std::array<float, 3>> shown_colors;
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    for (const std::uint32_t vertex : used) {
      if (vertex % 4096 == 0) Interrupt::poll();
      const Vec3d given(positions.number(vertex, 0), positions.number(vertex, 1), positions.number(vertex, 2));
      const Vec3d point = place * given;
      if (!(point.cwiseAbs().maxCoeff() <= kMaxCoordinate) || !point.allFinite()) {
        refuse(field("accessors", static_cast<std::size_t>(position)), "finite positions that come to lie within +-1e+06 m",
               written(point));
      }
      mesh.vertices.push_back(point.cast<float>());
      Vec2d where = Vec2d::Zero();
      if (uv) where = to_image.turn * Vec2d(uv->number(vertex, 0), uv->number(vertex, 1)) + to_image.offset;
      mesh.uv.push_back({static_cast<float>(where.x()), static_cast<float>(where.y())});
      if (!colors) continue;
      std::array<float, 3>& shown = shown_colors.emplace_back();
      for (std::size_t c = 0; c < 3; ++c) shown[c] = static_cast<float>(std::clamp(colors->number(vertex, c), 0.0, 1.0));
    }
    append_colors(shown_colors, used.size(), mesh);
    const bool is_mirrored = place.linear().determinant() < 0.0;
    for (std::size_t i = 0; i < corners.size(); i += 3) {
      std::array<std::int32_t, 3> triangle{};
      for (std::size_t k = 0; k < 3; ++k) {
        triangle[k] =
            first + static_cast<std::int32_t>(std::lower_bound(used.begin(), used.end(), corners[i + k]) - used.begin());
      }
      if (is_mirrored) std::swap(triangle[1], triangle[2]);
      const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
      if (is_degenerate(corner(0), corner(1), corner(2))) {
        ++dropped_;
        continue;
      }
      mesh.triangles.push_back(triangle);
      mesh.materials.push_back(material);
      mesh.objects.push_back(object);
    }
  }

  const GltfModel& gltf_;
  const tinygltf::Model& model_;
  const std::string& source_;
  GltfFiles& files_;
  Eigen::Affine3d place_;
  GltfFile file_;
  Names material_names_, texture_names_;
  std::map<std::pair<int, int>, std::uint16_t> materials_;  // by the file's, -1 for none, and the class of a node, 0 for none
  std::map<std::pair<std::size_t, std::array<TextureWrap, 2>>, std::uint16_t> textures_;
  std::vector<std::pair<std::uint32_t, Vec3>> waypoints_;
  std::vector<std::size_t> triangles_of_;  // by mesh
  std::vector<Shown> shown_;
  std::size_t pixels_left_ = kMaxScenePixels;
  std::size_t objects_ = 0, num_triangles_ = 0, dropped_ = 0, suns_ = 0;
};

}  // namespace

GltfFile parse_gltf(const std::string& bytes, const std::string& source, const std::filesystem::path& folder,
                    const LoadOptions& options) {
  GltfFiles files(source, folder, options.files);
  const GltfModel model = read_gltf_model(bytes, source, files);
  return GltfReader(model, source, files, options).read();
}

GltfFile load_gltf(const std::filesystem::path& path, const LoadOptions& options) {
  GltfFile file = parse_gltf(read_text_file(path, "a glTF file"), path.string(), path.parent_path(), options);
  file.scene.name = path.stem().string();
  return file;
}

}  // namespace flockstep
