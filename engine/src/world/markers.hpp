// What a navigation task asks of a world's markers.
#pragma once

#include "swiftlet/drone_model.hpp"
#include "swiftlet/world.hpp"

namespace swiftlet {

// Throws std::invalid_argument naming the world and the marker: start and goal must be there, all markers within the world's
// bounds, and the drone at the start must touch nothing.
void require_navigable(const World& world, const DroneModel& drone);

}  // namespace swiftlet
