// A world as a field of a configuration. The functions are defined in formats/packed_world.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace flockstep {

class World;
using WorldField = std::shared_ptr<const World>;  // may be null

std::uint64_t hash_of_field(const WorldField& world);  // hash of the content; 0 for null
// Binary form; empty for null. world_of_field() throws std::invalid_argument if the bytes are damaged.
std::string bytes_of_field(const WorldField& world);
WorldField world_of_field(std::string_view bytes);
// A data: URI of a .glb file, or null. read_world_field() throws std::invalid_argument that names the path.
nlohmann::ordered_json json_of_field(const WorldField& world);
WorldField read_world_field(const nlohmann::json& json, const std::string& path);

}  // namespace flockstep
