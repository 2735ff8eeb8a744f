// Houses of a generated city.
#pragma once

#include <array>

#include "generators/city_parts.hpp"
#include "generators/city_surfaces.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

enum class Side : std::uint8_t { street, alley, party };  // party: shared with a neighbouring house

// The rectangular footprint of a house. Its sides face -y, +x, +y, -x, in this order.
struct Lot {
  Vec2d low, high;
  std::array<Side, 4> sides;

  Vec2d size() const { return high - low; }
};

// Adds a house and returns its roof height in m. The height is at most max_height_m if that is 8 or more. boldness in [0, 1]
// scales the height.
double add_house(WorldBuilder& builder, const CitySurfaces& surfaces, const Lot& lot, double max_height_m, double boldness,
                 Draws& draws);

}  // namespace flockstep::streets
