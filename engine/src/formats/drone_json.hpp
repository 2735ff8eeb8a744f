// Reads and writes drone files: DroneModels as the JSON that docs/add-a-drone.md describes.
#pragma once

#include <string>

#include "flockstep/drone_model.hpp"

namespace flockstep {

// `source` names the text in error messages.
// Throws std::invalid_argument with the source, the path of the offending field, the expected value and the actual one.
DroneModel read_drone(const std::string& text, const std::string& source);

// Writes every number such that it reads back equal.
std::string write_drone(const DroneModel& drone);

}  // namespace flockstep
