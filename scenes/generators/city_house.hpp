// Houses of a generated city.
#pragma once

#include <array>

#include "generators/city_parts.hpp"
#include "generators/city_surfaces.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

enum class Side : std::uint8_t { street, alley, party };  // party: another house stands against it

// A rectangle that a house fills. Its sides face -y, +x, +y, -x.
struct Lot {
  Vec2d low, high;
  std::array<Side, 4> sides;

  Vec2d size() const { return high - low; }
};

// Returns its height up to the roof, m, at most max_height_m where that is 8 or more. boldness in [0, 1]: how tall it would be.
double add_house(WorldBuilder& builder, const CitySurfaces& surfaces, const Lot& lot, double max_height_m, double boldness,
                 Draws& draws);

}  // namespace flockstep::streets
