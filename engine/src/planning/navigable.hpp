// Requirements of tasks on a world.
#pragma once

#include <string>

#include "flockstep/drone_model.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Throws std::invalid_argument naming the world and the marker unless start and goal are there, every marker lies within the
// bounds of the world, or above it where there is no room, and the drone at the start and in every corner of the spawn box
// (level, facing +x) touches nothing.
void require_navigable(const World& world, const DroneModel& drone);

// Throws std::invalid_argument naming the world and `place`, such as "markers.goal", unless the point lies in open_space() and
// the drone touches nothing there, level and facing +x.
void require_free(const World& world, const DroneModel& drone, const std::string& place, const Vec3& point);

// The space that drones may be in: the room, or without one everything within kMaxCoordinate.
Aabb open_space(const World& world);

}  // namespace flockstep
