// Drone files: the JSON that docs/add-a-drone.md describes, read into and written from a DroneModel.
#pragma once

#include <string>

#include "flockstep/drone_model.hpp"

namespace flockstep {

// source names the text in error messages.
// Throws std::invalid_argument: source, place of the offending field, what was expected, what came.
DroneModel read_drone(const std::string& text, const std::string& source);

// Every number is written so that it reads back equal.
std::string write_drone(const DroneModel& drone);

}  // namespace flockstep
