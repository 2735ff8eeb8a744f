// What stands in the streets of a generated city. x of a frame runs along the kerb, y away from the road; z 0 is the ground.
#pragma once

#include "generators/city_parts.hpp"
#include "generators/city_surfaces.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

// How far it reaches, m.
struct TreeSize {
  double tall, fork, reach;  // up to its tip; up to its crown; sideways
};

void add_tree(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot, const TreeSize& size, Draws& draws);
// 6.5 m tall; its head 1.9 m over the road.
void add_lamp(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
// 5.7 m tall; its arm reaches so far over the road, at 5.2 m.
void add_traffic_light(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, double arm_m);
void add_bench(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_hydrant(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_bin(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
void add_planter(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws);
// 4 m long, 1.5 m deep, 2.6 m tall.
void add_bus_stop(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame);
// Two chairs, a table, a parasol of 2.4 m.
void add_table(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws);
// 4 m wide.
void add_fountain(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot);
// A wire that sags so far in its middle, with flags on it, or a lamp in the middle.
enum class Hung : std::uint8_t { nothing, flags, lamp };
void add_cable(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& from, const Vec3d& to, double sag_m, Hung hung);
// A closed bridge of glass between two walls: from one corner below to the opposite one above.
void add_bridge(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& low, const Vec3d& high);

}  // namespace flockstep::streets
