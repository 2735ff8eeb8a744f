// Floor plans of generated offices: wings of rooms along corridors, separated by lounges that span the building's depth.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "generators/places.hpp"
#include "planning/draws.hpp"

namespace flockstep::indoors {

enum class RoomUse : std::uint8_t { corridor, lounge, open_plan, meeting, single, storage };

// The sides of a room in index order: low y, high x, high y, low x.
enum class Side : std::uint8_t { south, east, north, west };
constexpr std::array kSides{Side::south, Side::east, Side::north, Side::west};
inline bool is_along_x(Side side) { return side == Side::south || side == Side::north; }

// A hole in a room's wall. from and to are coordinates along the wall.
struct Opening {
  Side side = Side::south;
  double from = 0.0, to = 0.0;
  double low = 0.0, high = 0.0;  // m, above the floor
  bool is_window = false;
};

struct Room {
  Rect cell;  // m, bounds up to the walls' midlines; multiples of 0.5 m
  RoomUse use = RoomUse::single;
  std::vector<Opening> openings;

  Rect inside() const;  // bounds between the walls
};

// A door, open or closed, or a passage without a door, between two rooms.
struct Door {
  std::size_t from = 0, to = 0;  // room indices
  bool is_across_x = false;      // the path through it runs along x
  Vec2d at = Vec2d::Zero();      // centre
  double width = 0.0, high = 0.0;
  bool is_closed = false;
};

struct FloorPlan {
  static constexpr double kHigh = 3.0;        // m, height of every room
  static constexpr double kHalfWall = 0.1;    // m, half thickness of inner walls
  static constexpr double kOuterWall = 0.15;  // m, extra thickness of outer walls, outwards

  Vec2d size = Vec2d::Zero();
  std::vector<Room> rooms;
  std::vector<Door> doors;

  // Returns the doors on a path between two rooms, in order. The path uses the fewest doors. A path always exists.
  std::vector<std::size_t> doors_between(std::size_t from, std::size_t to) const;
};

// Draws a floor plan for a building of the given size in m. The size must be a multiple of 0.5 m and at least 20 x 14 m. Every
// room is reachable, and no door is closed yet.
FloorPlan floor_plan(const Vec2d& size, Draws& draws);

}  // namespace flockstep::indoors
