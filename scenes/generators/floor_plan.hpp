// Floor plans of generated offices: wings of rooms along corridors, and a lounge from front to back between one wing and the
// next.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "generators/places.hpp"
#include "planning/draws.hpp"

namespace flockstep::indoors {

enum class RoomUse : std::uint8_t { corridor, lounge, open_plan, meeting, single, storage };

// The sides of a room in the order of their numbers: y low, x high, y high, x low.
enum class Side : std::uint8_t { south, east, north, west };
constexpr std::array kSides{Side::south, Side::east, Side::north, Side::west};
inline bool is_along_x(Side side) { return side == Side::south || side == Side::north; }

// A hole in the walls of a side. from and to are coordinates along it.
struct Opening {
  Side side = Side::south;
  double from = 0.0, to = 0.0;
  double low = 0.0, high = 0.0;  // above the floor
  bool is_window = false;
};

struct Room {
  Rect cell;  // to the middle of its walls; a multiple of half a metre each
  RoomUse use = RoomUse::single;
  std::vector<Opening> openings;

  Rect inside() const;  // between its walls
};

// A door, open or not, or a passage without one, between two rooms.
struct Door {
  std::size_t from = 0, to = 0;  // numbers of rooms
  bool is_across_x = false;      // one goes through it along x
  Vec2d at = Vec2d::Zero();      // its middle
  double width = 0.0, high = 0.0;
  bool is_closed = false;
};

struct FloorPlan {
  static constexpr double kHigh = 3.0;        // m, of every room
  static constexpr double kHalfWall = 0.1;    // m: walls within
  static constexpr double kOuterWall = 0.15;  // m: what the outer walls add outwards

  Vec2d size = Vec2d::Zero();
  std::vector<Room> rooms;
  std::vector<Door> doors;

  // The doors from a room to another one, by the fewest that are needed, in their order. There always is such a way.
  std::vector<std::size_t> doors_between(std::size_t from, std::size_t to) const;
};

// A plan of a building of this size, m, a multiple of half a metre and at least 20 x 14 m. All doors of the way between rooms
// may be reached; none is closed yet.
FloorPlan floor_plan(const Vec2d& size, Draws& draws);

}  // namespace flockstep::indoors
