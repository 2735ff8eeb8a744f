// Furniture: desks, shelves, plants, pallets and all else that stands in generated offices and warehouses.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "flockstep/world_builder.hpp"
#include "generators/places.hpp"
#include "generators/shape.hpp"
#include "planning/draws.hpp"

namespace flockstep::indoors {

// What a thing is: the semantic id that cameras report of it, less 1.
enum class Kind : std::uint8_t {
  floor,
  wall,
  ceiling,
  door,
  window,
  lamp,
  column,
  desk,
  chair,
  table,
  shelf,
  sofa,
  plant,
  monitor,
  picture,
  whiteboard,
  kitchen,
  appliance,
  rug,
  rack,
  pallet,
  carton,
  barrel,
  forklift,
  conveyor,
  beam,
  count,
};

// The floor below something, m: uv run along the sides of the rectangle and from t = 0 within to t = 1 at the border, so far out
// that a texture there goes over into the floor around.
MeshPart shade(const Rect& rect, double out, double repeat_m);

const char* name(Kind kind);
inline std::uint16_t semantic(Kind kind) { return static_cast<std::uint16_t>(static_cast<int>(kind) + 1); }

// Puts pieces into a world, each an object of its own. The front of a piece is its +y; what stands against a wall has its back
// there. Sizes are (across, deep, high), and the spot is the middle of what the piece covers.
class Furniture {
 public:
  Furniture(WorldBuilder& builder, std::uint32_t purpose, std::uint64_t seed, Draws& draws)
      : builder_(builder), draws_(draws), texture_(swatch_texture(builder, purpose, seed)) {}

  void add(const Shape& shape, Kind kind) { builder_.mesh(shape.part(), material(kind)); }
  // Of primitives and pieces alike; made when it is first asked for.
  std::uint16_t material(Kind kind);

  // For offices.
  void desk(const Spot& spot);  // with a monitor, somebody sits at its front
  void chair(const Spot& spot, Swatch cloth);
  void meeting_table(const Spot& spot, double across, double deep);
  void round_table(const Spot& spot, double radius);
  void stool(const Spot& spot);
  void bookshelf(const Spot& spot, const Vec3d& size);
  void cabinet(const Spot& spot, const Vec3d& size);
  void sofa(const Spot& spot, double across, Swatch cloth);
  void coffee_table(const Spot& spot);
  void rug(const Spot& spot, double across, double deep);
  void plant(const Spot& spot, double high);
  void kitchen(const Spot& spot, double across);
  void fridge(const Spot& spot);
  void printer(const Spot& spot);
  void water_cooler(const Spot& spot);
  void bin(const Spot& spot);
  // On a wall: the spot is on it, z above the floor of the middle.
  void framed(const Spot& spot, double z, double across, double high, Swatch picture, Kind kind);

  // For warehouses.
  void pallet(const Spot& spot);              // 1.2 x 0.8 m, 0.14 m high
  void load(const Spot& spot, double high);   // on a pallet: cartons, up to so high above the spot's floor
  void cartons(const Spot& spot, int count);  // a small stack
  void barrel(const Spot& spot, Swatch paint);
  void forklift(const Spot& spot);
  void conveyor(const Spot& spot, double deep);  // along its y
  void workbench(const Spot& spot);

 private:
  Swatch any_color();

  WorldBuilder& builder_;
  Draws& draws_;
  std::uint16_t texture_;
  std::array<std::optional<std::uint16_t>, static_cast<std::size_t>(Kind::count)> materials_;
};

}  // namespace flockstep::indoors
