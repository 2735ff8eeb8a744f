// Bodies in scene files and in the extras of glTF files.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/body.hpp"

namespace flockstep {

// Reads a list of objects with the fields of BodyConfig. Missing fields have their defaults. Throws std::invalid_argument that
// names the source and the place: "room.json: bodies[3].motion.period_s".
std::vector<BodyConfig> read_bodies(const json::JsonField& field);

// Leaves out the fields that have their defaults.
nlohmann::ordered_json write_bodies(const std::vector<BodyConfig>& bodies);

}  // namespace flockstep
