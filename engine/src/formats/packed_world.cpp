#include "formats/packed_world.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/json_document.hpp"
#include "base/require.hpp"
#include "base/world_field.hpp"
#include "flockstep/world.hpp"
#include "formats/scene_json.hpp"

namespace flockstep {
namespace {

constexpr std::string_view kPackedVersion = "flockstep packed world 1";
constexpr std::int32_t kNoTexture = -1;

// Lists, each as the number of its elements and their bytes.
class PackedWriter {
 public:
  template <class T>
  void add(std::span<const T> list) {
    const std::uint64_t count = list.size();
    bytes_.append(reinterpret_cast<const char*>(&count), sizeof count);
    bytes_.append(reinterpret_cast<const char*>(list.data()), list.size_bytes());
  }
  template <class T>
  void add(const std::vector<T>& list) {
    add(std::span<const T>(list));
  }
  void add(std::string_view text) { add(std::span<const char>(text)); }

  void reserve(std::size_t size) { bytes_.reserve(size); }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class PackedReader {
 public:
  explicit PackedReader(std::string_view bytes) : bytes_(bytes) {}

  template <class T>
  void take(std::vector<T>& list) {
    const std::string_view found = take_bytes(sizeof(T));
    list.resize(found.size() / sizeof(T));
    if (!list.empty()) std::memcpy(static_cast<void*>(list.data()), found.data(), found.size());
  }
  std::string_view take_text() { return take_bytes(1); }
  bool at_end() const { return bytes_.empty(); }

  [[noreturn]] static void damaged() { refuse("world", "the bytes of a packed world of this version", "others"); }

 private:
  std::string_view take_bytes(std::size_t element) {
    std::uint64_t count = 0;
    if (bytes_.size() < sizeof count) damaged();
    std::memcpy(&count, bytes_.data(), sizeof count);
    bytes_.remove_prefix(sizeof count);
    if (count > bytes_.size() / element) damaged();
    const std::string_view found = bytes_.substr(0, static_cast<std::size_t>(count) * element);
    bytes_.remove_prefix(found.size());
    return found;
  }

  std::string_view bytes_;
};

// Calls f for each list of the mesh, always in the same order.
template <class Mesh, class F>
void for_each_list(Mesh& mesh, const F& f) {
  auto& [vertices, triangles, materials, objects, uv, colors, visibility] = mesh;
  static_assert(sizeof(Vec3) == 3 * sizeof(float));
  f(vertices);
  f(triangles);
  f(materials);
  f(objects);
  f(uv);
  f(colors);
  f(visibility);
}

// Returns everything but meshes and textures. A scene file has at least one object, so an empty scene gets one, which
// unpack_world() removes.
SceneDescription without_arrays(const SceneDescription& from) {
  SceneDescription rest;
  rest.name = from.name;
  rest.materials = from.materials;
  for (Material& material : rest.materials) material.texture.reset();
  rest.primitives = from.primitives;
  rest.markers = from.markers;
  rest.light = from.light;
  rest.gates = from.gates;
  rest.bodies = from.bodies;
  if (rest.primitives.empty() && rest.gates.empty()) rest.primitives.emplace_back();
  return rest;
}

}  // namespace

std::string pack_world(const SceneDescription& description) {
  PackedWriter writer;
  std::size_t size = 1 << 16;
  for (const Texture& texture : description.textures) size += texture.rgba.size() + texture.name.size() + 64;
  for_each_list(description.mesh, [&](const auto& list) { size += std::span(list).size_bytes(); });
  writer.reserve(size);
  writer.add(kPackedVersion);
  writer.add(write_scene(without_arrays(description)));
  const std::array<std::uint64_t, 2> counts{description.primitives.size(), description.textures.size()};
  writer.add(std::span<const std::uint64_t>(counts));
  std::vector<std::int32_t> texture_of;
  for (const Material& material : description.materials) {
    texture_of.push_back(material.texture ? *material.texture : kNoTexture);
  }
  writer.add(texture_of);
  for_each_list(description.mesh, [&](const auto& list) { writer.add(list); });
  for (const Texture& texture : description.textures) {
    writer.add(texture.name);
    const std::array<std::int32_t, 4> numbers{texture.width_px, texture.height_px, static_cast<std::int32_t>(texture.wrap[0]),
                                              static_cast<std::int32_t>(texture.wrap[1])};
    writer.add(std::span<const std::int32_t>(numbers));
    writer.add(texture.rgba);
  }
  return writer.take();
}

SceneDescription unpack_world(std::string_view bytes) {
  PackedReader reader(bytes);
  if (reader.take_text() != kPackedVersion) PackedReader::damaged();
  SceneDescription scene = parse_scene(std::string(reader.take_text()), "world", {});
  std::vector<std::uint64_t> counts;
  reader.take(counts);
  if (counts.size() != 2) PackedReader::damaged();
  const auto [num_primitives, num_textures] = std::array{counts[0], counts[1]};
  if (num_primitives == 0) scene.primitives.clear();
  std::vector<std::int32_t> numbers;
  reader.take(numbers);
  if (numbers.size() != scene.materials.size()) PackedReader::damaged();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] == kNoTexture) continue;
    if (numbers[i] < 0 || numbers[i] > std::numeric_limits<std::uint16_t>::max()) PackedReader::damaged();
    scene.materials[i].texture = static_cast<std::uint16_t>(numbers[i]);
  }
  for_each_list(scene.mesh, [&](auto& list) { reader.take(list); });
  for (std::uint64_t k = 0; k < num_textures; ++k) {
    Texture& texture = scene.textures.emplace_back();
    texture.name = reader.take_text();
    reader.take(numbers);
    if (numbers.size() != 4) PackedReader::damaged();
    texture.width_px = numbers[0];
    texture.height_px = numbers[1];
    for (std::size_t i = 0; i < 2; ++i) {
      if (numbers[2 + i] < 0 || numbers[2 + i] > static_cast<std::int32_t>(TextureWrap::clamp)) PackedReader::damaged();
      texture.wrap[i] = static_cast<TextureWrap>(numbers[2 + i]);
    }
    reader.take(texture.rgba);
  }
  if (!reader.at_end()) PackedReader::damaged();
  return scene;
}

namespace {

constexpr std::string_view kGlbUri = "data:model/gltf-binary;base64,";

}  // namespace

std::uint64_t hash_of_field(const WorldField& world) { return world ? world->content_hash() : 0; }

std::string bytes_of_field(const WorldField& world) { return world ? world->to_bytes() : std::string(); }

WorldField world_of_field(std::string_view bytes) { return bytes.empty() ? nullptr : World::from_bytes(bytes); }

nlohmann::ordered_json json_of_field(const WorldField& world) {
  return world ? nlohmann::ordered_json(std::string(kGlbUri) + base64_of(world->to_glb())) : nlohmann::ordered_json();
}

WorldField read_world_field(const nlohmann::json& json, const std::string& path) {
  if (json.is_null()) return nullptr;
  const auto* const text = json.get_ptr<const std::string*>();
  if (text == nullptr || !text->starts_with(kGlbUri)) {
    refuse(path, "null or a .glb file as \"" + std::string(kGlbUri) + "...\"", json::excerpt_of(json));
  }
  return World::from_glb(bytes_of_base64(std::string_view(*text).substr(kGlbUri.size()), path), path);
}

}  // namespace flockstep
