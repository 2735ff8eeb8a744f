// Bodies in scene files and in the extras of glTF files.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Reads a list of objects with the fields of BodyConfig. Missing fields have their defaults. A mesh is the path of a file in the
// folder, or may come from everywhere, as `files` says; a .glb file as a data: URI; or the number of an earlier body with the
// same mesh. Throws std::invalid_argument that names the source and the place: "room.json: bodies[3].motion.period_s".
std::vector<BodyConfig> read_bodies(const json::JsonField& field, const std::filesystem::path& folder, MeshFiles files);

// Leaves out the fields that have their defaults.
nlohmann::ordered_json write_bodies(const std::vector<BodyConfig>& bodies);

}  // namespace flockstep
