// Street objects and cars of a generated city. In their frames x runs along the kerb, y points away from the road, and z = 0 is
// the ground.
#pragma once

#include <memory>

#include "flockstep/world.hpp"
#include "generators/city_parts.hpp"
#include "generators/city_surfaces.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

// Size of a tree in m.
struct TreeSize {
  double tall, fork, reach;  // height of the tip; height of the crown's base; crown radius
};

void add_tree(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot, const TreeSize& size, Draws& draws);
// 6.5 m tall, with its head reaching 1.9 m over the road.
void add_lamp(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
// 5.7 m tall, with an arm at 5.2 m that reaches arm_m over the road.
void add_traffic_light(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, double arm_m);
void add_bench(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_hydrant(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_bin(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_planter(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws);
// 4 m long, 1.5 m deep, 2.6 m tall.
void add_bus_stop(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
// Two chairs, a table and a parasol on a 2.4 m pole.
void add_table(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws);
// 4 m wide.
void add_fountain(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot);
// A wire that sags by sag_m in the middle, with flags along it or a lamp in the middle.
enum class Hung : std::uint8_t { nothing, flags, lamp };
void add_cable(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& from, const Vec3d& to, double sag_m, Hung hung);
// An enclosed glass bridge between two walls, given by opposite corners.
void add_bridge(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& low, const Vec3d& high);

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
