// Scenarios: worlds made from a seed, and shortest paths through any world, the baseline that flown paths are measured against.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// A room with full-height pillars and a start, waypoints and a goal in it, made from a seed.
struct PlaygroundConfig {
  std::uint64_t seed = 0;
  int pillars = 12;                                  // how many, in [0, 200]
  std::array<float, 3> size_m{14.0F, 14.0F, 5.25F};  // m, room: x and y in [6, 200], z in [1.5, 100]
  float pillar_radius_m = 0.25F;                     // at least 0.01, at most a fourteenth of the shorter side of the room
};

// A generated playground, the same on every machine. The straight flight of the default drone from start over the waypoints to
// the goal crashes (if there are pillars), and a free path exists. Throws std::invalid_argument on a bad config, or where no path
// is found in many layouts because of too many pillars.
std::shared_ptr<const World> playground(const PlaygroundConfig& config);

// A forest on rolling terrain, made of textured meshes from a seed: conifers, broadleaved trees and rocks, and a start and a goal
// at opposite ends of it.
struct ForestConfig {
  std::uint64_t seed = 0;
  int trees = 150;                            // how many, in [0, 5000]
  std::array<float, 2> size_m{60.0F, 40.0F};  // along x, from start to goal, and y; in [12, 500]
  float relief_m = 4.0F;                      // from the lowest possible ground to the highest, in [0, 50]
};

// A generated forest, the same on every machine. The default drone can fly from start to goal along a winding way below the
// branches, which is tried in the world itself. Throws std::invalid_argument on a bad config, or where no such way is found in
// many layouts because of too many trees.
std::shared_ptr<const World> forest(const ForestConfig& config);

// A city: blocks of houses, streets between and around them with cars, lamps, trees and cables, and a row of houses that closes
// it all around; of textured meshes and primitives, from a seed.
struct CityConfig {
  std::uint64_t seed = 0;
  std::array<int, 2> blocks{3, 2};  // along x, from start to goal, and y; in [1, 8]; a block is 34 to 46 m, a street 10 m wide
  float height_m = 34.0F;           // of the tallest roofs, in [12, 200]
};

// A generated city, the same on every machine. Start and goal are crossings on opposite sides of it. The default drone can fly
// from one to the other along streets, 2 to 6 m above them, which is tried in the world itself. Throws std::invalid_argument on a
// bad config.
std::shared_ptr<const World> city(const CityConfig& config);

// A floor of an office building, made from a seed: rooms, corridors and lounges with their furniture behind windows, and a start
// and a goal in rooms at opposite ends of it.
struct OfficeConfig {
  std::uint64_t seed = 0;
  std::array<float, 2> size_m{36.0F, 20.0F};  // along x, in [20, 200], and y, in [14, 200]; rounded down to half metres
  float furniture = 0.8F;                     // how densely it is furnished, in [0, 1]
  bool waypoints = false;                     // before and behind each door of the way
};

// A generated office, the same on every machine. The straight flight of the default drone from start to goal crashes; through
// open doors it can fly there, 1.35 m above the floor, which is tried in the world itself. Throws std::invalid_argument on a bad
// config, or where no such way is found in many layouts.
std::shared_ptr<const World> office(const OfficeConfig& config);

// A warehouse, made from a seed: a hall with skylights, rows of racks full of pallets, and all that stands around them, and a
// start and a goal at opposite ends of it.
struct WarehouseConfig {
  std::uint64_t seed = 0;
  std::array<float, 2> size_m{48.0F, 30.0F};  // along x, across the rows of racks, in [26, 200], and y, in [16, 200]
  float height_m = 8.0F;                      // of the eaves, in [5, 20]; up to five pallets stand above each other
  bool waypoints = false;                     // where the way turns
};

// A generated warehouse, the same on every machine. The straight flight of the default drone from start to goal crashes; around
// racks and through empty bays it can fly there, which is tried in the world itself. Throws std::invalid_argument on a bad
// config, or where no such way is found in many layouts.
std::shared_ptr<const World> warehouse(const WarehouseConfig& config);

// Called now and then during a search with its progress, which only grows, from 0 to 1.
using Progress = std::function<void(double)>;

// The corners (K, 3) of a path from start over the goals in their order, straight in between, along which the drone, level and
// facing +x, touches nothing; nullopt if there is none on a grid of cell_m spacing. The path is close to the shortest: most are
// within 1 % of it, and within 5 % unless only a gap narrower than the larger cells makes it shorter. Coarse grids are searched
// first, and the grid of cell_m only in small worlds or if there is no path on coarser ones.
// Throws std::invalid_argument on points that are not finite, no goals, a cell_m that is not positive, or one so small that the
// search would take more than 2^25 cells.
std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start, std::span<const Vec3> goals,
                                      float cell_m = 0.1F, const Progress& progress = {});

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
std::vector<Vec3> free_places(const World& world, const DroneModel& drone, std::size_t count,
                              const FreePlacesConfig& config = {});

// Start and goal for a world, drawn as free places, at least distance_m apart and such that the drone can fly from one to the
// other. None: a third of the diagonal, seen from above, of where places are drawn. The radius is that of the world's markers,
// and reachable_from, where given, the start.
// Throws std::invalid_argument on a bad config, or where no such pair is found.
Markers drawn_markers(const World& world, const DroneModel& drone, const FreePlacesConfig& config = {},
                      std::optional<float> distance_m = {});

}  // namespace flockstep
