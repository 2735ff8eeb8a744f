// Values of a scene file, refused unless their keys allow them; see scene_keys.hpp. Refusals throw std::invalid_argument.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/json_document.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {

using Vec3d = Eigen::Vector3d;  // numbers are rounded to float32 once, after all arithmetic

// Refuses anything but an object, and fields that are not listed.
void check_keys(const json::JsonField& field, std::span<const SceneKey> keys);

inline std::optional<json::JsonField> find(const json::JsonField& object, const SceneKey& key) {
  return json::find(object, key.name);
}
inline json::JsonField require(const json::JsonField& object, const SceneKey& key) { return json::require(object, key.name); }

[[noreturn]] void refuse_number(const json::JsonField& field, const SceneKey& key);

inline double number(const json::JsonField& field, const SceneKey& key) {
  const bool is_number = field.value.is_number();
  const double value = is_number ? field.value.get<double>() : 0.0;
  if (!is_number || !(key.limits.contain(value) || (key.or_zero && value == 0.0))) refuse_number(field, key);
  return value;
}

// Half of a length.
float half_of(const json::JsonField& field, const SceneKey& key);
Vec3d vec3(const json::JsonField& field, const SceneKey& key);
Vec3 point(const json::JsonField& field, const SceneKey& key);
// expected: what is to be an array of two numbers.
std::array<double, 2> pair(const json::JsonField& field, const SceneKey& key, const char* expected);
std::array<float, 3> color(const json::JsonField& field, const SceneKey& key);
// A number that JSON Schema calls an integer: 7 or 7.0.
std::uint16_t integer(const json::JsonField& field, const SceneKey& key);

// The value of a key of an object, if it is there.
void read_to(float& value, const json::JsonField& object, const SceneKey& key);
void read_to(std::array<float, 3>& value, const json::JsonField& object, const SceneKey& key);
void read_to(std::optional<Vec3>& value, const json::JsonField& object, const SceneKey& key);

Quat rotation_of(const json::JsonField& object);  // the identity if it has none
Visibility visibility_of(const json::JsonField& object);
std::array<TextureWrap, 2> wrap_of(const json::JsonField& field);

struct Box3d {
  Vec3d min, max;
};
// Reads an object with these two keys; each side has at least the given length.
Box3d box_of(const json::JsonField& object, const SceneKey& min, const SceneKey& max, double least_side);

// The geometry that a mesh lists by vertices, triangles, uv and colors.
TriangleMesh inline_mesh_of(const json::JsonField& mesh);

}  // namespace flockstep
