// Cars of a generated city.
#pragma once

#include <memory>

#include "flockstep/world.hpp"
#include "generators/city_parts.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

enum class CarKind : std::uint8_t { hatchback, sedan, estate, taxi, van, bus };

struct CarSize {
  double length, width, height;  // m
};
CarSize size_of(CarKind kind);

// Adds a car with its middle at the frame's origin on the road, facing along the frame's x axis.
void add_car(WorldBuilder& builder, std::uint16_t material, const Frame& frame, CarKind kind, Draws& draws);

// Returns a car as a world, for a body: it faces along x, with its middle on the ground at the origin. material: of the city.
std::shared_ptr<const World> moving_car(const World& city, std::uint16_t material, CarKind kind, Draws& draws);

}  // namespace flockstep::streets
