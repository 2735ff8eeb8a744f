#include "base/world_field.hpp"

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "base/json_document.hpp"
#include "base/require.hpp"
#include "flockstep/world.hpp"
#include "formats/base64.hpp"

namespace flockstep {
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
