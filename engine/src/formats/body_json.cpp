#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/config_values.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "formats/scene_json.hpp"
#include "formats/scene_values.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;

// Compares as text, because 0 equals -0.
OrderedJson without_defaults(const OrderedJson& object, const OrderedJson& usual) {
  OrderedJson rest = OrderedJson::object();
  for (const auto& [key, value] : object.items()) {
    if (value.dump() == usual[key].dump()) continue;
    rest[key] = value.is_object() ? without_defaults(value, usual[key]) : value;
  }
  return rest;
}

constexpr const char* kMesh = "mesh";

// Returns the mesh of a body if it is a file or that of an earlier body.
WorldField mesh_elsewhere(const json::JsonField& body, std::span<const BodyConfig> earlier, const std::filesystem::path& folder,
                          MeshFiles files) {
  const auto found = body.value.is_object() ? find(body, kMesh) : std::nullopt;
  if (!found) return nullptr;
  if (found->value.is_number_integer()) {
    const auto number = found->value.is_number_unsigned() ? found->value.get<std::uint64_t>() : earlier.size();
    if (number >= earlier.size() || !earlier[number].mesh) refuse(*found, "the number of an earlier body with a mesh");
    return earlier[number].mesh;
  }
  const auto* const name = found->value.get_ptr<const std::string*>();
  if (name == nullptr || name->starts_with("data:")) return nullptr;
  const std::filesystem::path path = folder / *name;
  if (name->empty() || name->find('\0') != name->npos || files == MeshFiles::none ||
      (files == MeshFiles::in_folder && !is_below(path, folder))) {
    refuse(*found, "a file in the scene's folder or below it (load with meshes_anywhere=True to allow others)");
  }
  if (extension_of(path) == ".json") refuse(*found, "a .glb, .gltf, .obj or .ply file");
  try {
    return World::load(path, {.files = files});
  } catch (const std::invalid_argument& error) {
    fail(*found, error.what());
  }
}

}  // namespace

std::vector<BodyConfig> read_bodies(const json::JsonField& field, const std::filesystem::path& folder, MeshFiles files) {
  const std::size_t count = json::require_array(field, "an array").size();
  check_count(kMaxBodies, field, "bodies");
  const std::string name = field.source + ": bodies";
  const json::JsonField list{field.value, {}, name, true};
  std::vector<BodyConfig> bodies(count);
  for (std::size_t i = 0; i < count; ++i) {
    Interrupt::poll();
    const json::JsonField body = child(list, i);
    WorldField mesh = mesh_elsewhere(body, std::span(bodies).first(i), folder, files);
    nlohmann::json rest;
    if (mesh) rest = body.value;
    if (mesh) rest.erase(kMesh);
    read_value({mesh ? rest : body.value, body.path, body.source, true}, {}, bodies[i]);
    if (mesh) bodies[i].mesh = std::move(mesh);
  }
  return bodies;
}

OrderedJson write_bodies(const std::vector<BodyConfig>& bodies) {
  const OrderedJson usual = config_values::written(BodyConfig(), "");
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    BodyConfig body = bodies[i];
    const auto same =
        std::ranges::find(bodies.begin(), bodies.begin() + static_cast<std::ptrdiff_t>(i), body.mesh, &BodyConfig::mesh);
    const bool repeats = body.mesh && same != bodies.begin() + static_cast<std::ptrdiff_t>(i);
    if (repeats) body.mesh = nullptr;
    OrderedJson& object = list.emplace_back(without_defaults(config_values::written(body, ""), usual));
    if (repeats) object[kMesh] = same - bodies.begin();
  }
  return list;
}

}  // namespace flockstep
