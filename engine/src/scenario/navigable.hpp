// What a task that flies from marker to marker needs of a world.
#pragma once

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Throws std::invalid_argument naming the world and the marker unless start and goal are there, every marker lies within the
// bounds of the world, or above it where there is no room, and the drone at the start and in every corner of the spawn box
// (level, facing +x) touches nothing.
void require_navigable(const World& world, const DroneModel& drone);

}  // namespace flockstep
