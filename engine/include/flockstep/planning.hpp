// Planning: near-shortest paths through a world, as the baseline for flown paths, and free places.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Returns whether a drone would touch nothing at a pose in a world.
FLOCKSTEP_API bool is_free(const World& world, const DroneModel& drone, const Pose& pose);

// Called repeatedly during a search with its progress, which increases from 0 to 1.
using Progress = std::function<void(double)>;

// Returns the corners (K, 3), m, of a path of straight segments from start over the goals in their order. The drone, level and
// facing +x, touches nothing along the path. Returns nullopt if there is no such path on a grid of cell_m spacing.
// The path is close to the shortest one: usually within 1 %, and always within 5 % unless a shorter path needs a gap narrower
// than the larger cells. Coarse grids are searched first. The grid of cell_m is searched only in small worlds, or if coarser
// grids have no path.
// Throws std::invalid_argument if a point is not finite, there are no goals, cell_m is not positive, or cell_m is so small that
// the search would need more than 2^25 cells.
FLOCKSTEP_API std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start,
                                                    std::span<const Vec3> goals, float cell_m = 0.1F,
                                                    const Progress& progress = {});

// Sampling region and constraints of free_places().
struct FreePlacesConfig {
  std::uint64_t seed = 0;  // seed of the drawn places
  // m, minimum distance from the drone's centre to everything. None: the radius of the drone's bounding sphere, so that it can
  // take any orientation.
  std::optional<float> clearance_m;
  float max_height_m = 5.0F;  // m above the nearest surface underneath; a higher place gets a new height below this limit
  // m, sampling region. None: the bounds of the world, extended upwards by max_height_m if the world has no room.
  std::optional<Aabb> box;
  // m, a place from which the drone can fly to all drawn places on a lattice of cell_m, level and facing +x.
  std::optional<Vec3> reachable_from;
  float cell_m = 0.2F;  // m
};

// Draws `count` places (K, 3), m, at which the drone, level and facing +x, touches nothing. With a larger count, the first
// places stay the same. Each place has a surface below it. The nearest triangles above and below face it. Therefore it is in
// the open or inside a room or building, and not in the ground, below it or inside a closed mesh. Throws std::invalid_argument
// on a bad config, or if 100,000 draws in a row give no place.
FLOCKSTEP_API std::vector<Vec3> free_places(const World& world, const DroneModel& drone, std::size_t count,
                                            const FreePlacesConfig& config = {});

// Draws two free places as start and goal of a world. They are at least distance_m (m) apart, and the drone can fly from one to
// the other. None: a third of the horizontal diagonal of the sampling region. If reachable_from is given, it becomes the start.
// The radius is that of the world's markers. With waypoints, these are the corners of the path of plan() between the two.
// Throws std::invalid_argument on a bad config, or if no such pair is found.
FLOCKSTEP_API Markers drawn_markers(const World& world, const DroneModel& drone, const FreePlacesConfig& config = {},
                                    std::optional<float> distance_m = {}, bool waypoints = false);

}  // namespace flockstep
