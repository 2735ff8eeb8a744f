// Shortest paths for a drone that keeps its attitude: the baseline that flown paths are measured against.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// The corners (K, 3) of a path from start over the goals in their order, straight in between, along which the drone, level and
// facing +x, touches nothing; nullopt if there is none on a grid of cell_m spacing. The path is close to the shortest: cell_m
// matters for which gaps are found, hardly for the length.
// Throws std::invalid_argument on points that are not finite, no goals, or a cell_m that is not positive or too fine for the
// world.
std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start, std::span<const Vec3> goals,
                                      float cell_m = 0.1F);

}  // namespace flockstep
