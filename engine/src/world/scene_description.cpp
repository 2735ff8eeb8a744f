#include "world/scene_description.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>

#include "base/check_fields.hpp"
#include "base/excerpt.hpp"
#include "base/in_world.hpp"
#include "base/indices.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "world/scene_keys.hpp"
#include "world/tessellate.hpp"

namespace flockstep {
namespace {

std::string element(const std::string& list, std::size_t index) { return list + '[' + std::to_string(index) + ']'; }

// `object` is a function that returns the object's name.
template <class Name>
void check_values(const Name& object, const char* key, const Limits& limits, std::span<const float> values) {
  for (const float value : values) {
    if (!limits.contain(value)) refuse(object() + '.' + key, expected_number(limits, false), std::to_string(value));
  }
}

void check_point(const std::string& field, const Vec3& point) {
  if (!is_in_world(point)) {
    refuse(field, in_world("finite coordinates"), coordinates(point));
  }
}

void check_box(const std::string& field, const Aabb& box) {
  check_point(field + ".min", box.min);
  check_point(field + ".max", box.max);
  if (!(box.min.array() <= box.max.array()).all())
    refuse(field, "min <= max", coordinates(box.min) + " and " + coordinates(box.max));
}

void check_material(const std::string& field, std::size_t index, std::size_t count) {
  if (index >= count) refuse(field, "an index below " + std::to_string(count), std::to_string(index));
}

// Recomputes a room from its corners in double precision, because a scene file stores corners. If centre and half extents
// differ much in size, their last bits do not survive that conversion.
void take_corners(const std::string& field, Primitive& room) {
  const Eigen::Vector3d center = room.center.cast<double>(), half = room.half_extents.cast<double>();
  const Eigen::Vector3d low = center - half, high = center + half;
  if (!(low.cwiseAbs().cwiseMax(high.cwiseAbs()).maxCoeff() <= keys::kCorners.greatest)) {
    refuse(field, "corners " + keys::kCorners.text() + " m",
           coordinates(low.cast<float>()) + " and " + coordinates(high.cast<float>()));
  }
  room.center = ((low + high) / 2.0).cast<float>();
  room.half_extents = ((high - low) / 2.0).cast<float>();
}

void check_visibility(const std::string& field, Visibility visibility) {
  if (visibility > Visibility::solid) refuse(field, "a Visibility", std::to_string(static_cast<int>(visibility)));
}

// Makes a rotation unit. Returns true if it is the identity.
bool take_rotation(const std::string& field, Quat& q) {
  const Eigen::Vector4d wxyz(q.w(), q.x(), q.y(), q.z());
  if (!(std::abs(wxyz.norm() - 1.0) <= kQuaternionTolerance)) {
    refuse(field + ".rotation", "a unit quaternion", "norm " + std::to_string(wxyz.norm()));
  }
  q = unit_quaternion(wxyz);
  const bool is_identity = q.w() == 1.0F && q.vec().isZero(0.0F);
  if (is_identity) q = Quat::Identity();  // replaces -0
  return is_identity;
}

void check_primitive(const std::string& field, Primitive& primitive, std::size_t num_materials) {
  check_point(field + ".center", primitive.center);
  const Vec3& half = primitive.half_extents;
  check_point(field + ".half_extents", half);
  if (primitive.kind == PrimitiveKind::room) take_corners(field, primitive);
  const bool is_flat = primitive.kind == PrimitiveKind::plane || primitive.kind == PrimitiveKind::disc;
  if (is_flat && half.z() != 0.0F) refuse(field + ".half_extents", "thickness 0", coordinates(half));
  if (is_flat) primitive.half_extents.z() = 0.0F;  // replaces -0
  if (!(half.head(is_flat ? 2 : 3).minCoeff() >= static_cast<float>(keys::kSizes.least))) {
    refuse(field + ".half_extents", "sizes " + at_least(keys::kSizes.least).text() + " m", coordinates(half));
  }

  check_visibility(field + ".visibility", primitive.visibility);
  if (primitive.kind == PrimitiveKind::room && primitive.visibility != Visibility::full) {
    refuse(field + ".visibility", "Visibility::full for a room", "another");
  }

  const Quat& q = primitive.rotation;
  const bool is_identity = take_rotation(field, primitive.rotation);
  switch (primitive.kind) {
    case PrimitiveKind::room:
      if (!is_identity) refuse(field + ".rotation", "the identity for a room", coordinates(q.vec()));
      break;
    case PrimitiveKind::box:
    case PrimitiveKind::plane:
      break;
    case PrimitiveKind::cylinder:
    case PrimitiveKind::disc:
      if (half.x() != half.y()) refuse(field + ".half_extents", "(radius, radius, half height)", coordinates(half));
      break;
    case PrimitiveKind::capsule:
      if (half.x() != half.y() || half.z() < half.x()) {
        refuse(field + ".half_extents", "(radius, radius, half height >= radius)", coordinates(half));
      }
      break;
    case PrimitiveKind::sphere:
      if (!is_identity) refuse(field + ".rotation", "the identity for a sphere", coordinates(q.vec()));
      if (half.x() != half.y() || half.x() != half.z())
        refuse(field + ".half_extents", "(radius, radius, radius)", coordinates(half));
      break;
    default:
      refuse(field + ".kind", "a PrimitiveKind", std::to_string(static_cast<int>(primitive.kind)));
  }
  check_material(field + ".material", primitive.material, num_materials);
}

void check_gate(const std::string& field, Gate& gate, std::size_t num_materials) {
  const auto name = [&] { return field; };
  if (gate.shape > GateShape::ring) refuse(field + ".shape", "a GateShape", std::to_string(static_cast<int>(gate.shape)));
  check_point(field + ".center", gate.center);
  check_values(name, "size", keys::kLengths, {&gate.size, 1});
  check_values(name, "bar", keys::kLengths, {&gate.bar, 1});
  check_visibility(field + ".visibility", gate.visibility);
  take_rotation(field, gate.rotation);
  check_material(field + ".material", gate.material, num_materials);
  std::vector<Primitive> frame;
  append_frame(gate, frame);
  for (Primitive& bar : frame) check_primitive(field + " (its frame)", bar, num_materials);
}

constexpr std::size_t kBetweenPolls = 1024;  // vertices or triangles

void check_number_of(const std::string& field, std::size_t got, const char* of_what, std::size_t expected) {
  if (got != expected)
    refuse(field, std::string("one per ") + of_what + " (" + std::to_string(expected) + ')', std::to_string(got));
}

template <class Rows>
void check_per_vertex(const char* name, const Rows& rows, const Limits& limits, const TriangleMesh& mesh) {
  if (rows.empty()) return;
  check_number_of(std::string("mesh.") + name, rows.size(), "vertex", mesh.vertices.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (const float value : rows[i]) {
      if (limits.contain(value)) continue;
      refuse("mesh." + element(name, i), expected_number(limits, false), std::to_string(value));
    }
  }
}

constexpr std::array<float, 3> kWhite{1.0F, 1.0F, 1.0F};

void check_mesh(TriangleMesh& mesh, std::size_t num_materials) {
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (i % kBetweenPolls == 0) Interrupt::poll();
    if (!is_in_world(mesh.vertices[i])) check_point("mesh." + element("vertices", i), mesh.vertices[i]);
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (i % kBetweenPolls == 0) Interrupt::poll();
    const auto& triangle = mesh.triangles[i];
    const auto field = [i] { return "mesh." + element("triangles", i); };
    for (const std::int32_t index : triangle) {
      if (index < 0 || static_cast<std::size_t>(index) >= mesh.vertices.size()) {
        refuse(field(), "vertex indices in [0, " + std::to_string(mesh.vertices.size()) + ")", std::to_string(index));
      }
    }
    const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
    if (is_degenerate(corner(0), corner(1), corner(2))) {
      refuse(field(), "a triangle with an area",
             coordinates(corner(0)) + ' ' + coordinates(corner(1)) + ' ' + coordinates(corner(2)));
    }
  }
  if (mesh.materials.empty()) mesh.materials.assign(mesh.triangles.size(), 0);
  check_number_of("mesh.materials", mesh.materials.size(), "triangle", mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.materials.size(); ++i) {
    check_material("mesh." + element("materials", i), mesh.materials[i], num_materials);
  }
  if (mesh.objects.empty()) mesh.objects.assign(mesh.triangles.size(), 0);
  check_number_of("mesh.objects", mesh.objects.size(), "triangle", mesh.triangles.size());
}

// Returns the triangles in the order of a scene file: object by object, each with its own vertices in their original order.
TriangleMesh ordered_by_object(const TriangleMesh& mesh) {
  std::vector<std::size_t> order(mesh.triangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto by_object = [&](std::size_t a, std::size_t b) { return mesh.objects[a] < mesh.objects[b]; };
  if (!std::is_sorted(order.begin(), order.end(), by_object)) std::stable_sort(order.begin(), order.end(), by_object);

  TriangleMesh ordered;
  ordered.vertices.reserve(mesh.vertices.size() + 1);
  ordered.uv.reserve(mesh.uv.size());
  ordered.colors.reserve(mesh.colors.size());
  ordered.triangles.reserve(mesh.triangles.size());
  ordered.materials.reserve(mesh.triangles.size());
  ordered.objects.reserve(mesh.triangles.size());
  std::vector<std::int32_t> used;                            // by the current object
  std::vector<std::int32_t> moved(mesh.vertices.size(), 0);  // new indices of its vertices
  for (auto first = order.begin(); first != order.end();) {
    const std::uint16_t object = mesh.objects[*first];
    const auto last = std::find_if(first, order.end(), [&](std::size_t i) { return mesh.objects[i] != object; });
    used.clear();
    for (auto i = first; i != last; ++i) used.insert(used.end(), mesh.triangles[*i].begin(), mesh.triangles[*i].end());
    sort_unique(used);
    for (const std::int32_t index : used) {
      moved[static_cast<std::size_t>(index)] = static_cast<std::int32_t>(ordered.vertices.size());
      ordered.vertices.push_back(mesh.vertices[static_cast<std::size_t>(index)]);
      if (!mesh.uv.empty()) ordered.uv.push_back(mesh.uv[static_cast<std::size_t>(index)]);
      if (!mesh.colors.empty()) ordered.colors.push_back(mesh.colors[static_cast<std::size_t>(index)]);
    }
    for (; first != last; ++first) {
      std::array<std::int32_t, 3> triangle = mesh.triangles[*first];
      for (std::int32_t& index : triangle) index = moved[static_cast<std::size_t>(index)];
      ordered.triangles.push_back(triangle);
      ordered.materials.push_back(mesh.materials[*first]);
      ordered.objects.push_back(object);
    }
  }
  ordered.vertices.reserve(ordered.vertices.size() + 1);
  if (std::all_of(ordered.colors.begin(), ordered.colors.end(), [](const auto& color) { return color == kWhite; })) {
    ordered.colors.clear();
    ordered.colors.shrink_to_fit();
  }
  for (std::size_t i = 0; i < mesh.visibility.size() && i < kMaxObjects; ++i) {
    const auto has_object = [&](std::size_t object) {
      return std::binary_search(ordered.objects.begin(), ordered.objects.end(), static_cast<std::uint16_t>(object));
    };
    check_visibility("mesh." + element("visibility", i), mesh.visibility[i]);
    if (mesh.visibility[i] == Visibility::full || !has_object(i)) continue;
    ordered.visibility.resize(i);
    ordered.visibility.push_back(mesh.visibility[i]);
  }
  return ordered;
}

// Requires something solid, for drones to fly around.
void check_solid(const SceneDescription& description) {
  const auto is_one = [](const Primitive& primitive) { return is_solid(primitive.visibility); };
  if (std::any_of(description.primitives.begin(), description.primitives.end(), is_one)) return;
  if (std::ranges::any_of(description.gates, [](const Gate& gate) { return is_solid(gate.visibility); })) return;
  const TriangleMesh& mesh = description.mesh;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (is_solid(mesh.visibility_of(i))) return;
  }
  refuse("scene", "at least one primitive or triangle that is solid", "none");
}

void check_textures(const std::vector<Texture>& textures) {
  if (textures.size() > kMaxTextures)
    refuse("textures", "at most " + std::to_string(kMaxTextures) + " of them", std::to_string(textures.size()));
  std::set<std::string_view> names;
  for (std::size_t i = 0; i < textures.size(); ++i) {
    const auto& [name, width, height, rgba, wrap] = textures[i];
    if (!names.insert(name).second) refuse(element("textures", i) + ".name", "a unique name", '"' + name + '"');
    for (const int side : {width, height}) {
      if (side < 1 || side > kMaxTexturePx) {
        refuse(element("textures", i), "1 to " + std::to_string(kMaxTexturePx) + " pixels to a side", std::to_string(side));
      }
    }
    const std::size_t size = std::size_t{4} * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    if (rgba.size() != size)
      refuse(element("textures", i) + ".rgba", std::to_string(size) + " bytes", std::to_string(rgba.size()));
  }
}

void check_materials(const std::vector<Material>& materials, std::size_t num_textures) {
  if (materials.empty() || materials.size() > kMaxMaterials) {
    refuse("materials", "1 to " + std::to_string(kMaxMaterials) + " of them", std::to_string(materials.size()));
  }
  std::set<std::string_view> names;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const auto name = [i] { return element("materials", i); };
    check_values(name, "base_color", keys::kShares, materials[i].base_color);
    check_values(name, "emissive", Light::kBrightness, materials[i].emissive);
    check_values(name, "alpha_cutoff", keys::kShares, {&materials[i].alpha_cutoff, 1});
    if (materials[i].semantic >= kSemanticStart) {
      refuse(element("materials", i) + ".semantic", "a number below " + std::to_string(kSemanticStart),
             std::to_string(materials[i].semantic));
    }
    if (materials[i].texture && *materials[i].texture >= num_textures) {
      refuse(element("materials", i) + ".texture", "an index below " + std::to_string(num_textures),
             std::to_string(*materials[i].texture));
    }
    if (!names.insert(materials[i].name).second) {
      refuse(element("materials", i) + ".name", "a unique name", '"' + materials[i].name + '"');
    }
  }
}

// Rounding a unit vector to float32 changes its squared norm by at most 2^-23 (2^-24 relative in each component).
template <int kSize>
Eigen::Matrix<float, kSize, 1> unit(const Eigen::Matrix<double, kSize, 1>& vector) {
  constexpr double kRounding = 1.2e-7;
  const Eigen::Matrix<float, kSize, 1> rounded = vector.template cast<float>();
  const bool is_unit = std::abs(rounded.template cast<double>().squaredNorm() - 1.0) <= kRounding;
  if (is_unit) return rounded;
  return vector.normalized().template cast<float>();
}

}  // namespace

void check_light(Light& light) {
  check_fields(light, "light.");
  const auto& sun = light.sun_direction;
  const Vec3 unit = unit_direction(Vec3(sun[0], sun[1], sun[2]).cast<double>());
  light.sun_direction = {unit.x(), unit.y(), unit.z()};
}

void Light::validate() const { check_fields(*this, "light."); }

void apply_tint(std::span<const std::array<float, 3>> tint, std::vector<Material>& materials) {
  if (tint.empty()) return;
  const bool is_one = tint.size() == 1;
  if (!is_one && tint.size() != materials.size()) {
    refuse("tint", std::to_string(materials.size()) + " colours, one for each material", std::to_string(tint.size()));
  }
  for (std::size_t i = 0; i < materials.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const float value = tint[is_one ? 0 : i][c];
      const std::string color = is_one ? "tint" : element("tint", i);
      require(kTints.contain(static_cast<double>(value)), element(color, c), "a number " + kTints.text(), value);
      materials[i].base_color[c] = std::min(1.0F, materials[i].base_color[c] * value);
    }
  }
}

bool is_degenerate(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Eigen::Vector3d ab = (b - a).cast<double>();
  const Eigen::Vector3d ac = (c - a).cast<double>();
  const double longest_squared = std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()});
  return !(ab.cross(ac).norm() > kDegenerateRatio * longest_squared);
}

std::string words_of_flat(std::size_t count) { return counted(count, "triangle without an area", "triangles without an area"); }

Quat unit_quaternion(const Eigen::Vector4d& wxyz) {
  const Eigen::Vector4f q = unit<4>(wxyz);
  return Quat(q[0], q[1], q[2], q[3]);
}

Vec3 unit_direction(const Eigen::Vector3d& direction) {
  constexpr double kTiny = 1e-100;  // squares of shorter vectors underflow
  const double longest = direction.cwiseAbs().maxCoeff();
  return unit<3>(longest < kTiny ? Eigen::Vector3d(direction / longest) : direction);
}

void check_markers(const Markers& markers) {
  if (!keys::kSizes.contain(markers.radius)) {
    refuse("markers.radius", "a number > 0", std::to_string(markers.radius));
  }
  if (markers.start) check_point("markers.start", *markers.start);
  if (markers.goal) check_point("markers.goal", *markers.goal);
  for (std::size_t i = 0; i < markers.waypoints.size(); ++i) {
    check_point("markers." + element("waypoints", i), markers.waypoints[i]);
  }
  if (markers.spawn_box) check_box("markers.spawn_box", *markers.spawn_box);
}

void check_bodies(std::vector<BodyConfig>& bodies) {
  require(bodies.size() <= kMaxBodies, "bodies", "at most " + std::to_string(kMaxBodies) + " of them", bodies.size());
  constexpr std::string_view kPrefix = "body";  // with which messages of BodyConfig::validate() begin
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    Interrupt::poll();
    try {
      bodies[i].validate();
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(element("bodies", i) + (error.what() + kPrefix.size()));
    }
    const auto [w, x, y, z] = bodies[i].quat_wxyz;
    const Quat unit = unit_quaternion({w, x, y, z});
    bodies[i].quat_wxyz = {unit.w(), unit.x(), unit.y(), unit.z()};
  }
}

SceneDescription canonical(SceneDescription description) {
  check_textures(description.textures);
  check_materials(description.materials, description.textures.size());
  auto& primitives = description.primitives;
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    Interrupt::poll();
    check_primitive(element("primitives", i), primitives[i], description.materials.size());
  }
  std::stable_sort(primitives.begin(), primitives.end(), [](const Primitive& a, const Primitive& b) { return a.kind < b.kind; });
  if (primitives.size() > 1 && primitives[1].kind == PrimitiveKind::room) refuse("primitives", "at most one room", "several");
  check_mesh(description.mesh, description.materials.size());
  const auto& materials = description.materials;
  TriangleMesh& mesh = description.mesh;
  const bool is_textured = std::ranges::any_of(materials, [](const Material& m) { return m.texture.has_value(); });
  if (!is_textured) mesh.uv.clear();
  if (is_textured && mesh.uv.empty()) mesh.uv.assign(mesh.vertices.size(), {});
  check_per_vertex("uv", mesh.uv, keys::kCoordinates, mesh);
  check_per_vertex("colors", mesh.colors, keys::kShares, mesh);
  description.mesh = ordered_by_object(description.mesh);
  auto& gates = description.gates;
  if (gates.size() > kMaxGates) {
    refuse("gates", "at most " + std::to_string(kMaxGates) + " of them", std::to_string(gates.size()));
  }
  for (std::size_t i = 0; i < gates.size(); ++i) check_gate(element("gates", i), gates[i], description.materials.size());
  check_bodies(description.bodies);
  if (primitives.empty() && description.mesh.triangles.empty() && gates.empty()) {
    refuse("scene", "at least one primitive or triangle", "an empty scene");
  }
  check_solid(description);
  check_markers(description.markers);
  check_light(description.light);
  return description;
}

void append_colors(std::span<const std::array<float, 3>> colors, std::size_t count, TriangleMesh& mesh) {
  if (colors.empty() && mesh.colors.empty()) return;
  mesh.colors.resize(mesh.vertices.size() - count, kWhite);
  mesh.colors.insert(mesh.colors.end(), colors.begin(), colors.end());
  mesh.colors.resize(mesh.vertices.size(), kWhite);
}

SceneDescription solids_of(const World& world) {
  SceneDescription solids;
  for (Primitive primitive : world.primitives()) {
    if (!is_solid(primitive.visibility)) continue;
    primitive.material = 0;
    primitive.visibility = Visibility::full;
    solids.primitives.push_back(primitive);
  }
  const TriangleMesh& mesh = world.triangles();
  solids.mesh.vertices = mesh.vertices;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (is_solid(mesh.visibility_of(i))) solids.mesh.triangles.push_back(mesh.triangles[i]);
  }
  return solids;
}

Aabb bounds(const Primitive& primitive) {
  const Vec3& half = primitive.half_extents;
  const Mat3 rotation = primitive.rotation.toRotationMatrix();
  const Vec3 axis = rotation.col(2);
  Vec3 reach = half;  // rooms and spheres
  switch (primitive.kind) {
    case PrimitiveKind::box:
    case PrimitiveKind::plane:
      reach = rotation.cwiseAbs() * half;
      break;
    case PrimitiveKind::cylinder:
    case PrimitiveKind::disc:
      // A disc of radius r with unit normal a reaches r * sqrt(1 - a_i^2) along axis i.
      reach = half.z() * axis.cwiseAbs() + half.x() * (1.0F - axis.array().square()).max(0.0F).sqrt().matrix();
      break;
    case PrimitiveKind::capsule:
      reach = (half.z() - half.x()) * axis.cwiseAbs() + Vec3::Constant(half.x());
      break;
    default:
      break;
  }
  return Aabb{primitive.center - reach, primitive.center + reach};
}

}  // namespace flockstep
