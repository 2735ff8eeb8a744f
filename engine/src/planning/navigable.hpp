// Checks that a world suits a task.
#pragma once

#include <span>
#include <string>

#include "collision/hull.hpp"
#include "flockstep/body.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Requires that start and goal exist; that every marker lies within the bounds of the world, or above it if there is no room;
// and that the drone, level and facing +x, touches nothing at the start and in every corner of the spawn box. Throws
// std::invalid_argument that names the world and the marker.
void require_navigable(const World& world, const DroneModel& drone);

// Requires that the point lies in open_space() and that the drone, level and facing +x, touches nothing there. Throws
// std::invalid_argument that names the world and `place`, such as "markers.goal".
void require_free(const World& world, const DroneModel& drone, const std::string& place, const Vec3& point);

// Returns the space for drones: the room, or everything within kMaxCoordinate if there is no room.
Aabb open_space(const World& world);

// --- paths of generated worlds, which must be solvable

// Returns whether the drone, level and facing +x, can fly straight from point to point without touching anything.
bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points);

// Returns whether a scripted body keeps clear of the static world by `margin_m` during its whole round trip, which has to be
// periodic: waypoints, an orbit, a hinge or a slider.
bool is_free_body(const World& world, const BodyConfig& body, float margin_m);

}  // namespace flockstep
