// Reads values of a scene file and checks them against their keys; see scene_keys.hpp. Invalid values throw
// std::invalid_argument.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/json_document.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {

using Vec3d = Eigen::Vector3d;  // rounded to float32 once, after all arithmetic

// Rejects values that are not objects, and unknown fields.
void check_keys(const json::JsonField& field, std::span<const SceneKey> keys);

inline std::optional<json::JsonField> find(const json::JsonField& object, const SceneKey& key) {
  return json::find(object, key.name);
}
inline json::JsonField require(const json::JsonField& object, const SceneKey& key) { return json::require(object, key.name); }

[[noreturn]] void refuse_number(const json::JsonField& field, const SceneKey& key);

inline double number(const json::JsonField& field, const SceneKey& key) {
  const bool is_number = field.value.is_number();
  const double value = is_number ? field.value.get<double>() : 0.0;
  if (!is_number || !key.info.limits.contain(value)) refuse_number(field, key);
  return value;
}

// Returns half of a length.
float half_of(const json::JsonField& field, const SceneKey& key);
Vec3d vec3(const json::JsonField& field, const SceneKey& key);
Vec3 point(const json::JsonField& field, const SceneKey& key);
// `expected` describes the array of two numbers in messages.
std::array<double, 2> pair(const json::JsonField& field, const SceneKey& key, const char* expected);
std::array<float, 3> color(const json::JsonField& field, const SceneKey& key);
// Reads an integer as in JSON Schema: 7 or 7.0.
std::uint16_t integer(const json::JsonField& field, const SceneKey& key);

// Reads the value of a key if the object has it.
void read_to(float& value, const json::JsonField& object, const SceneKey& key);
void read_to(std::array<float, 3>& value, const json::JsonField& object, const SceneKey& key);
void read_to(std::optional<Vec3>& value, const json::JsonField& object, const SceneKey& key);

Quat rotation_of(const json::JsonField& object);  // identity if missing
Visibility visibility_of(const json::JsonField& object);
std::array<TextureWrap, 2> wrap_of(const json::JsonField& field);
GateShape gate_shape_of(const json::JsonField& field);

struct Box3d {
  Vec3d min, max;
};
// Reads an object with these two keys. Each side must have at least the given length.
Box3d box_of(const json::JsonField& object, const SceneKey& min, const SceneKey& max, double least_side);

// Reads the geometry of a mesh given inline by vertices, triangles, uv and colors.
TriangleMesh inline_mesh_of(const json::JsonField& mesh);

}  // namespace flockstep
