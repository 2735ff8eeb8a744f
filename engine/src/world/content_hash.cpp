#include <cstddef>
#include <optional>
#include <span>
#include <type_traits>

#include "base/hash.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// Structs are unpacked with structured bindings, so that a new field does not compile here until it is hashed.

void add(Hash& hash, const Vec3& v) { hash.add(std::span<const float>(v.data(), 3)); }

void add(Hash& hash, std::span<const Vec3> rows) {
  static_assert(sizeof(Vec3) == 3 * sizeof(float));
  hash.add(std::as_bytes(rows));
}

void add(Hash& hash, const std::optional<Vec3>& point) {
  hash.add(point.has_value());
  if (point) add(hash, *point);
}

void add(Hash& hash, const Material& material) {
  const auto& [name, base_color, semantic, texture, emissive, alpha_cutoff] = material;
  hash.add(name);
  hash.add(std::span<const float>(base_color));
  hash.add(semantic);
  // Later additions are hashed only if used, so that older worlds keep the hash that their snapshots store.
  if (texture) hash.add(*texture);
  if (emissive != Material().emissive) hash.add(std::span<const float>(emissive));
  if (alpha_cutoff != 0.0F) hash.add(alpha_cutoff);
}

void add(Hash& hash, const Texture& texture) {
  const auto& [name, width_px, height_px, rgba, wrap] = texture;
  hash.add(name);
  hash.add(width_px);
  hash.add(height_px);
  hash.add(std::as_bytes(std::span(rgba)));
  hash.add(wrap[0]);
  hash.add(wrap[1]);
}

void add(Hash& hash, const Primitive& primitive) {
  const auto& [kind, center, rotation, half_extents, material, visibility] = primitive;
  hash.add(kind);
  add(hash, center);
  hash.add(std::span<const float>(rotation.coeffs().data(), 4));
  add(hash, half_extents);
  hash.add(material);
  if (visibility != Visibility::full) hash.add(visibility);
}

void add(Hash& hash, const TriangleMesh& mesh) {
  const auto& [vertices, triangles, materials, objects, uv, colors, visibility] = mesh;
  static_assert(sizeof(triangles[0]) == 3 * sizeof(std::int32_t));
  add(hash, vertices);
  hash.add(std::as_bytes(std::span(triangles)));
  hash.add(std::span<const std::uint16_t>(materials));
  hash.add(std::span<const std::uint16_t>(objects));
  static_assert(sizeof(uv[0]) == 2 * sizeof(float));
  if (!uv.empty()) hash.add(std::as_bytes(std::span(uv)));
  static_assert(sizeof(colors[0]) == 3 * sizeof(float));
  if (!colors.empty()) hash.add(std::as_bytes(std::span(colors)));
  if (!visibility.empty()) hash.add(std::as_bytes(std::span(visibility)));
}

void add(Hash& hash, const Gate& gate) {
  const auto& [shape, center, rotation, size, bar, material, visibility] = gate;
  hash.add(shape);
  add(hash, center);
  hash.add(std::span<const float>(rotation.coeffs().data(), 4));
  hash.add(size);
  hash.add(bar);
  hash.add(material);
  hash.add(visibility);
}

void add(Hash& hash, const Markers& markers) {
  const auto& [radius, start, waypoints, goal, spawn_box] = markers;
  hash.add(radius);
  add(hash, start);
  add(hash, waypoints);
  add(hash, goal);
  hash.add(spawn_box.has_value());
  if (spawn_box) {
    const auto& [min, max] = *spawn_box;
    add(hash, min);
    add(hash, max);
  }
}

// Zeros at the end are left out, so that a world keeps its hash when Light gets a field.
void add(Hash& hash, const Light& light) {
  std::size_t count = 0, used = 0;
  for_each_field(light, [&]<class Value>(const auto&, const Value& value) {
    ++count;
    if (value != Value{}) used = count;
  });
  for_each_field(light, [&]<class Value>(const auto&, const Value& value) {
    if (used == 0) return;
    --used;
    if constexpr (std::is_same_v<Value, float>) {
      hash.add(value);
    } else {
      hash.add(std::span<const float>(value));
    }
  });
}

}  // namespace

std::uint64_t content_hash(const SceneDescription& description) {
  const auto& [name, materials, textures, primitives, mesh, markers, light, gates, bodies] = description;
  static_cast<void>(name);
  Hash hash;
  hash.add(materials.size());
  for (const Material& material : materials) add(hash, material);
  if (!textures.empty()) hash.add(textures.size());
  for (const Texture& texture : textures) add(hash, texture);
  hash.add(primitives.size());
  for (const Primitive& primitive : primitives) add(hash, primitive);
  add(hash, mesh);
  add(hash, markers);
  add(hash, light);
  if (!gates.empty()) hash.add(gates.size());  // older worlds keep their hash
  for (const Gate& gate : gates) add(hash, gate);
  if (!bodies.empty()) hash.add("bodies");  // distinguishes them from gates
  for (const BodyConfig& body : bodies) hash.add(body);
  return hash.value();
}

}  // namespace flockstep
