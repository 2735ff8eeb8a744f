#include "formats/scene_values.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/interrupt.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

using json::JsonField;

void check_keys(const JsonField& field, std::span<const SceneKey> keys) {
  if (!field.value.is_object()) refuse(field, "an object");
  for (const auto& [name, value] : field.value.items()) {
    const auto is_this = [&, &written = name](const SceneKey& key) { return key.name == written; };
    if (std::any_of(keys.begin(), keys.end(), is_this)) continue;
    std::vector<std::string_view> known;
    for (const SceneKey& key : keys) known.push_back(key.name);
    json::refuse_unknown(field, name, known);
  }
}

void refuse_number(const JsonField& field, const SceneKey& key) {
  if (!field.value.is_number()) refuse(field, "a number");
  const auto value = field.value.get<double>();
  const bool is_size = key.info.limits.least > 0.0 && key.info.limits.greatest >= kMaxCoordinate;
  const bool is_coordinate = key.info.limits.least <= -kMaxCoordinate;
  if (!is_size && !is_coordinate) refuse(field, text_of_values(key));
  if (!(std::abs(value) <= key.info.limits.greatest)) refuse(field, "a number " + key.info.limits.text());
  refuse(field, value <= 0.0 ? "a number > 0" : "a number " + at_least(key.info.limits.least).text());
}

float half_of(const JsonField& field, const SceneKey& key) { return static_cast<float>(number(field, key) / 2.0); }

Vec3d vec3(const JsonField& field, const SceneKey& key) {
  if (!field.value.is_array() || field.value.size() != 3) refuse(field, "an array of 3 numbers");
  return Vec3d(number(child(field, 0), key), number(child(field, 1), key), number(child(field, 2), key));
}

Vec3 point(const JsonField& field, const SceneKey& key) { return vec3(field, key).cast<float>(); }

std::array<double, 2> pair(const JsonField& field, const SceneKey& key, const char* expected) {
  if (!field.value.is_array() || field.value.size() != 2) refuse(field, expected);
  return {number(child(field, 0), key), number(child(field, 1), key)};
}

std::array<float, 3> color(const JsonField& field, const SceneKey& key) {
  if (!field.value.is_array() || field.value.size() != 3) refuse(field, "an array of 3 numbers");
  std::array<float, 3> rgb{};
  for (std::size_t i = 0; i < 3; ++i) {
    const JsonField channel = child(field, i);
    if (!channel.value.is_number()) refuse(channel, "a number");
    const auto value = channel.value.get<double>();
    if (!key.info.limits.contain(value)) refuse(field, "3 " + text_of_values(key));
    rgb[i] = static_cast<float>(value);
  }
  return rgb;
}

std::uint16_t integer(const JsonField& field, const SceneKey& key) {
  const bool is_number = field.value.is_number();
  const double value = is_number ? field.value.get<double>() : 0.0;
  if (!is_number || !key.info.limits.contain(value) || value != std::floor(value)) {
    refuse(field, "an integer " + key.info.limits.text());
  }
  return static_cast<std::uint16_t>(value);
}

void read_to(float& value, const JsonField& object, const SceneKey& key) {
  if (const auto field = find(object, key)) value = static_cast<float>(number(*field, key));
}

void read_to(std::array<float, 3>& value, const JsonField& object, const SceneKey& key) {
  const auto field = find(object, key);
  if (!field) return;
  if (key.info.form != Form::direction) {
    value = color(*field, key);
    return;
  }
  const Vec3d given = vec3(*field, key);
  if (given.isZero(0.0)) refuse(*field, "a direction that is not 0");
  const Vec3 direction = unit_direction(given);
  value = {direction.x(), direction.y(), direction.z()};
}

void read_to(std::optional<Vec3>& value, const JsonField& object, const SceneKey& key) {
  if (const auto field = find(object, key)) value = point(*field, key);
}

Quat rotation_of(const JsonField& object) {
  const std::optional<JsonField> field = find(object, keys::kRotation);
  if (!field) return Quat::Identity();
  if (!field->value.is_array() || field->value.size() != 4) refuse(*field, "an array of 4 numbers (w, x, y, z)");
  Eigen::Vector4d wxyz;
  for (std::size_t i = 0; i < 4; ++i) wxyz[static_cast<Eigen::Index>(i)] = number(child(*field, i), keys::kRotation);
  if (!(std::abs(wxyz.norm() - 1.0) <= kQuaternionTolerance)) refuse(*field, "a quaternion (w, x, y, z) of norm 1");
  return unit_quaternion(wxyz);
}

Visibility visibility_of(const JsonField& object) {
  const auto flag = [&](const SceneKey& key) {
    const std::optional<JsonField> given = find(object, key);
    if (given && !given->value.is_boolean()) refuse(*given, "true or false");
    return !given || given->value.get<bool>();
  };
  const bool is_visible = flag(keys::kVisible), is_solid = flag(keys::kSolid);
  if (!is_visible && !is_solid) fail(object, "expected one of \"visible\" and \"solid\" to be true, got neither");
  return is_visible && is_solid ? Visibility::full : (is_visible ? Visibility::visual : Visibility::solid);
}

std::array<TextureWrap, 2> wrap_of(const JsonField& field) {
  if (!field.value.is_array() || field.value.size() != 2) refuse(field, "an array of 2 names (across, down)");
  std::array<TextureWrap, 2> wrap{};
  for (std::size_t i = 0; i < 2; ++i) {
    const JsonField name = child(field, i);
    const auto& choices = EnumNames<TextureWrap>::kNames;
    const auto found = std::find_if(choices.begin(), choices.end(), [&](const char* known) { return name.value == known; });
    if (found == choices.end()) refuse(name, "\"repeat\", \"mirror\" or \"clamp\"");
    wrap[i] = static_cast<TextureWrap>(found - choices.begin());
  }
  return wrap;
}

GateShape gate_shape_of(const JsonField& field) {
  const auto& choices = EnumNames<GateShape>::kNames;
  const auto found = std::find_if(choices.begin(), choices.end(), [&](const char* known) { return field.value == known; });
  if (found == choices.end()) refuse(field, "\"square\" or \"ring\"");
  return static_cast<GateShape>(found - choices.begin());
}

Box3d box_of(const JsonField& object, const SceneKey& min, const SceneKey& max, double least_side) {
  const Box3d box{vec3(require(object, min), min), vec3(require(object, max), max)};
  if (!((box.max - box.min).array() >= least_side).all()) refuse(object, least_side > 0.0 ? "min < max" : "min <= max");
  return box;
}

TriangleMesh inline_mesh_of(const JsonField& field) {
  TriangleMesh mesh;
  const JsonField vertices = require(field, keys::kVertices);
  const JsonField triangles = require(field, keys::kTriangles);
  const std::size_t num_vertices = require_array(vertices, "an array of (x, y, z)").size();
  for (std::size_t i = 0; i < num_vertices; ++i) {
    Interrupt::poll();
    mesh.vertices.push_back(point(child(vertices, i), keys::kVertices));
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
  if (const auto uv = find(field, keys::kUv)) {
    const std::size_t count = require_array(*uv, "an array of (u, v)").size();
    if (count != num_vertices) refuse(*uv, "one per vertex (" + std::to_string(num_vertices) + ')', count);
    for (std::size_t i = 0; i < count; ++i) {
      Interrupt::poll();
      const auto [u, v] = pair(child(*uv, i), keys::kUv, "an array of 2 numbers (u, v)");
      mesh.uv.push_back({static_cast<float>(u), static_cast<float>(v)});
    }
  }
  if (const auto colors = find(field, keys::kColors)) {
    const std::size_t count = require_array(*colors, "an array of (r, g, b)").size();
    if (count != num_vertices) refuse(*colors, "one per vertex (" + std::to_string(num_vertices) + ')', count);
    for (std::size_t i = 0; i < count; ++i) {
      Interrupt::poll();
      mesh.colors.push_back(color(child(*colors, i), keys::kColors));
    }
  }
  return mesh;
}

}  // namespace flockstep
