// Planning: shortest paths through any world, the baseline that flown paths are measured against, and places that are free.
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

// Called now and then during a search with its progress, which only grows, from 0 to 1.
using Progress = std::function<void(double)>;

// The corners (K, 3) of a path from start over the goals in their order, straight in between, along which the drone, level and
// facing +x, touches nothing; nullopt if there is none on a grid of cell_m spacing. The path is close to the shortest: most are
// within 1 % of it, and within 5 % unless only a gap narrower than the larger cells makes it shorter. Coarse grids are searched
// first, and the grid of cell_m only in small worlds or if there is no path on coarser ones.
// Throws std::invalid_argument on points that are not finite, no goals, a cell_m that is not positive, or one so small that the
// search would take more than 2^25 cells.
FLOCKSTEP_API std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start,
                                                    std::span<const Vec3> goals, float cell_m = 0.1F,
                                                    const Progress& progress = {});

// Where places are drawn, and what makes one.
struct FreePlacesConfig {
  std::uint64_t seed = 0;
  // m, from the drone's centre to everything. None: the radius of the ball around the drone, which then may turn to any side.
  std::optional<float> clearance_m;
  float max_height_m = 5.0F;  // above what lies below; a place drawn higher is drawn again below that
  // Where to draw. None: the bounds of the world, and without a room up to max_height_m above them.
  std::optional<Aabb> box;
  // A place from which all others can be flown to, on a lattice of cell_m, the drone level and facing +x all the way.
  std::optional<Vec3> reachable_from;
  float cell_m = 0.2F;
};

// `count` places (K, 3) at which the drone, level and facing +x, is free; the first ones do not depend on the count. Each has
// something below, and neither what is next below nor what is next above shows the back of a triangle: the place is in the open
// or within a room or building, not in the ground, below it or within a closed body. Throws std::invalid_argument on a bad
// config, or where 100,000 draws in a row give no place.
FLOCKSTEP_API std::vector<Vec3> free_places(const World& world, const DroneModel& drone, std::size_t count,
                                            const FreePlacesConfig& config = {});

// Start and goal for a world, drawn as free places, at least distance_m apart and such that the drone can fly from one to the
// other. None: a third of the diagonal, seen from above, of where places are drawn. The radius is that of the world's markers,
// and reachable_from, where given, the start.
// Throws std::invalid_argument on a bad config, or where no such pair is found.
FLOCKSTEP_API Markers drawn_markers(const World& world, const DroneModel& drone, const FreePlacesConfig& config = {},
                                    std::optional<float> distance_m = {});

}  // namespace flockstep
