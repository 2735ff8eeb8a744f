// Furniture and equipment of generated offices and warehouses.
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

// The class of an object. Cameras report this value plus 1 as the semantic id.
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

// Returns a darkened floor patch below an object, extending `out` m beyond the rectangle. s runs along its sides, and t goes
// from 0 inside to 1 at the outer border, so the texture can fade into the surrounding floor.
MeshPart shade(const Rect& rect, double out, double repeat_m);

const char* name(Kind kind);
inline std::uint16_t semantic(Kind kind) { return static_cast<std::uint16_t>(static_cast<int>(kind) + 1); }

// Adds pieces of furniture to a world, each as a separate object. The front of a piece faces +y; the back of a piece at a wall
// touches the wall. Sizes are (across, deep, high) in m. The spot is the centre of the footprint.
class Furniture {
 public:
  Furniture(WorldBuilder& builder, std::uint32_t purpose, std::uint64_t seed, Draws& draws)
      : builder_(builder), draws_(draws), texture_(swatch_texture(builder, purpose, seed)) {}

  void add(const Shape& shape, Kind kind) { builder_.mesh(shape.part(), material(kind)); }
  // Returns the material for pieces and primitives of a kind. It is created on first use.
  std::uint16_t material(Kind kind);

  // Office furniture.
  void desk(const Spot& spot);  // with a monitor; the seat is at its front
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
  // Hangs a framed sheet on a wall. The spot lies on the wall; z is the height of the centre above the floor.
  void framed(const Spot& spot, double z, double across, double high, Swatch picture, Kind kind);

  // Warehouse equipment.
  void pallet(const Spot& spot);              // 1.2 x 0.8 m, 0.14 m high
  void load(const Spot& spot, double high);   // cartons on a pallet, at most `high` above the spot's floor
  void cartons(const Spot& spot, int count);  // small stack
  void barrel(const Spot& spot, Swatch paint);
  void forklift(const Spot& spot);
  void moving_forklift(const Spot& spot);        // with a closed cabin, as convex objects
  void conveyor(const Spot& spot, double deep);  // runs along its y axis
  void workbench(const Spot& spot);

 private:
  Swatch any_color();

  WorldBuilder& builder_;
  Draws& draws_;
  std::uint16_t texture_;
  std::array<std::optional<std::uint16_t>, static_cast<std::size_t>(Kind::count)> materials_;
};

}  // namespace flockstep::indoors
