// Doubts about the numbers of an airframe.
#pragma once

#include <string>
#include <vector>

#include "flockstep/drone_model.hpp"

namespace flockstep {

// Returns a text for each number that is possible but probably in another unit, such as an inertia in g cm^2.
std::vector<std::string> doubts_about(const DroneModel& drone);

}  // namespace flockstep
