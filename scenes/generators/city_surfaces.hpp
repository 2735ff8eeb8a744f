// CitySurfaces: the materials of a generated city. Their textures are painted procedurally.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/world_builder.hpp"

namespace flockstep::streets {

// A wall with windows. Its texture shows four bays and `floors` floors.
struct Facade {
  std::uint16_t windows = 0, plain = 0;  // materials of the same colour, with and without windows
  double bay_m = 0.0, floor_m = 0.0;
  int floors = 4;
};

struct CitySurfaces {
  // The textures of lanes and zebra span the width of the roadway.
  std::uint16_t lanes = 0, zebra = 0, asphalt = 0, pavement = 0, kerb = 0, grass = 0, gravel = 0, water = 0;
  std::vector<Facade> brick, plaster, stone, glass, concrete;
  Facade shops, hall;  // single-storey ground floors
  std::uint16_t trim = 0, tiles = 0, iron = 0, tank = 0, machine = 0, panes = 0, door = 0;
  std::uint16_t bark = 0, wood = 0, pole = 0, lamp = 0, red = 0, amber = 0, green = 0, hydrant = 0, bin = 0, cable = 0,
                poster = 0, sign = 0;
  std::vector<std::uint16_t> roofs, leaves, awnings;
  std::uint16_t car = 0;
};

// Columns of the car texture.
enum class CarColor : std::uint8_t { tyre, hub, plastic, glass_low, glass_high, head, tail, first_paint };
inline constexpr int kCarPaints = 9, kCarColors = 16;

// Adds all materials and textures to the builder.
CitySurfaces add_city_surfaces(WorldBuilder& builder, std::uint64_t seed);

}  // namespace flockstep::streets
