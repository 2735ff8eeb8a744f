// The parts of a generated city: surfaces, houses, street objects and cars, and the geometry that these share. Each has a file
// of its own, such as city_house.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/world.hpp"
#include "flockstep/world_builder.hpp"
#include "generators/parts.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {

// --- geometry

inline constexpr double kPavementHeight = 0.14;  // m, above the road

// The mesh parts of one thing, by material. Each material becomes one object.
class Thing {
 public:
  MeshPart& of(std::uint16_t material) { return parts_[material]; }
  void into(WorldBuilder& builder) const {
    for (const auto& [material, part] : parts_) builder.mesh(part, material);
  }

 private:
  std::map<std::uint16_t, MeshPart> parts_;
};

// A level frame: x along `along`, y to the left of it, z up.
struct Frame {
  Vec3d at;
  Vec2d along;  // unit vector

  Vec3d operator()(double x, double y, double z) const {
    return at + Vec3d(x * along.x() - y * along.y(), x * along.y() + y * along.x(), z);
  }
};

// Adds a quad with corners in the order of add_quad. `first` and `third` are the texture coordinates of a and c.
void add_panel(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, const std::array<double, 2>& first,
               const std::array<double, 2>& third);

// Adds a block given in a frame.
void add_block(MeshPart& part, const Frame& frame, const Vec3d& center, const Vec3d& size, double repeat_m = 1.0);

// Returns the corners of a regular polygon with 8 or 12 sides on the unit circle, counter-clockwise from (1, 0).
std::span<const Vec2d> circle(int sides);

// Adds a surface of revolution about a vertical axis. The profile holds (radius, height) from bottom to top. A radius of 0
// closes the surface.
void add_turned(MeshPart& part, const Vec3d& foot, std::span<const std::array<double, 2>> profile, int sides = 8);

// Adds a wire with a triangular cross-section through the points.
void add_wire(MeshPart& part, std::span<const Vec3d> points, double radius);

// Returns the rotation from the z axis to a unit direction, which must not be straight down.
Quat turned_to(const Vec3d& direction);

// --- surfaces

// A wall with windows. Its texture shows four bays and `floors` floors.
struct Facade {
  std::uint16_t windows = 0, plain = 0;  // materials of the same colour, with and without windows
  double bay_m = 0.0, floor_m = 0.0;
  int floors = 4;
};

// The materials of a city. Their textures are painted procedurally.
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

// --- houses

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

// --- street objects and cars. In their frames x runs along the kerb, y points away from the road, and z = 0 is the ground.

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
