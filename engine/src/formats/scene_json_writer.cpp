#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/config_values.hpp"
#include "base/json_document.hpp"
#include "formats/image.hpp"
#include "formats/scene_json.hpp"
#include "formats/scene_values.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;  // keeps the order of keys, with linear search

constexpr const auto& kWraps = EnumNames<TextureWrap>::kNames;

OrderedJson numbers(const Vec3d& v) {
  return OrderedJson::array({json::shortest(v.x()), json::shortest(v.y()), json::shortest(v.z())});
}

OrderedJson numbers(const Vec3& v) { return numbers(Vec3d(v.cast<double>())); }

OrderedJson numbers(const std::array<float, 3>& v) { return numbers(Vec3(v[0], v[1], v[2])); }

// Writes text directly, because building an OrderedJson object takes quadratic time in the number of keys.
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

// The reader computes the room's centre and half extents from half sums and differences of the corners. The corners' digits are
// shortened only if this still gives the same values.
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

void write_visibility(OrderedJson& object, Visibility visibility) {
  if (!is_visible(visibility)) object["visible"] = false;
  if (!is_solid(visibility)) object["solid"] = false;
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
  write_visibility(object, primitive.visibility);
  constexpr const char* kLists[] = {"room", "boxes", "cylinders", "spheres", "capsules", "planes", "discs"};
  document[kLists[static_cast<std::size_t>(primitive.kind)]].push_back(std::move(object));
}

OrderedJson write_gates(const std::vector<Gate>& gates, const std::vector<Material>& materials) {
  OrderedJson list = OrderedJson::array();
  for (const Gate& gate : gates) {
    OrderedJson object = {{"shape", EnumNames<GateShape>::kNames[static_cast<std::size_t>(gate.shape)]},
                          {"center", numbers(gate.center)}};
    write_rotation(object, gate.rotation);
    object["size"] = json::shortest(gate.size);
    object["bar"] = json::shortest(gate.bar);
    object["material"] = materials[gate.material].name;
    write_visibility(object, gate.visibility);
    list.push_back(std::move(object));
  }
  return list;
}

// Writes the triangles [first, last) with the vertices [first_vertex, last_vertex).
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
  // Vertex colours are omitted if all are white.
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
  if (first != last) write_visibility(object, mesh.visibility_of(first));
  return object;
}

// Writes one mesh per object. An object's triangles and their vertices are contiguous.
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

// Writes one line per top-level field, and one per element of a list of objects.
std::string format(const OrderedJson& document, const SceneDescription& description) {
  std::string text = "{";
  const char* separator = "\n";
  for (const auto& [key, value] : document.items()) {
    text += separator + ("  " + OrderedJson(key).dump() + ": ");
    separator = ",\n";
    if (key == "materials" || key == "textures") {
      text += key == "materials" ? write_materials(description) : write_textures(description.textures);
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
  for_each_field(light, [&](const auto& field, const auto& value) {
    if (value != usual.*(field.member)) object[field.name] = config_values::written(value, "light");
  });
  return object;
}

std::string write_scene(const SceneDescription& description) {
  OrderedJson document = {{keys::kVersionName, kSceneVersion}, {"name", description.name}};
  if (!description.textures.empty()) document["textures"] = nullptr;
  document["materials"] = nullptr;
  for (const Primitive& primitive : description.primitives) {
    write_primitive(document, primitive, description.materials[primitive.material].name);
  }
  if (!description.gates.empty()) document["gates"] = write_gates(description.gates, description.materials);
  if (!description.mesh.triangles.empty()) document["meshes"] = write_meshes(description.mesh, description.materials);
  if (!description.bodies.empty()) document["bodies"] = write_bodies(description.bodies);
  document["markers"] = write_markers(description.markers);
  if (OrderedJson light = write_light(description.light); !light.empty()) document["light"] = std::move(light);
  return format(document, description);
}

}  // namespace flockstep
