#include "formats/gltf.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/in_world.hpp"
#include "base/indices.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "formats/gltf_extras.hpp"
#include "formats/gltf_model.hpp"
#include "formats/image.hpp"
#include "formats/names.hpp"
#include "formats/placement.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using Vec3d = Eigen::Vector3d;
using Vec2d = Eigen::Vector2d;

// Elements of an accessor; the model guarantees that they lie within its buffers.
class Elements {
 public:
  Elements(const GltfModel& model, std::size_t accessor)
      : accessor_(model.accessors[accessor]), size_(accessor_.component_bytes()) {
    const GltfView& view = model.views[*accessor_.view];
    stride_ = view.stride != 0 ? view.stride : accessor_.element_bytes();
    first_ = model.buffers[view.buffer].data() + view.offset + accessor_.offset;
  }

  std::size_t size() const { return accessor_.count; }

  std::uint32_t index(std::size_t element) const {
    const char* const at = first_ + element * stride_;
    if (size_ == 1) return as<std::uint8_t>(at);
    return size_ == 2 ? as<std::uint16_t>(at) : as<std::uint32_t>(at);
  }

  double number(std::size_t element, std::size_t component) const {
    const char* const at = first_ + element * stride_ + component * size_;
    switch (accessor_.component) {
      case GltfComponent::int8:
        return whole<std::int8_t>(at);
      case GltfComponent::uint8:
        return whole<std::uint8_t>(at);
      case GltfComponent::int16:
        return whole<std::int16_t>(at);
      case GltfComponent::uint16:
        return whole<std::uint16_t>(at);
      case GltfComponent::uint32:
        return whole<std::uint32_t>(at);
      case GltfComponent::float32:
        break;
    }
    return as<float>(at);
  }

 private:
  template <class T>
  static T as(const char* at) {  // may be unaligned
    T value;
    std::memcpy(&value, at, sizeof value);
    return value;
  }
  template <class T>
  double whole(const char* at) const {
    const double value = as<T>(at);
    return accessor_.is_normalized ? std::max(value / std::numeric_limits<T>::max(), -1.0) : value;
  }

  const GltfAccessor& accessor_;
  std::size_t size_;  // bytes of a component
  std::size_t stride_ = 0;
  const char* first_ = nullptr;
};

// KHR_texture_transform: scale, then turn counter-clockwise as seen in the image, then move.
struct UvTransform {
  Eigen::Matrix2d turn;
  Vec2d offset;

  explicit UvTransform(const GltfTextureTransform& given) : offset(given.offset[0], given.offset[1]) {
    const double cosine = std::cos(given.rotation), sine = std::sin(given.rotation);
    turn << cosine * given.scale[0], sine * given.scale[1], -sine * given.scale[0], cosine * given.scale[1];
  }
};

// Rotation from the file's axes to the world's.
const Eigen::Affine3d& upright() {
  static const Eigen::Affine3d kUpright = placement({}, UpAxis::y);
  return kUpright;
}

// Returns the transformed point. A point that is only turned upright keeps all its bits, including -0.
Vec3d applied(const Eigen::Affine3d& place, const Vec3d& point) {
  if (place.matrix() == upright().matrix()) return {point.x(), -point.z(), point.y()};
  return place * point;
}

// Properties of a surface that do not depend on its triangulation or the order of triangles.
struct Extent {
  Vec3d min = Vec3d::Constant(std::numeric_limits<double>::infinity());
  Vec3d max = -min;
  double area = 0.0;

  void add(const std::array<Vec3d, 3>& triangle) {
    for (const Vec3d& corner : triangle) {
      min = min.cwiseMin(corner);
      max = max.cwiseMax(corner);
    }
    area += 0.5 * (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).norm();
  }

  bool is_about(const Extent& other) const {
    constexpr double kTolerance = 1e-3;  // larger than quantization errors
    const Vec3d size = other.max - other.min;
    const Vec3d most = kTolerance * (size + Vec3d::Constant(kTolerance * size.maxCoeff()));
    return ((min - other.min).cwiseAbs().array() <= most.array()).all() &&
           ((max - other.max).cwiseAbs().array() <= most.array()).all() && std::abs(area - other.area) <= kTolerance * other.area;
  }
};

class GltfReader {
 public:
  GltfReader(const GltfModel& gltf, const std::string& source, GltfFiles& files, const LoadOptions& options)
      : model_(gltf), source_(source), files_(files), options_(options), place_(placement(options, UpAxis::y)) {
    file_.ignored = gltf.ignored;
    file_.scene.materials.clear();
  }

  GltfFile read() {
    read_scene_extras();
    for (std::size_t i = 0; i < model_.materials.size(); ++i) add_material(i, 0);
    read_nodes();
    for (const Shown& shown : shown_) read_mesh(shown);
    finish_bodies();
    order_waypoints();
    if (scene().materials.empty()) material_of(std::nullopt, 0);
    if (dropped_ > 0) {
      file_.ignored.push_back(words_of_flat(dropped_));
    }
    if (reshaped_ > 0) {
      file_.ignored.push_back(std::to_string(reshaped_) + (reshaped_ == 1 ? " primitive" : " primitives") +
                              " whose extras describe another shape than the mesh, which is used instead");
    }
    if (suns_ > 1) file_.ignored.push_back("all but the first of " + std::to_string(suns_) + " directional lights");
    if (scene().mesh.triangles.empty() && scene().primitives.empty() && scene().gates.empty()) {
      std::string others;
      for (const std::string& what : file_.ignored) others += (others.empty() ? ", but " : ", ") + what;
      refuse(source_, "at least one triangle with an area", "none" + others);
    }
    file_.has_name = is_ours_;
    return std::move(file_);
  }

 private:
  SceneDescription& scene() { return file_.scene; }

  std::string field(const char* list, std::size_t index) const { return source_ + ": /" + list + '/' + std::to_string(index); }

  // A node's own flags take precedence over inherited ones.
  static Visibility visibility_of(const GltfNode& node, Visibility inherited) {
    if (node.visual_only == true) return Visibility::visual;
    if (node.collision_only == true) return Visibility::solid;
    const bool is_off = (inherited == Visibility::visual && node.visual_only == false) ||
                        (inherited == Visibility::solid && node.collision_only == false);
    return is_off ? Visibility::full : inherited;
  }

  // -------------------------------------------------------------------------------------- what flockstep itself has written

  const std::optional<GltfSceneExtras>& scene_extras() const {
    static const std::optional<GltfSceneExtras> kNone;
    return model_.scene ? model_.scenes[*model_.scene].extras : kNone;
  }

  // Extras are in the world frame. They are transformed to the file's frame and then placed as the options say.
  void read_scene_extras() {
    if (!scene_extras()) return;
    is_ours_ = true;
    const auto& [light, markers, bodies] = *scene_extras();
    scene().name = model_.scenes[*model_.scene].name;
    scene().light = light;
    scene().markers = markers;
    scene().bodies = bodies;
    for (std::size_t i = 0; i < model_.textures.size(); ++i) texture_of(i);  // includes textures without a material
    if (place_.matrix() == upright().matrix()) return;
    const Eigen::Affine3d place = place_ * upright().inverse();
    scene().markers.radius = static_cast<float>(markers.radius * options_.scale);
    for (BodyConfig& body : scene().bodies) place_body(body, place, options_.scale);
    if (markers.spawn_box) {
      const Vec3 a = (place * markers.spawn_box->min.cast<double>()).cast<float>();
      const Vec3 b = (place * markers.spawn_box->max.cast<double>()).cast<float>();
      scene().markers.spawn_box = Aabb{a.cwiseMin(b), a.cwiseMax(b)};
    }
    auto& sun = scene().light.sun_direction;
    const Vec3 direction = unit_direction(place.linear() / options_.scale * Vec3d(sun[0], sun[1], sun[2]));
    sun = {direction.x(), direction.y(), direction.z()};
  }

  // Reads a node whose extras say that its mesh represents a primitive. Returns false if the mesh is not that primitive, or if
  // the node's transform turns it into another shape.
  bool read_primitive_of(const GltfNode& node, std::size_t index, bool is_root, const Eigen::Affine3d& place, int semantic,
                         Visibility visibility) {
    const std::size_t mesh = *node.mesh;
    Primitive primitive = *node.extras.primitive;
    if (model_.meshes[mesh].size() != 1 || !is_tessellation(mesh, primitive)) return false;

    Vec3d scale;
    if (is_root && options_.up != UpAxis::z && !node.matrix) {  // keeps every bit
      const auto& [q, s] = std::tie(node.rotation, node.scale);
      if (q) primitive.rotation = unit_quaternion({(*q)[3], (*q)[0], -(*q)[2], (*q)[1]});
      scale = s ? Vec3d(Vec3d((*s)[0], (*s)[2], (*s)[1]).cwiseAbs()) : Vec3d::Ones();
      scale *= options_.scale;
    } else {
      Eigen::Matrix3d axes = place.linear() * upright().linear().inverse();
      scale = axes.colwise().norm();
      if (!(scale.minCoeff() > 0.0)) return false;
      axes.array().rowwise() /= scale.transpose().array();
      if (!(axes.transpose() * axes).isIdentity(kRounding)) return false;
      if (axes.determinant() < 0.0) axes.col(0) *= -1.0;  // all primitives are symmetric
      const Eigen::Quaterniond q = Eigen::Quaterniond(axes).normalized();
      primitive.rotation = unit_quaternion({q.w(), q.x(), q.y(), q.z()});
    }
    if (!take_size(primitive, scale)) return false;

    const Vec3d center = place.translation();
    const Vec3& half = primitive.half_extents;
    const bool is_flat = primitive.kind == PrimitiveKind::plane || primitive.kind == PrimitiveKind::disc;
    const bool fits = center.cwiseAbs().maxCoeff() <= kMaxCoordinate && half.maxCoeff() <= static_cast<float>(kMaxCoordinate) &&
                      half.head(is_flat ? 2 : 3).minCoeff() >= static_cast<float>(kMinSize);
    if (!fits) refuse(field("nodes", index), in_world("a primitive") + ", of sizes >= 1e-06 m", coordinates(center));
    primitive.center = center.cast<float>();
    primitive.material = material_of(model_.meshes[mesh][0].material, semantic);
    // Rooms are always visible and solid.
    primitive.visibility = primitive.kind == PrimitiveKind::room ? Visibility::full : visibility;
    scene().primitives.push_back(primitive);
    return true;
  }

  // Reads a gate at the place of its node. Its mesh, which shows the frame, is not read: the gate makes its frame.
  void read_gate_of(const GltfNode& node, std::size_t index, bool is_root, const Eigen::Affine3d& place, int semantic,
                    Visibility visibility) {
    Gate gate = *node.extras.gate;
    double scale = options_.scale;
    if (is_root && options_.up != UpAxis::z && !node.matrix && !node.scale) {  // keeps every bit
      const auto& q = node.rotation;
      if (q) gate.rotation = unit_quaternion({(*q)[3], (*q)[0], -(*q)[2], (*q)[1]});
    } else {
      Eigen::Matrix3d axes = place.linear() * upright().linear().inverse();
      scale = std::cbrt(axes.determinant());
      if (scale > 0.0) axes /= scale;
      const bool is_turn = scale > 0.0 && (axes.transpose() * axes).isIdentity(kRounding);
      if (!is_turn)
        refuse(field("nodes", index), "a gate that is moved, turned and scaled alike along all axes", "another transform");
      const Eigen::Quaterniond q = Eigen::Quaterniond(axes).normalized();
      gate.rotation = unit_quaternion({q.w(), q.x(), q.y(), q.z()});
    }
    const Vec3d center = place.translation();
    const auto sized = [&](float length) { return static_cast<float>(length * scale); };
    gate.size = sized(gate.size);
    gate.bar = sized(gate.bar);
    const bool fits = center.cwiseAbs().maxCoeff() + static_cast<double>(gate.size + 2.0F * gate.bar) <= kMaxCoordinate &&
                      std::min(gate.size, gate.bar) >= static_cast<float>(2.0 * kMinSize);
    if (!fits) refuse(field("nodes", index), in_world("a gate") + ", of sizes >= 2e-06 m", coordinates(center));
    require(scene().gates.size() < kMaxGates, field("nodes", index), "at most " + std::to_string(kMaxGates) + " gates", "more");
    gate.center = center.cast<float>();
    const std::vector<GltfPrimitive>& parts = model_.meshes[*node.mesh];
    gate.material = material_of(parts.empty() ? std::nullopt : parts[0].material, semantic);
    gate.visibility = visibility;
    scene().gates.push_back(gate);
  }

  // Returns false if the scale distorts a round primitive, or if a room has a rotation that is not a multiple of 90 degrees.
  static bool take_size(Primitive& primitive, Vec3d scale) {
    const auto is_even = [&](int a, int b) { return std::abs(scale[a] - scale[b]) <= kRounding * scale[a]; };
    switch (primitive.kind) {
      case PrimitiveKind::room: {
        const Eigen::Matrix3d axes = primitive.rotation.toRotationMatrix().cast<double>().cwiseAbs();
        if (!(axes.cwiseProduct(axes) - axes).isZero(kRounding)) return false;  // all entries are 0 or 1
        if (!primitive.rotation.coeffs().isApprox(Quat::Identity().coeffs(), 0.0F)) {
          scale = axes * scale;
          primitive.rotation = Quat::Identity();
        }
        break;
      }
      case PrimitiveKind::sphere:
      case PrimitiveKind::capsule:
        if (!is_even(0, 1) || !is_even(0, 2)) return false;
        scale = Vec3d::Constant(scale[0]);
        if (primitive.kind == PrimitiveKind::sphere) primitive.rotation = Quat::Identity();
        break;
      case PrimitiveKind::cylinder:
      case PrimitiveKind::disc:
        if (!is_even(0, 1)) return false;
        scale[1] = scale[0];
        break;
      default:
        break;
    }
    primitive.half_extents = primitive.half_extents.cast<double>().cwiseProduct(scale).cwiseMin(1e30).cast<float>();
    return true;
  }

  // Returns whether a mesh is still the tessellation that was written for the primitive.
  bool is_tessellation(std::size_t mesh, const Primitive& primitive) {
    const auto& half = primitive.half_extents;
    const auto [known, is_new] = tessellations_.try_emplace({primitive.kind, half.x(), half.z()});
    if (is_new) {
      const TriangleMesh triangles = gltf_tessellation(primitive);
      for (const auto& corners : triangles.triangles) {
        std::array<Vec3d, 3> triangle;
        for (std::size_t k = 0; k < 3; ++k) triangle[k] = triangles.vertices[static_cast<std::size_t>(corners[k])].cast<double>();
        known->second.add(triangle);
      }
    }
    const auto [extent, is_unknown] = extents_.try_emplace(mesh);
    if (is_unknown) extent->second = extent_of(mesh);
    return extent->second.is_about(known->second);
  }

  Extent extent_of(std::size_t mesh) {
    count_triangles(mesh);
    const GltfPrimitive& primitive = model_.meshes[mesh][0];
    const Elements positions = elements_of(primitive.attributes.at("POSITION"), {GltfShape::vec3}, "VEC3 positions");
    const std::vector<std::uint32_t> corners = corners_of(primitive, positions.size());
    Extent extent;
    for (std::size_t i = 0; i < corners.size(); i += 3) {
      if (i % 4096 == 0) Interrupt::poll();
      std::array<Vec3d, 3> triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t vertex = corners[i + k];
        triangle[k] = applied(upright(), {positions.number(vertex, 0), positions.number(vertex, 1), positions.number(vertex, 2)});
      }
      extent.add(triangle);
    }
    return extent;
  }

  // ----------------------------------------------------------------------------------------------------- materials

  std::uint16_t push_material(Material material, const std::string& wanted_name) {
    require(scene().materials.size() < kMaxMaterials, source_,
            "at most " + std::to_string(kMaxMaterials) + " materials, those of nodes with a semantic included", "more");
    material.name = material_names_.take(wanted_name);
    scene().materials.push_back(std::move(material));
    return static_cast<std::uint16_t>(scene().materials.size() - 1);
  }

  // Adds material i of the file, with the semantic of the node if it has one.
  std::uint16_t add_material(std::size_t i, int semantic) {
    const GltfMaterial& given = model_.materials[i];
    Material material;
    for (std::size_t c = 0; c < 3; ++c) {
      material.base_color[c] = static_cast<float>(given.base_color[c]);
      material.emissive[c] = static_cast<float>(given.emissive[c]);
    }
    if (given.alpha_cutoff) material.alpha_cutoff = static_cast<float>(*given.alpha_cutoff);
    if (given.is_unlit) material.emissive = std::exchange(material.base_color, {});
    material.semantic = static_cast<std::uint16_t>(semantic != 0 ? semantic : given.semantic);
    if (given.texture) material.texture = texture_of(*given.texture);
    const std::string name = given.name.empty() && !is_ours_ ? "material " + std::to_string(i) : given.name;
    const std::uint16_t index = push_material(std::move(material), name);
    materials_.emplace(std::pair(std::optional(i), semantic), index);
    return index;
  }

  std::uint16_t material_of(const std::optional<std::size_t>& material, int semantic) {
    const auto found = materials_.find({material, semantic});
    if (found != materials_.end()) return found->second;
    if (material) return add_material(*material, semantic);
    const std::uint16_t index =
        push_material(Material{"", {1.0F, 1.0F, 1.0F}, static_cast<std::uint16_t>(semantic)}, "default");  // glTF's default
    materials_.emplace(std::pair(material, semantic), index);
    return index;
  }

  std::optional<std::uint16_t> texture_of(std::size_t index) {
    const auto& [wrap, source] = model_.textures[index];
    if (!source) return std::nullopt;
    const std::size_t image = *source;
    const auto [found, is_new] = textures_.try_emplace({image, wrap}, static_cast<std::uint16_t>(scene().textures.size()));
    if (!is_new) return found->second;
    require(scene().textures.size() < kMaxTextures, source_, "at most 65536 textures", "more");
    Texture texture = image_of(image);
    texture.wrap = wrap;
    scene().textures.push_back(std::move(texture));
    return found->second;
  }

  // The same image with other wrap modes is a separate texture.
  Texture image_of(std::size_t index) {
    const GltfImage& given = model_.images[index];
    Texture texture;
    texture.name = texture_names_.take(given.name.empty() && !is_ours_ ? "image " + std::to_string(index) : given.name);
    const std::string name = field("images", index);
    Image image;
    if (given.view) {
      const GltfView& view = model_.views[*given.view];
      const std::string_view bytes = model_.buffers[view.buffer].substr(view.offset, view.length);
      image = decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, name, pixels_left_);
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
    Eigen::Affine3d place;  // transform of the parent
    int semantic;           // inherited; 0 if no ancestor has one
    Visibility visibility;  // inherited; full if no ancestor restricts it
    bool is_root;
    std::size_t body;  // number of the body that an ancestor is, or kNone
  };

  void read_nodes() {
    std::vector<std::size_t> roots;
    if (model_.scene) {
      roots = model_.scenes[*model_.scene].nodes;
    } else {
      std::vector<bool> is_child(model_.nodes.size(), false);
      for (const GltfNode& node : model_.nodes) {
        for (const std::size_t child : node.children) is_child[child] = true;
      }
      for (std::size_t i = 0; i < is_child.size(); ++i) {
        if (!is_child[i]) roots.push_back(i);
      }
    }
    // Each node may be visited only once. This rejects cycles, and depth does not matter because there is no recursion.
    std::vector<bool> is_met(model_.nodes.size(), false);
    std::vector<Placed> open;
    const auto push = [&](const std::vector<std::size_t>& nodes, const Eigen::Affine3d& place, int semantic,
                          Visibility visibility, bool are_roots, std::size_t body) {
      for (auto i = nodes.rbegin(); i != nodes.rend(); ++i) {
        open.push_back({*i, place, semantic, visibility, are_roots, body});
      }
      for (const std::size_t node : nodes) {
        if (is_met[node]) refuse(field("nodes", node), "a node with one parent", "one with two, or that contains itself");
        is_met[node] = true;
      }
    };
    push(roots, place_, 0, Visibility::full, true, kNone);
    while (!open.empty()) {
      Interrupt::poll();
      const Placed at = open.back();
      open.pop_back();
      const GltfNode& node = model_.nodes[at.node];
      const Eigen::Affine3d own_place = transform_of(node, at.node);
      Eigen::Affine3d place = at.place * own_place;
      place.translation() = applied(at.place, own_place.translation());
      if (!place.matrix().allFinite()) refuse(field("nodes", at.node), "a finite transform", "one with infinite numbers");
      const int semantic = node.semantic != 0 ? node.semantic : at.semantic;
      const Visibility visibility = visibility_of(node, at.visibility);
      const std::size_t body = node.body ? begin_body(node, at, place) : at.body;
      if (body == kNone) {
        read_node(node, at, place, semantic, visibility);
      } else if (node.mesh) {
        count_triangles(*node.mesh);
        bodies_[body].reader->shown_.push_back(
            {*node.mesh, at.node, bodies_[body].frame.inverse() * place, semantic, visibility});
      }
      push(node.children, place, semantic, visibility, false, body);
    }
  }

  // A node that is a body, with its descendants.
  struct BodyNode {
    std::size_t node;
    Eigen::Affine3d frame;               // frame of the body, without scale
    std::unique_ptr<GltfReader> reader;  // reads the mesh, in the body frame
  };

  std::size_t begin_body(const GltfNode& node, const Placed& at, const Eigen::Affine3d& place) {
    const std::string name = field("nodes", at.node) + "/extras/" + kGltfBody;
    if (at.body != kNone) refuse(name, "no body inside another one", "one");
    require(scene().bodies.size() < kMaxBodies, name, "at most " + std::to_string(kMaxBodies) + " bodies", "more");
    Eigen::Matrix3d axes = place.linear() * upright().linear().inverse();
    const Vec3d scale = axes.colwise().norm();
    axes.array().rowwise() /= scale.transpose().array();
    if (!(scale.minCoeff() > 0.0) || !(axes.transpose() * axes).isIdentity(kRounding)) {
      refuse(field("nodes", at.node), "a body that is moved, turned and scaled along its axes", "another transform");
    }
    if (axes.determinant() < 0.0) axes.col(0) *= -1.0;  // the mesh is mirrored
    const Vec3d position = place.translation();
    if (!(position.cwiseAbs().maxCoeff() <= kMaxCoordinate))
      refuse(field("nodes", at.node), in_world("a body"), coordinates(position));
    BodyConfig& body = scene().bodies.emplace_back(*node.body);
    if (place_.matrix() != upright().matrix()) place_body(body, place_ * upright().inverse(), options_.scale);
    const Eigen::Quaterniond turned = Eigen::Quaterniond(axes).normalized();
    const Quat rotation = unit_quaternion({turned.w(), turned.x(), turned.y(), turned.z()});
    body.shape = BodyShape::mesh;
    body.size_m = BodyConfig().size_m;
    Vec3::Map(body.position_m.data()) = position.cast<float>();
    body.quat_wxyz = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
    Eigen::Affine3d frame = Eigen::Affine3d::Identity();
    frame.linear() = turned.toRotationMatrix();
    frame.translation() = position;
    bodies_.push_back({at.node, frame, std::make_unique<GltfReader>(model_, source_, files_, options_)});
    return bodies_.size() - 1;
  }

  // Reads the meshes of all bodies. Bodies with equal ones share them.
  void finish_bodies() {
    std::vector<BodyConfig>& all = scene().bodies;
    const std::size_t first = all.size() - bodies_.size();
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      GltfReader& reader = *bodies_[i].reader;
      const auto same = std::find_if(bodies_.begin(), bodies_.begin() + static_cast<std::ptrdiff_t>(i),
                                     [&](const BodyNode& body) { return body.reader->shown_ == reader.shown_; });
      const auto number = static_cast<std::size_t>(same - bodies_.begin());
      if (number < i) {
        all[first + i].mesh = all[first + number].mesh;
        continue;
      }
      reader.pixels_left_ = pixels_left_;
      for (const Shown& shown : reader.shown_) reader.read_mesh(shown);
      pixels_left_ = reader.pixels_left_;
      dropped_ += reader.dropped_;
      if (reader.scene().mesh.triangles.empty()) {
        refuse(field("nodes", bodies_[i].node) + "/extras/" + kGltfBody, "a body with a triangle that has an area", "none");
      }
      all[first + i].mesh = std::make_shared<const World>(std::move(reader.scene()));
    }
  }

  Eigen::Affine3d transform_of(const GltfNode& node, std::size_t index) const {
    if (node.matrix) {
      const Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix4d>(node.matrix->data());  // column-major
      if (!matrix.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), 1e-6)) {
        refuse(field("nodes", index) + "/matrix", "0, 0, 0, 1 as the last row", "another");
      }
      return Eigen::Affine3d(Eigen::AffineCompact3d(matrix.topRows<3>()));
    }
    Eigen::Affine3d place = Eigen::Affine3d::Identity();
    if (const auto& t = node.translation) place.translation() = Vec3d((*t)[0], (*t)[1], (*t)[2]);
    if (const auto& given = node.rotation) {
      const Eigen::Quaterniond q((*given)[3], (*given)[0], (*given)[1], (*given)[2]);
      constexpr double kTolerance = 0.01;  // exporters round; normalized below
      require(std::abs(q.norm() - 1.0) <= kTolerance, field("nodes", index) + "/rotation", "a quaternion of norm 1", q.norm());
      place.rotate(q.normalized());
    }
    if (const auto& s = node.scale) place.scale(Vec3d((*s)[0], (*s)[1], (*s)[2]));
    return place;
  }

  void read_node(const GltfNode& node, const Placed& at, const Eigen::Affine3d& place, int semantic, Visibility visibility) {
    const std::size_t index = at.node;
    if (!node.marker.empty()) read_marker(node.marker, index, place.translation());
    if (node.has_sun) {
      const Vec3d towards = place.linear() * Vec3d::UnitZ();  // a light shines along its -z
      if (!(towards.norm() > 0.0)) refuse(field("nodes", index), "a light with a direction", "one scaled to 0");
      const Vec3d unit = towards.normalized();
      // Extras store the exact direction. If the node has been rotated since, the node's direction is used.
      const auto& known = scene().light.sun_direction;
      const bool is_known = is_ours_ && (unit - Vec3d(known[0], known[1], known[2])).norm() <= 1e-4;
      if (++suns_ == 1 && !is_known)
        scene().light.sun_direction = {static_cast<float>(unit.x()), static_cast<float>(unit.y()), static_cast<float>(unit.z())};
    }
    if (!node.mesh) return;
    if (node.extras.gate) return read_gate_of(node, index, at.is_root, place, semantic, visibility);
    if (node.extras.primitive) {
      if (read_primitive_of(node, index, at.is_root, place, semantic, visibility)) return;
      ++reshaped_;
    }
    require(shown_.size() < kMaxObjects, field("nodes", index), "at most 65536 nodes with a mesh", "more");
    count_triangles(*node.mesh);
    shown_.push_back({*node.mesh, index, place, semantic, visibility});
  }

  void read_marker(std::string_view name, std::size_t index, const Vec3d& place) {
    const auto point = [&] {
      const bool is_near = place.cwiseAbs().maxCoeff() <= kMaxCoordinate;
      if (!is_near) refuse(field("nodes", index), in_world("a marker"), coordinates(place));
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

  // Sorts waypoints by number. Equal numbers keep the order of the nodes.
  void order_waypoints() {
    std::stable_sort(waypoints_.begin(), waypoints_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [number, point] : waypoints_) scene().markers.waypoints.push_back(point);
  }

  // -------------------------------------------------------------------------------------------------------- meshes

  // The mesh of a node; it becomes an object.
  struct Shown {
    std::size_t mesh, node;
    Eigen::Affine3d place;
    int semantic;
    Visibility visibility;

    // Returns true if both have the same triangles.
    bool operator==(const Shown& other) const {
      return mesh == other.mesh && place.matrix().isApprox(other.place.matrix(), 1e-9) && semantic == other.semantic &&
             visibility == other.visibility;
    }
  };

  static std::size_t num_triangles(const GltfPrimitive& primitive, std::size_t num_corners) {
    return primitive.mode == GltfMode::triangles ? num_corners / 3 : std::max<std::size_t>(num_corners, 2) - 2;
  }

  // Adds the triangles of a mesh to the total and checks the limit. The count of a mesh is 1 plus its triangles, and a
  // primitive without triangles counts as one triangle. Many nodes with empty meshes therefore reach the limit, too.
  void count_triangles(std::size_t mesh) {
    if (triangles_of_.empty()) count_all_triangles();
    num_triangles_ += triangles_of_[mesh];
    require(num_triangles_ <= kMaxGltfTriangles, source_, "at most " + std::to_string(kMaxGltfTriangles) + " triangles", "more");
  }

  void count_all_triangles() {
    for (const std::vector<GltfPrimitive>& mesh : model_.meshes) {
      std::size_t& sum = triangles_of_.emplace_back(1);
      for (const GltfPrimitive& primitive : mesh) {
        const std::size_t corners = primitive.indices.value_or(primitive.attributes.at("POSITION"));
        const std::size_t count = num_triangles(primitive, model_.accessors[corners].count);
        sum = std::min(sum + std::max<std::size_t>(count, 1), kMaxGltfTriangles + 1);
      }
    }
  }

  // A glTF primitive of a mesh.
  struct Part {
    const GltfPrimitive* primitive;
    std::vector<std::uint32_t> corners;
    std::uint16_t material;
    std::optional<std::size_t> uv, colors;  // accessors
  };

  // Vertices shared by primitives with the same accessors: the indices in use, and the index of the first vertex in the world's
  // mesh.
  struct Vertices {
    std::vector<std::uint32_t> used;
    std::int32_t first = -1;
  };

  void read_mesh(const Shown& shown) {
    const GltfNodeExtras& extras = model_.nodes[shown.node].extras;
    objects_ = std::max<std::size_t>(objects_, extras.object.value_or(0));
    require(objects_ < kMaxObjects, field("nodes", shown.node), "at most 65536 objects", "more");
    const auto object = static_cast<std::uint16_t>(objects_++);

    // In files that flockstep wrote, primitives with the same accessors shared their vertices in the original world.
    std::vector<Part> parts;
    using Owner = std::optional<std::size_t>;
    std::map<std::tuple<std::size_t, Owner, Owner, Owner>, Vertices> vertices;
    const auto vertices_of = [&](const Part& part) -> Vertices& {
      const bool is_shared = extras.object && !surface_of(*part.primitive).transform;
      const Owner owner = is_shared ? std::nullopt : Owner(&part - parts.data());
      return vertices[{part.primitive->attributes.at("POSITION"), part.uv, part.colors, owner}];
    };
    const std::vector<GltfPrimitive>& primitives = model_.meshes[shown.mesh];
    parts.reserve(primitives.size());
    for (const GltfPrimitive& primitive : primitives) {
      const Elements positions = elements_of(primitive.attributes.at("POSITION"), {GltfShape::vec3}, "VEC3 positions");
      std::vector<std::uint32_t> corners = corners_of(primitive, positions.size());
      const std::uint16_t material = material_of(primitive.material, shown.semantic);
      const bool has_uv = extras.object || scene().materials[material].texture;
      parts.push_back({&primitive, std::move(corners), material, has_uv ? uv_of(primitive, positions.size()) : std::nullopt,
                       colors_of(primitive, positions.size())});
      std::vector<std::uint32_t>& used = vertices_of(parts.back()).used;
      used.insert(used.end(), parts.back().corners.begin(), parts.back().corners.end());
    }

    const std::size_t first = scene().mesh.triangles.size();
    std::vector<std::size_t> begins;
    for (const Part& part : parts) {
      Vertices& own = vertices_of(part);
      if (own.first < 0) read_vertices(part, shown.place, own);
      begins.push_back(scene().mesh.triangles.size());
      read_triangles(part, shown.place, own);
    }
    TriangleMesh& mesh = scene().mesh;
    mesh.objects.resize(mesh.triangles.size(), object);
    mesh.visibility.resize(object, Visibility::full);
    mesh.visibility.push_back(shown.visibility);
    if (!extras.order.empty()) put_in_order(extras.order, first, begins);
  }

  // Restores the original order of the triangles from `first` on; `begins` has the first triangle of each part. If the mesh has
  // been edited and the order does not fit its parts, does nothing.
  void put_in_order(const std::vector<std::uint32_t>& order, std::size_t first, std::vector<std::size_t> begins) {
    TriangleMesh& mesh = scene().mesh;
    std::vector<std::size_t> ends(begins.begin() + (begins.empty() ? 0 : 1), begins.end());
    ends.push_back(mesh.triangles.size());
    std::vector<std::array<std::int32_t, 3>> triangles;
    std::vector<std::uint16_t> materials;
    for (std::size_t i = 0; i < order.size(); i += 2) {
      const std::size_t part = order[i], count = order[i + 1];
      if (part >= begins.size() || count > ends[part] - begins[part]) return;
      for (std::size_t k = 0; k < count; ++k, ++begins[part]) {
        triangles.push_back(mesh.triangles[begins[part]]);
        materials.push_back(mesh.materials[begins[part]]);
      }
    }
    if (triangles.size() != mesh.triangles.size() - first) return;
    std::copy(triangles.begin(), triangles.end(), mesh.triangles.begin() + static_cast<std::ptrdiff_t>(first));
    std::copy(materials.begin(), materials.end(), mesh.materials.begin() + static_cast<std::ptrdiff_t>(first));
  }

  Elements elements_of(std::size_t accessor, std::initializer_list<GltfShape> shapes, const char* expected) const {
    const GltfAccessor& given = model_.accessors[accessor];
    if (std::find(shapes.begin(), shapes.end(), given.shape) == shapes.end()) {
      refuse(field("accessors", accessor), expected, "others");
    }
    if (!given.view) refuse(field("accessors", accessor), "an accessor with a bufferView, and not sparse", "another");
    return Elements(model_, accessor);
  }

  // Returns the vertex indices of the three corners of each triangle.
  std::vector<std::uint32_t> corners_of(const GltfPrimitive& primitive, std::size_t num_vertices) {
    std::optional<Elements> indices;
    if (primitive.indices) {
      const GltfComponent type = model_.accessors[*primitive.indices].component;
      const bool is_unsigned = type == GltfComponent::uint8 || type == GltfComponent::uint16 || type == GltfComponent::uint32;
      if (!is_unsigned) refuse(field("accessors", *primitive.indices), "unsigned integers as indices", "others");
      indices.emplace(elements_of(*primitive.indices, {GltfShape::scalar}, "SCALAR indices"));
    }
    const std::size_t count = indices ? indices->size() : num_vertices;
    if (primitive.mode == GltfMode::triangles && count % 3 != 0) {
      const std::size_t accessor = primitive.indices.value_or(primitive.attributes.at("POSITION"));
      refuse(field("accessors", accessor), "three corners for each triangle", count);
    }

    const std::size_t triangles = num_triangles(primitive, count);
    std::vector<std::uint32_t> corners;
    corners.reserve(3 * triangles);
    const auto push = [&](std::size_t i) {
      const std::uint32_t vertex = indices ? indices->index(i) : static_cast<std::uint32_t>(i);
      if (vertex >= num_vertices) {
        refuse(field("accessors", *primitive.indices), "indices of " + std::to_string(num_vertices) + " vertices", vertex);
      }
      corners.push_back(vertex);
    };
    for (std::size_t i = 0; i < triangles; ++i) {
      if (i % 4096 == 0) Interrupt::poll();
      std::array<std::size_t, 3> triangle{3 * i, 3 * i + 1, 3 * i + 2};
      if (primitive.mode == GltfMode::strip) triangle = {i, i + 1 + i % 2, i + 2 - i % 2};
      if (primitive.mode == GltfMode::fan) triangle = {i + 1, i + 2, 0};
      for (const std::size_t corner : triangle) push(corner);
    }
    return corners;
  }

  const GltfMaterial& surface_of(const GltfPrimitive& primitive) const {
    static const GltfMaterial kNone;
    return primitive.material ? model_.materials[*primitive.material] : kNone;
  }

  // Returns the accessor of a primitive's texture coordinates.
  std::optional<std::size_t> uv_of(const GltfPrimitive& primitive, std::size_t num_vertices) const {
    const auto found = primitive.attributes.find("TEXCOORD_" + std::to_string(surface_of(primitive).tex_coord));
    if (found == primitive.attributes.end()) return std::nullopt;
    const Elements uv = elements_of(found->second, {GltfShape::vec2}, "VEC2 texture coordinates");
    require(uv.size() == num_vertices, field("accessors", found->second),
            "as many texture coordinates as positions (" + std::to_string(num_vertices) + ')', uv.size());
    return found->second;
  }

  // Returns the accessor of a primitive's vertex colours. Alpha is ignored.
  std::optional<std::size_t> colors_of(const GltfPrimitive& primitive, std::size_t num_vertices) const {
    const auto found = primitive.attributes.find("COLOR_0");
    if (found == primitive.attributes.end()) return std::nullopt;
    const Elements colors = elements_of(found->second, {GltfShape::vec3, GltfShape::vec4}, "VEC3 or VEC4 colours");
    require(colors.size() == num_vertices, field("accessors", found->second),
            "as many colours as positions (" + std::to_string(num_vertices) + ')', colors.size());
    return found->second;
  }

  void read_vertices(const Part& part, const Eigen::Affine3d& place, Vertices& own) {
    sort_unique(own.used);
    const std::size_t position = part.primitive->attributes.at("POSITION");
    const Elements positions(model_, position);
    std::optional<Elements> uv, colors;
    if (part.uv) uv.emplace(model_, *part.uv);
    if (part.colors) colors.emplace(model_, *part.colors);
    std::vector<std::array<float, 3>> shown_colors;
    std::optional<UvTransform> to_image;
    if (const auto& transform = surface_of(*part.primitive).transform) to_image.emplace(*transform);
    TriangleMesh& mesh = scene().mesh;
    own.first = static_cast<std::int32_t>(mesh.vertices.size());
    for (const std::uint32_t vertex : own.used) {
      if (vertex % 4096 == 0) Interrupt::poll();
      const Vec3d given(positions.number(vertex, 0), positions.number(vertex, 1), positions.number(vertex, 2));
      const Vec3d point = applied(place, given);
      if (!(point.cwiseAbs().maxCoeff() <= kMaxCoordinate) || !point.allFinite()) {
        refuse(field("accessors", position), in_world("finite positions that come to lie"), coordinates(point));
      }
      mesh.vertices.push_back(point.cast<float>());
      Vec2d where = Vec2d::Zero();
      if (uv) where = {uv->number(vertex, 0), uv->number(vertex, 1)};
      if (uv && to_image) where = to_image->turn * where + to_image->offset;
      mesh.uv.push_back({static_cast<float>(where.x()), static_cast<float>(where.y())});
      if (!colors) continue;
      std::array<float, 3>& shown = shown_colors.emplace_back();
      for (std::size_t c = 0; c < 3; ++c) shown[c] = static_cast<float>(std::clamp(colors->number(vertex, c), 0.0, 1.0));
    }
    append_colors(shown_colors, own.used.size(), mesh);
  }

  void read_triangles(const Part& part, const Eigen::Affine3d& place, const Vertices& own) {
    TriangleMesh& mesh = scene().mesh;
    const bool is_mirrored = place.linear().determinant() < 0.0;
    const bool is_dense = !own.used.empty() && own.used.back() - own.used.front() + 1 == own.used.size();
    for (std::size_t i = 0; i < part.corners.size(); i += 3) {
      if (i % 4096 == 0) Interrupt::poll();
      std::array<std::int32_t, 3> triangle{};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t corner = part.corners[i + k];
        const auto at =
            is_dense ? corner - own.used.front() : std::lower_bound(own.used.begin(), own.used.end(), corner) - own.used.begin();
        triangle[k] = own.first + static_cast<std::int32_t>(at);
      }
      if (is_mirrored) std::swap(triangle[1], triangle[2]);
      const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
      if (is_degenerate(corner(0), corner(1), corner(2))) {
        ++dropped_;
        continue;
      }
      mesh.triangles.push_back(triangle);
      mesh.materials.push_back(part.material);
    }
  }

  const GltfModel& model_;
  const std::string& source_;
  GltfFiles& files_;
  const LoadOptions& options_;
  Eigen::Affine3d place_;
  bool is_ours_ = false;  // the default scene has flockstep extras
  GltfFile file_;
  UnusedNames material_names_, texture_names_;
  std::map<std::pair<std::optional<std::size_t>, int>, std::uint16_t> materials_;  // with the semantic of a node; 0: none
  std::map<std::pair<std::size_t, std::array<TextureWrap, 2>>, std::uint16_t> textures_;
  std::vector<std::pair<std::uint32_t, Vec3>> waypoints_;
  std::vector<std::size_t> triangles_of_;  // by mesh
  std::map<std::size_t, Extent> extents_;  // by mesh
  std::map<std::tuple<PrimitiveKind, float, float>, Extent> tessellations_;
  std::vector<Shown> shown_;
  std::vector<BodyNode> bodies_;  // the last ones of the scene
  std::size_t pixels_left_ = kMaxScenePixels;
  std::size_t objects_ = 0, num_triangles_ = 0, dropped_ = 0, suns_ = 0, reshaped_ = 0;
  static constexpr std::size_t kNone = ~std::size_t{0};
  static constexpr double kRounding = 1e-5;  // tolerance for transforms that other programs changed
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
  if (!file.has_name) file.scene.name = path.stem().string();
  return file;
}

}  // namespace flockstep
