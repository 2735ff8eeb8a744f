// Generators: functions that make a world from a seed.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// A room with full-height pillars, a start, waypoints and a goal, made from a seed.
struct PlaygroundConfig {
  std::uint64_t seed = 0;
  int pillars = 12;
  std::array<float, 3> size_m{14.0F, 14.0F, 5.25F};
  float pillar_radius_m = 0.25F;
  int movers = 0;

  static constexpr std::array<Limits, 3> kSizes{between(6, 200), between(6, 200), between(1.5, 100)};

  static constexpr auto fields() {
    using C = PlaygroundConfig;
    return field_list(
        field("seed", &C::seed, {.about = "Seed of the layout."}),
        field("pillars", &C::pillars, {.about = "Number of pillars.", .limits = between(0, 200)}),
        field("size_m", &C::size_m, {.about = "Size of the room (x, y, z).", .unit = "m", .each = kSizes}),
        field("pillar_radius_m", &C::pillar_radius_m,
              {.about = "Radius of the pillars, at most a fourteenth of the room's shorter side.",
               .unit = "m",
               .limits = at_least(0.01)}),
        field("movers", &C::movers,
              {.about = "Pillars and boxes that go back and forth, as far as they find free paths.", .limits = between(0, 100)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates a playground, the same on every machine. If there are pillars, the default drone crashes on the straight flight
// from start via the waypoints to the goal; a free path exists. Throws std::invalid_argument on a bad config, or if many
// layouts have no path because of too many pillars.
FLOCKSTEP_API std::shared_ptr<const World> playground(const PlaygroundConfig& config);

// A forest on rolling terrain, made of textured meshes from a seed: conifers, broadleaved trees and rocks, with a start and a
// goal at opposite ends.
struct ForestConfig {
  std::uint64_t seed = 0;
  int trees = 150;
  std::array<float, 2> size_m{60.0F, 40.0F};
  float relief_m = 4.0F;

  static constexpr auto fields() {
    using C = ForestConfig;
    return field_list(field("seed", &C::seed, {.about = "Seed of the layout."}),
                      field("trees", &C::trees, {.about = "Number of trees.", .limits = between(0, 5000)}),
                      field("size_m", &C::size_m,
                            {.about = "Size along x, from start to goal, and along y.", .unit = "m", .limits = between(12, 500)}),
                      field("relief_m", &C::relief_m,
                            {.about = "Maximum height difference of the ground.", .unit = "m", .limits = between(0, 50)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates a forest, the same on every machine. The default drone can fly from start to goal along a winding path below the
// branches; the generator checks this path in the finished world. Throws std::invalid_argument on a bad config, or if many
// layouts have no such path because of too many trees.
FLOCKSTEP_API std::shared_ptr<const World> forest(const ForestConfig& config);

// A city made from a seed, of textured meshes and primitives: blocks of houses, streets with cars, lamps, trees and cables
// between and around them, and an outer row of houses that encloses the city.
struct CityConfig {
  std::uint64_t seed = 0;
  std::array<int, 2> blocks{3, 2};
  float height_m = 34.0F;
  int traffic = 0;

  static constexpr auto fields() {
    using C = CityConfig;
    return field_list(
        field("seed", &C::seed, {.about = "Seed of the layout."}),
        field("blocks", &C::blocks,
              {.about = "Blocks along x, from start to goal, and along y, each 34 to 46 m, with streets of 10 m.",
               .limits = between(1, 8)}),
        field("height_m", &C::height_m, {.about = "Height of the tallest roofs.", .unit = "m", .limits = between(12, 200)}),
        field("traffic", &C::traffic,
              {.about = "Cars that drive around the blocks instead of standing, as far as they find free paths.",
               .limits = between(0, 500)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates a city, the same on every machine. Start and goal are crossings on opposite sides of the city. The default drone
// can fly from one to the other along the streets, 2 to 6 m above them; the generator checks this path in the finished world.
// Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::shared_ptr<const World> city(const CityConfig& config);

// A floor of an office building, made from a seed: furnished rooms, corridors and lounges behind windows, with a start and a
// goal in rooms at opposite ends.
struct OfficeConfig {
  std::uint64_t seed = 0;
  std::array<float, 2> size_m{36.0F, 20.0F};
  float furniture = 0.8F;
  bool waypoints = false;
  int walkers = 0;

  static constexpr std::array<Limits, 2> kSizes{between(20, 200), between(14, 200)};

  static constexpr auto fields() {
    using C = OfficeConfig;
    return field_list(
        field("seed", &C::seed, {.about = "Seed of the layout."}),
        field("size_m", &C::size_m, {.about = "Size along x and y, rounded down to half metres.", .unit = "m", .each = kSizes}),
        field("furniture", &C::furniture, {.about = "Density of the furniture.", .limits = between(0, 1)}),
        field("waypoints", &C::waypoints, {.about = "Waypoints on either side of each door of the path."}),
        field("walkers", &C::walkers,
              {.about = "People that walk up and down, as far as they find free paths. With any, the open doors swing.",
               .limits = between(0, 200)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates an office, the same on every machine. The default drone crashes on the straight flight from start to goal. It can
// fly there through open doors, 1.35 m above the floor; the generator checks this path in the finished world. Throws
// std::invalid_argument on a bad config, or if many layouts have no such path.
FLOCKSTEP_API std::shared_ptr<const World> office(const OfficeConfig& config);

// A warehouse, made from a seed: a hall with skylights, rows of racks full of pallets and other equipment, with a start and a
// goal at opposite ends.
struct WarehouseConfig {
  std::uint64_t seed = 0;
  std::array<float, 2> size_m{48.0F, 30.0F};
  float height_m = 8.0F;
  bool waypoints = false;
  int forklifts = 0;

  static constexpr std::array<Limits, 2> kSizes{between(26, 200), between(16, 200)};

  static constexpr auto fields() {
    using C = WarehouseConfig;
    return field_list(
        field("seed", &C::seed, {.about = "Seed of the layout."}),
        field("size_m", &C::size_m,
              {.about = "Size along x, across the rows of racks, and along y.", .unit = "m", .each = kSizes}),
        field("height_m", &C::height_m,
              {.about = "Height of the eaves. At most five pallets stand above each other.",
               .unit = "m",
               .limits = between(5, 20)}),
        field("waypoints", &C::waypoints, {.about = "Waypoints at each turn of the path."}),
        field("forklifts", &C::forklifts,
              {.about = "Forklifts that drive along the aisles, as far as they find free paths.", .limits = between(0, 200)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates a warehouse, the same on every machine. The default drone crashes on the straight flight from start to goal. It can
// fly there around racks and through empty bays; the generator checks this path in the finished world. Throws
// std::invalid_argument on a bad config, or if many layouts have no such path.
FLOCKSTEP_API std::shared_ptr<const World> warehouse(const WarehouseConfig& config);

// A race track, made from a seed: a closed loop of gates in an empty hall.
struct RaceTrackConfig {
  std::uint64_t seed = 0;
  int gates = 7;
  std::array<float, 3> size_m{22.0F, 18.0F, 8.0F};
  float gate_size_m = 1.5F;
  float rings = 0.25F;

  static constexpr std::array<Limits, 3> kSizes{between(12, 200), between(12, 200), between(4, 50)};

  static constexpr auto fields() {
    using C = RaceTrackConfig;
    return field_list(field("seed", &C::seed, {.about = "Seed of the layout."}),
                      field("gates", &C::gates, {.about = "Number of gates.", .limits = between(4, 20)}),
                      field("size_m", &C::size_m, {.about = "Size of the hall (x, y, z).", .unit = "m", .each = kSizes}),
                      field("gate_size_m", &C::gate_size_m,
                            {.about = "Inside width or diameter of the gates.", .unit = "m", .limits = between(1.2, 2.0)}),
                      field("rings", &C::rings, {.about = "Share of rings among the gates.", .limits = between(0, 1)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Generates a race track, the same on every machine. From each gate to the next, and from the last to the first, it is 4.5 to 12
// m. The ways to and from a gate make at most 60 degrees with its direction, seen from above, and climb by at most 40 %. A
// racer5 can fly straight from the centre of each gate to that of the next; the generator checks this path in the
// finished world. A gate's direction is level and halfway between these two ways, so the gate before lies behind it and outside
// of its miss zone (miss_m of Race). The start is before the first gate, the goal behind it. Throws std::invalid_argument on
// a bad config, or if many layouts have no such loop.
FLOCKSTEP_API std::shared_ptr<const World> race_track(const RaceTrackConfig& config);

// Two worlds for benchmarks: an open floor with a few boxes, and the same floor full of vases and boulders, 109,000 textured
// triangles.
FLOCKSTEP_API std::shared_ptr<const World> bench_simple();
FLOCKSTEP_API std::shared_ptr<const World> bench_complex();  // see bench_simple()

}  // namespace flockstep
