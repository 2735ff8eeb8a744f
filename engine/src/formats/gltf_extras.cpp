#include "formats/gltf_extras.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <utility>

#include "base/check_fields.hpp"
#include "base/config_values.hpp"
#include "base/interrupt.hpp"
#include "formats/scene_json.hpp"
#include "formats/scene_values.hpp"
#include "world/scene_description.hpp"
#include "world/scene_keys.hpp"
#include "world/tessellate.hpp"

namespace flockstep {
namespace {

using json::JsonField;
using OrderedJson = nlohmann::ordered_json;

constexpr const auto& kKinds = EnumNames<PrimitiveKind>::kNames;

// Returns a length or radius, times a factor, as float32. Files hold float32 values, which rounding may have put just below the
// limit.
float size_of(const JsonField& field, const Limits& limits, double factor) {
  const double size = field.value.is_number() ? field.value.get<double>() : 0.0;
  if (!(size >= static_cast<double>(static_cast<float>(limits.least)) && size <= limits.greatest)) {
    refuse(field, expected_number(limits, false));
  }
  return static_cast<float>(size * factor);
}

Primitive read_primitive(const JsonField& field) {
  check_object(field, {"primitive", "radius", "height"});
  const JsonField kind = json::require(field, "primitive");
  Primitive primitive{.kind = read_choice<PrimitiveKind>(kind), .half_extents = Vec3::Ones()};
  if (primitive.kind == PrimitiveKind::capsule) {
    const float radius = size_of(json::require(field, "radius"), keys::kSizes, 1.0);
    const JsonField height = json::require(field, "height");
    primitive.half_extents = {radius, radius, size_of(height, keys::kLengths, 0.5)};
    if (primitive.half_extents.z() < radius) refuse(height, "a number >= twice the radius");
  } else {
    check_object(field, {"primitive"});
  }
  if (primitive.kind == PrimitiveKind::plane || primitive.kind == PrimitiveKind::disc) primitive.half_extents.z() = 0.0F;
  return primitive;
}

Gate read_gate(const JsonField& field) {
  check_object(field, {"shape", "size", "bar"});
  return {.shape = read_choice<GateShape>(json::require(field, "shape")),
          .size = size_of(json::require(field, "size"), keys::kLengths, 1.0),
          .bar = size_of(json::require(field, "bar"), keys::kLengths, 1.0)};
}

std::vector<std::uint32_t> read_order(const JsonField& field) {
  std::vector<std::uint32_t> order;
  const std::size_t count = require_array(field, "an array of integers").size();
  if (count % 2 != 0) refuse(field, "two integers for each run of triangles", count);
  for (std::size_t i = 0; i < count; ++i) {
    Interrupt::poll();
    order.push_back(static_cast<std::uint32_t>(integer(child(field, i), 0, std::numeric_limits<std::uint32_t>::max())));
  }
  return order;
}

std::optional<JsonField> find_ours(const JsonField& extras) {
  return extras.value.is_object() ? find(extras, kGltfExtras) : std::nullopt;
}

}  // namespace

GltfNodeExtras read_gltf_node_extras(const JsonField& extras) {
  GltfNodeExtras read;
  const std::optional<JsonField> ours = find_ours(extras);
  if (!ours) return read;
  check_object(*ours, {"primitive", "radius", "height", "gate", "object", "order"});
  if (ours->value.contains("primitive")) {
    read.primitive = read_primitive(*ours);
    return read;
  }
  if (const auto gate = find(*ours, "gate")) {
    check_object(*ours, {"gate"});
    read.gate = read_gate(*gate);
    return read;
  }
  check_object(*ours, {"object", "order"});
  read.object = static_cast<std::uint16_t>(integer(json::require(*ours, "object"), 0, kMaxObjects - 1));
  if (const auto order = find(*ours, "order")) read.order = read_order(*order);
  return read;
}

std::optional<GltfSceneExtras> read_gltf_scene_extras(const JsonField& extras) {
  const std::optional<JsonField> ours = find_ours(extras);
  if (!ours) return std::nullopt;
  check_object(*ours, {"light", "markers", "bodies"});
  GltfSceneExtras read;
  if (const auto light = find(*ours, "light")) read.light = read_light(*light);
  if (const auto markers = find(*ours, "markers")) {
    check_object(*markers, {"radius", "spawn_box"});
    read.markers = read_markers(*markers);
  }
  if (const auto bodies = find(*ours, "bodies")) read.bodies = read_bodies(*bodies, {}, MeshFiles::none);  // meshes are embedded
  return read;
}

std::shared_ptr<const BodyConfig> read_gltf_body(const JsonField& body) {
  if (!body.value.is_object()) refuse(body, "an object of fields of BodyConfig");
  for (const char* const name : {"shape", "size_m", "mesh", "position_m", "quat_wxyz", "color"}) {
    if (const auto field = find(body, name)) refuse(*field, "no such field (the node defines it)");
  }
  auto read = std::make_shared<BodyConfig>();
  const std::string name = name_of(body);
  config_values::read_value({body.value, {}, name, true}, {}, *read);
  return read;
}

OrderedJson write_gltf_extras(const GltfNodeExtras& extras) {
  OrderedJson ours = OrderedJson::object();
  if (extras.primitive) {
    const auto& [kind, center, rotation, half, material, visibility] = *extras.primitive;
    ours["primitive"] = kKinds[static_cast<std::size_t>(kind)];
    if (kind == PrimitiveKind::capsule) {
      ours["radius"] = json::shortest(half.x());
      ours["height"] = json::shortest(2.0 * static_cast<double>(half.z()));
    }
  }
  if (extras.gate) {
    ours["gate"] = {{"shape", EnumNames<GateShape>::kNames[static_cast<std::size_t>(extras.gate->shape)]},
                    {"size", json::shortest(extras.gate->size)},
                    {"bar", json::shortest(extras.gate->bar)}};
  }
  if (extras.object) ours["object"] = *extras.object;
  if (!extras.order.empty()) ours["order"] = extras.order;
  return {{kGltfExtras, std::move(ours)}};
}

OrderedJson write_gltf_extras(const GltfSceneExtras& extras) {
  Markers rest;
  rest.radius = extras.markers.radius;
  rest.spawn_box = extras.markers.spawn_box;
  OrderedJson ours = {{"light", write_light(extras.light)}, {"markers", write_markers(rest)}};
  if (!extras.bodies.empty()) ours["bodies"] = write_bodies(extras.bodies);
  return {{kGltfExtras, std::move(ours)}};
}

TriangleMesh gltf_tessellation(const Primitive& primitive) {
  constexpr float kChordError = 0.01F;  // relative to the radius: balls have 32 by 16 cells
  // Tessellates with radius 1 and then scales, because the chord error has a lower limit.
  Primitive unit = primitive;
  const float radius = primitive.half_extents.x();
  unit.half_extents /= radius;
  SceneDescription description;
  description.primitives = {unit};
  TriangleMesh mesh = tessellate(description, kChordError);
  for (Vec3& vertex : mesh.vertices) vertex *= radius;
  return mesh;
}

TriangleMesh gltf_tessellation(const Gate& gate) {
  constexpr float kChordError = 0.1F;  // relative to the bars
  SceneDescription description;
  append_frame({.shape = gate.shape, .size = gate.size, .bar = gate.bar}, description.primitives);
  return tessellate(description, std::max(kChordError * gate.bar, static_cast<float>(kMinSize)));
}

}  // namespace flockstep
