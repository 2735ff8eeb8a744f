// Generates offices: a floor of a building with corridors, rooms and lounges, and a flight lane through its doors.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/world_builder.hpp"
#include "generators/floor_plan.hpp"
#include "generators/furniture.hpp"
#include "generators/layouts.hpp"
#include "generators/movers.hpp"
#include "generators/noise.hpp"
#include "generators/parts.hpp"
#include "generators/places.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep::indoors {
namespace {

enum class Floor : std::uint8_t { carpet, wood, tile };

// Returns the colour of a floor at (x, y) in m. The pattern repeats every `repeat` m.
Color floor_color(const Noise& noise, Floor floor, double x, double y, double repeat) {
  const auto octaves = [&](double across, double down, int count) {
    return noise.octaves(across * x, down * y, count, static_cast<int>(repeat * std::max(across, down)));
  };
  switch (floor) {
    case Floor::carpet: {
      const bool is_odd = (static_cast<int>(2.0 * x) + static_cast<int>(2.0 * y)) % 2 == 1;  // rotates every other 0.5 m tile
      const double pile = is_odd ? octaves(64.0, 64.0, 1) : octaves(32.0, 64.0, 2);
      return mixed(Color{0.17F, 0.18F, 0.20F}, Color{0.29F, 0.30F, 0.33F}, 0.15 + 0.7 * pile + (is_odd ? 0.08 : 0.0));
    }
    case Floor::wood: {
      const double row = std::floor(5.0 * y);
      const double along = x + 2.0 * noise.at(row, 0.5, 10);
      const double plank = noise.at(std::floor(along), row + 20.0);
      const double grain = noise.octaves(6.0 * x, 40.0 * y + 7.0 * plank, 2, 80);
      const bool is_gap = std::fmod(5.0 * y, 1.0) < 0.035 || along - std::floor(along) < 0.006;
      const Color color = mixed(Color{0.27F, 0.155F, 0.075F}, Color{0.50F, 0.33F, 0.185F}, 0.5 * plank + 0.5 * grain);
      return is_gap ? mixed(color, {0.04F, 0.02F, 0.01F}, 0.7) : color;
    }
    case Floor::tile: {
      const double u = std::fmod(2.0 * x, 1.0), v = std::fmod(2.0 * y, 1.0);
      const double tile = noise.at(std::floor(2.0 * x), std::floor(2.0 * y) + 9.0);
      const double cloud = octaves(3.0, 3.0, 3);
      const bool is_joint = std::min({u, v, 1.0 - u, 1.0 - v}) < 0.012;
      const Color color = mixed(Color{0.40F, 0.39F, 0.37F}, Color{0.58F, 0.57F, 0.54F}, 0.35 * tile + 0.65 * cloud);
      return is_joint ? Color{0.22F, 0.21F, 0.20F} : color;
    }
  }
  return {};
}

class Office {
  static constexpr double kHigh = FloorPlan::kHigh;
  static constexpr double kFlightHeight = 1.35;    // m, height of the lane, start and goal
  static constexpr double kSpawnReach = 0.25;      // m, half size of the spawn box
  static constexpr double kLaneHalfWidth = 0.75;   // m, clearance between furniture and the lane
  static constexpr double kMarkerClearance = 1.1;  // m, clearance between furniture and start or goal
  static constexpr double kRepeat = 2.0;           // m, width of the textures of floors, walls and ceilings
  static constexpr double kEdge = 0.4;             // m, width of the dark edge of floors along walls
  static constexpr double kFrame = 0.06;           // m, thickness of door and window frames

 public:
  Office(const OfficeConfig& config, std::uint32_t attempt)
      : config_(config),
        draws_(Draws::kOffice, config.seed, attempt),
        size_(0.5 * std::floor(2.0 * static_cast<double>(config.size_m[0])),
              0.5 * std::floor(2.0 * static_cast<double>(config.size_m[1]))),
        plan_(floor_plan(size_, draws_)),
        builder_("office/seed-" + std::to_string(config.seed)),
        furniture_(builder_, Draws::kOffice, config.seed, draws_),
        hung_(plan_.rooms.size()) {
    lay_lane();
  }

  std::vector<Vec3> lane() const {
    std::vector<Vec3> points;
    for (const Vec2d& corner : lane_) points.push_back(Vec3d(corner.x(), corner.y(), kFlightHeight).cast<float>());
    return points;
  }

  // Hangs doors that open and close on their own. A leaf that furniture would stop stays open.
  void hang_doors(Movers& movers) const {
    constexpr double kGap = 0.06, kThick = 0.045;  // m, between leaf and frame
    constexpr float kMargin = 0.01F;               // m
    for (const auto& [door, side, hinge] : leaves_) {
      const Vec2d ahead = door->is_across_x ? Vec2d::UnitX() : Vec2d::UnitY(), right(ahead.y(), -ahead.x());
      const double width = door->width - 2.0 * (kFrame + kGap), high = door->high - kFrame - 2.0 * kGap;
      const Vec2d pivot = door->at + side * FloorPlan::kHalfWall * ahead + hinge * (0.5 * width - 0.5 * kThick) * right;
      BodyConfig leaf;
      leaf.name = "door";
      leaf.color = {0.33F, 0.20F, 0.10F};
      leaf.semantic = semantic(Kind::door);
      const Vec2d across = (width * right + kThick * ahead).cwiseAbs();
      leaf.size_m = {static_cast<float>(across.x()), static_cast<float>(across.y()), static_cast<float>(high)};
      const auto at = [&](const Vec2d& middle) {
        return std::array<float, 3>{static_cast<float>(middle.x()), static_cast<float>(middle.y()),
                                    static_cast<float>(0.5 * high + kGap)};
      };
      leaf.position_m = at(door->at + side * FloorPlan::kHalfWall * ahead);
      leaf.motion.kind = BodyMotionKind::hinge;
      leaf.motion.center_m = at(pivot);
      leaf.motion.angle_deg = static_cast<float>(-90.0 * side * hinge);
      leaf.motion.period_s = static_cast<float>(centimetres(movers.draws().uniform(8.0, 14.0)));
      if (movers.add(leaf, 0.0F, kMargin)) continue;
      leaf.position_m =
          at(door->at + side * (FloorPlan::kHalfWall + kGap) * ahead + hinge * (0.5 * door->width + 0.5 * width) * right);
      leaf.motion = {};
      movers.add(leaf, 0.0F, kMargin);
    }
  }

  WorldBuilder built() {
    make_materials();
    for (const Room& room : plan_.rooms) add_shell(room);
    add_facade();
    for (const Door& door : plan_.doors) add_door(door);
    for (std::size_t i = 0; i < plan_.rooms.size(); ++i) {
      Interrupt::poll();
      room_ = i;
      furnish();
    }
    Light light;  // even light from lamps, and a low sun through the windows
    light.sun_direction = {-0.38F, -0.72F, 0.58F};
    light.sun_color = {1.25F, 1.1F, 0.85F};
    light.sky_ambient = {0.93F, 0.92F, 0.89F};
    light.ground_ambient = {0.78F, 0.77F, 0.75F};
    light.zenith_color = {0.22F, 0.45F, 0.82F};
    light.horizon_color = {0.85F, 0.92F, 1.0F};
    builder_.light(light);
    mark_lane(builder_, lane(), kSpawnReach, config_.waypoints);
    return builder_;
  }

 private:
  // ---------------------------------------------------------------------------------------------------------------- lane

  // Lays the lane from a room at the low end of x to one at the high end, through door centres.
  void lay_lane() {
    std::vector<std::size_t> first, last;
    for (std::size_t i = 0; i < plan_.rooms.size(); ++i) {
      const Room& room = plan_.rooms[i];
      if (room.use == RoomUse::corridor || room.use == RoomUse::lounge) continue;
      if (room.cell.low.x() == 0.0) first.push_back(i);
      if (room.cell.high.x() == size_.x()) last.push_back(i);
    }
    const std::size_t from = first[static_cast<std::size_t>(draws_.below(static_cast<int>(first.size())))];
    const std::size_t to = last[static_cast<std::size_t>(draws_.below(static_cast<int>(last.size())))];
    const auto place = [&](std::size_t room) {
      const Rect free = plan_.rooms[room].inside().grown(-1.2);
      return draws_.point(free.low, free.high);
    };
    lane_.push_back(place(from));
    std::size_t room = from;
    const std::vector<std::size_t> doors = plan_.doors_between(from, to);
    for (const std::size_t number : doors) {
      const Door& door = plan_.doors[number];
      const double way = door.is_across_x ? plan_.rooms[room].cell.center().x() - door.at.x()
                                          : plan_.rooms[room].cell.center().y() - door.at.y();
      const Vec2d ahead = (way > 0.0 ? -0.9 : 0.9) * (door.is_across_x ? Vec2d::UnitX() : Vec2d::UnitY());
      lane_.emplace_back(door.at - ahead);
      lane_.emplace_back(door.at + ahead);
      room = door.from == room ? door.to : door.from;
    }
    lane_.push_back(place(to));
    places_.keep_off(lane_, kLaneHalfWidth, kMarkerClearance);
    for (std::size_t i = 0; i < plan_.doors.size(); ++i) {
      Door& door = plan_.doors[i];
      const bool is_inner = door.width < 2.0;
      if (std::find(doors.begin(), doors.end(), i) == doors.end() && is_inner) door.is_closed = draws_.below(3) == 0;
      const Vec2d half = door.is_across_x ? Vec2d(1.1, 0.5 * door.width) : Vec2d(0.5 * door.width, 1.1);
      places_.add({door.at - half, door.at + half});
    }
  }

  // ------------------------------------------------------------------------------------------------------------- shell

  void make_materials() {
    const std::uint64_t seed = config_.seed;
    for (const Floor floor : {Floor::carpet, Floor::wood, Floor::tile}) {
      const auto number = static_cast<std::uint32_t>(floor);
      constexpr std::array<const char*, 3> kNames{"carpet", "wood", "tile"};
      const std::string name = kNames[number];
      const Noise noise(Draws::kOffice, seed, 20 + number);
      const std::uint16_t inner = builder_.texture(name, 256, 256, [&](float s, float t) {
        return floor_color(noise, floor, kRepeat * static_cast<double>(s), kRepeat * static_cast<double>(t), kRepeat);
      });
      const std::uint16_t edge = builder_.texture(name + " edge", 256, 64, [&](float s, float t) {
        const double from_wall = static_cast<double>(t), far = 1.0 - from_wall;
        const Color color = floor_color(noise, floor, kRepeat * static_cast<double>(s), 0.1 + kEdge * from_wall, kRepeat);
        return mixed(color, {0.0F, 0.0F, 0.0F}, 0.5 * far * far);
      });
      floors_[number] = {floor_material(name, inner), floor_material(name + " edge", edge)};
    }
    const Noise pile(Draws::kOffice, seed, 20);
    const std::uint16_t dim = builder_.texture("carpet shade", 128, 32, [&](float s, float t) {
      const double x = kRepeat * static_cast<double>(s), y = 0.3 * static_cast<double>(t);
      return mixed(Color{0.0F, 0.0F, 0.0F}, floor_color(pile, Floor::carpet, x, y, kRepeat),
                   0.42 + 0.58 * static_cast<double>(t));
    });
    shade_ = floor_material("shaded carpet", dim);
    const Noise noise(Draws::kOffice, seed, 30);
    const auto plaster = [&](float s, float t) -> Color {
      const double z = kHigh * (1.0 - static_cast<double>(t));
      const double grain = noise.octaves(32.0 * static_cast<double>(s), 48.0 * static_cast<double>(t), 2, 48);
      if (z < 0.09) return mixed(Color{0.10F, 0.10F, 0.105F}, Color{0.30F, 0.30F, 0.31F}, z > 0.075 ? 1.0 : 0.4 + 4.0 * z);
      const double low = std::clamp(1.0 - (z - 0.09) / 0.7, 0.0, 1.0), top = std::clamp(1.0 - (kHigh - z) / 0.5, 0.0, 1.0);
      const double light = (0.96 + 0.04 * grain) * (1.0 - 0.22 * low * low) * (1.0 - 0.16 * top * top);
      const auto value = static_cast<float>(light);
      return {value, value, value};
    };
    const std::uint16_t wall = builder_.texture("wall", 128, 256, plaster);
    constexpr std::array<Color, 5> kAccents{Color{0.17F, 0.30F, 0.36F}, Color{0.30F, 0.38F, 0.26F}, Color{0.52F, 0.27F, 0.12F},
                                            Color{0.22F, 0.25F, 0.36F}, Color{0.48F, 0.38F, 0.20F}};
    const Color accent = kAccents[static_cast<std::size_t>(draws_.below(5))];
    constexpr std::array<Color, 4> kWhites{Color{0.70F, 0.69F, 0.66F}, Color{0.66F, 0.69F, 0.70F}, Color{0.70F, 0.66F, 0.58F},
                                           Color{0.69F, 0.69F, 0.69F}};
    const Color white = kWhites[static_cast<std::size_t>(draws_.below(4))], shaded = mixed(white, {0.0F, 0.0F, 0.0F}, 0.11);
    const auto painted = [&](const std::string& name, const Color& color) {
      return builder_.material({name, color, semantic(Kind::wall), wall});
    };
    walls_[0] = {painted("wall", white), painted("wall shaded", shaded)};
    walls_[1] = {painted("accent wall", accent), painted("accent wall shaded", mixed(accent, {0.0F, 0.0F, 0.0F}, 0.12))};
    const Noise panels(Draws::kOffice, seed, 31);
    const auto panel = [&](float s, float t) {
      const double x = 4.0 * static_cast<double>(s), y = 4.0 * static_cast<double>(t);
      const bool is_rail =
          std::min({std::fmod(x, 1.0), std::fmod(y, 1.0), 1.0 - std::fmod(x, 1.0), 1.0 - std::fmod(y, 1.0)}) < 0.022;
      const double pores = panels.octaves(32.0 * x, 32.0 * y, 1, 128);
      const double light = 0.52 + 0.05 * panels.at(std::floor(x), std::floor(y)) - (pores > 0.82 ? 0.16 : 0.0);
      const auto value = static_cast<float>(is_rail ? 0.66 : light);
      return Color{value, value, 0.985F * value};
    };
    const std::uint16_t tiles = builder_.texture("ceiling", 256, 256, panel);
    ceiling_ = builder_.material({"ceiling", {1.0F, 1.0F, 1.0F}, semantic(Kind::ceiling), tiles});
    lamp_ = builder_.material({"lamp", {1.0F, 1.0F, 1.0F}, semantic(Kind::lamp), {}});
    facade_ = builder_.material({"facade", {0.42F, 0.41F, 0.39F}, semantic(Kind::wall), {}});
  }

  std::uint16_t floor_material(const std::string& name, std::uint16_t texture) {
    return builder_.material({name, {1.0F, 1.0F, 1.0F}, semantic(Kind::floor), texture});
  }

  Floor floor_of(RoomUse use) const {
    switch (use) {
      case RoomUse::lounge:
      case RoomUse::single:
        return Floor::wood;
      case RoomUse::corridor:
      case RoomUse::storage:
        return Floor::tile;
      default:
        return Floor::carpet;
    }
  }

  // Adds the floor, ceiling, lamps and inner wall faces of a room.
  void add_shell(const Room& room) {
    const Rect in = room.inside();
    const auto& [inner, edge] = floors_[static_cast<std::size_t>(floor_of(room.use))];
    MeshPart floor, border, ceiling;
    const Rect middle = in.grown(-kEdge);
    const auto flat = [&](MeshPart& part, const Rect& rect, double z, bool is_up) {
      const std::array<Vec2d, 4> corners{rect.low, Vec2d(rect.high.x(), rect.low.y()), rect.high,
                                         Vec2d(rect.low.x(), rect.high.y())};
      std::array<std::int32_t, 4> ids{};
      for (std::size_t i = 0; i < 4; ++i) {
        ids[i] = add_vertex(part, {corners[i].x(), corners[i].y(), z}, corners[i].x() / kRepeat, corners[i].y() / kRepeat);
      }
      is_up ? add_triangle(part, ids[0], ids[1], ids[2]) : add_triangle(part, ids[0], ids[2], ids[1]);
      is_up ? add_triangle(part, ids[0], ids[2], ids[3]) : add_triangle(part, ids[0], ids[3], ids[2]);
    };
    flat(floor, middle, 0.0, true);
    flat(ceiling, in, kHigh, false);
    const std::array<Vec2d, 4> outer{in.low, Vec2d(in.high.x(), in.low.y()), in.high, Vec2d(in.low.x(), in.high.y())};
    const std::array<Vec2d, 4> within{middle.low, Vec2d(middle.high.x(), middle.low.y()), middle.high,
                                      Vec2d(middle.low.x(), middle.high.y())};
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t next = (i + 1) % 4;
      const auto at = [&](const Vec2d& corner, double t) {
        return add_vertex(border, {corner.x(), corner.y(), 0.0}, (i % 2 == 0 ? corner.x() : corner.y()) / kRepeat, t);
      };
      const std::int32_t a = at(outer[i], 0.0), b = at(outer[next], 0.0), c = at(within[next], 1.0), d = at(within[i], 1.0);
      add_triangle(border, a, b, c);
      add_triangle(border, a, c, d);
    }
    builder_.mesh(floor, inner);
    builder_.mesh(border, edge);
    builder_.mesh(ceiling, ceiling_);
    // Most rooms get one accent wall, never the one with windows.
    const int accented = draws_.below(room.use == RoomUse::corridor ? 12 : 5);
    for (const Side side : kSides) {
      MeshPart part;
      add_wall(part, room, side);
      const auto& [along_x, along_y] = walls_[static_cast<int>(side) == accented ? 1 : 0];
      builder_.mesh(part, is_along_x(side) ? along_x : along_y);
    }
    add_lamps(room);
  }

  void add_lamps(const Room& room) {
    const Rect& cell = room.cell;
    const Vec2d size = cell.size();
    const bool is_long_in_y = size.y() > size.x();
    const auto count = [](double length) { return std::max(1, static_cast<int>((length - 0.5) / 2.4)); };
    const int across = count(size.x()), down = count(size.y());
    for (int i = 0; i < across; ++i) {
      for (int j = 0; j < down; ++j) {  // aligned to the ceiling's panel grid
        const Vec2d share((i + 0.5) / across, (j + 0.5) / down);
        const Vec2d at = cell.low + share.cwiseProduct(size);
        const Vec2d corner(0.5 * std::floor(2.0 * at.x()), 0.5 * std::floor(2.0 * at.y()));
        const Vec2d half = is_long_in_y ? Vec2d(0.23, 0.48) : Vec2d(0.48, 0.23);
        const Vec2d middle = corner + (is_long_in_y ? Vec2d(0.25, 0.0) : Vec2d(0.0, 0.25));
        builder_.box(Vec3d(middle.x(), middle.y(), kHigh - 0.01).cast<float>(),
                     Vec3d(2.0 * half.x(), 2.0 * half.y(), 0.03).cast<float>(), lamp_);
      }
    }
  }

  // Adds a rectangle of a wall, visible from inside the room. from and to are coordinates along the wall, low and high are
  // heights.
  static void add_pane(MeshPart& part, bool is_along_x, double wall, bool is_positive, double from, double to, double low,
                       double high) {
    if (to - from < 1e-6 || high - low < 1e-6) return;
    const auto at = [&](double along, double z) {
      const Vec3d point = is_along_x ? Vec3d(along, wall, z) : Vec3d(wall, along, z);
      return add_vertex(part, point, along / kRepeat, 1.0 - z / kHigh);
    };
    // Seen from +y, x runs to the left; seen from +x, y runs to the right.
    const bool is_mirrored = is_along_x == is_positive;
    const double left = is_mirrored ? to : from, right = is_mirrored ? from : to;
    const std::int32_t a = at(left, low), b = at(right, low), c = at(right, high), d = at(left, high);
    add_triangle(part, a, b, c);
    add_triangle(part, a, c, d);
  }

  // Adds a wall with holes at its openings.
  static void add_pierced(MeshPart& part, bool is_along_x, double wall, bool is_positive, double from, double to, double low,
                          double high, std::vector<Opening> openings) {
    std::sort(openings.begin(), openings.end(), [](const Opening& a, const Opening& b) { return a.from < b.from; });
    double at = from;
    for (const Opening& opening : openings) {
      add_pane(part, is_along_x, wall, is_positive, at, opening.from, low, high);
      add_pane(part, is_along_x, wall, is_positive, opening.from, opening.to, low, opening.low);
      add_pane(part, is_along_x, wall, is_positive, opening.from, opening.to, opening.high, high);
      at = opening.to;
    }
    add_pane(part, is_along_x, wall, is_positive, at, to, low, high);
  }

  static std::vector<Opening> on_side(const std::vector<Opening>& openings, Side side) {
    std::vector<Opening> found;
    for (const Opening& opening : openings) {
      if (opening.side == side) found.push_back(opening);
    }
    return found;
  }

  static void add_wall(MeshPart& part, const Room& room, Side side) {
    const Rect in = room.inside();
    const bool is_low = side == Side::south || side == Side::west, is_x = is_along_x(side);
    const int axis = is_x ? 0 : 1;
    const double wall = (is_low ? in.low : in.high)[1 - axis];
    add_pierced(part, is_x, wall, is_low, in.low[axis], in.high[axis], 0.0, kHigh, on_side(room.openings, side));
  }

  // Adds the building's outer walls, its roof and the window frames.
  void add_facade() {
    const double out = FloorPlan::kOuterWall, top = kHigh + 0.35;
    MeshPart part;
    for (const Side side : kSides) {
      std::vector<Opening> windows;
      for (const Room& room : plan_.rooms) {
        for (const Opening& opening : on_side(room.openings, side)) {
          if (!opening.is_window) continue;
          windows.push_back(opening);
          add_window(opening);
        }
      }
      const bool is_low = side == Side::south || side == Side::west, is_x = is_along_x(side);
      const int axis = is_x ? 0 : 1;
      const double wall = is_low ? -out : size_[1 - axis] + out;
      add_pierced(part, is_x, wall, !is_low, -out, size_[axis] + out, -0.3, top, windows);
    }
    const Vec3d a(-out, -out, top), c(size_.x() + out, size_.y() + out, top);
    add_quad(part, a, {c.x(), a.y(), top}, c, {a.x(), c.y(), top});
    builder_.mesh(part, facade_);
  }

  // Returns the spot on the inner face of a side's wall, facing into the room.
  Spot on_wall(const Rect& in, Side side, double along) const {
    switch (side) {
      case Side::south:
        return {{along, in.low.y()}, {0, 1}, 0.0};
      case Side::north:
        return {{along, in.high.y()}, {0, -1}, 0.0};
      case Side::west:
        return {{in.low.x(), along}, {1, 0}, 0.0};
      default:
        return {{in.high.x(), along}, {-1, 0}, 0.0};
    }
  }

  void add_window(const Opening& opening) {
    const Rect whole{Vec2d::Zero(), size_};
    const double inside = FloorPlan::kHalfWall, outside = FloorPlan::kOuterWall;
    const double deep = inside + outside + 0.04, middle = 0.5 * (inside - outside);
    const double width = opening.to - opening.from, high = opening.high - opening.low, z = 0.5 * (opening.low + opening.high);
    Shape shape(on_wall(whole, opening.side, 0.5 * (opening.from + opening.to)));
    for (const double x : {-0.5 * width + 0.5 * kFrame, 0.5 * width - 0.5 * kFrame}) {
      shape.block({x, middle, z}, {kFrame, deep, high}, Swatch::white);
    }
    const double between = width - 2.0 * kFrame;
    shape.block({0, middle, opening.high - 0.5 * kFrame}, {between, deep, kFrame}, Swatch::white);
    shape.block({0, middle, opening.low + 0.5 * kFrame}, {between, deep, kFrame}, Swatch::white);
    shape.block({0, inside + 0.08, opening.low + 0.5 * kFrame}, {width + 0.04, 0.2, 0.03},
                Swatch::white);  // window sill
    if (width > 1.3) shape.block({0, -0.02, z}, {0.05, 0.06, high - 2.0 * kFrame}, Swatch::white);
    shape.block({0, -0.02, opening.high - 0.5}, {between, 0.05, 0.045}, Swatch::white);
    furniture_.add(shape, Kind::window);
  }

  void add_door(const Door& door) {
    const Spot spot{door.at, door.is_across_x ? Vec2d::UnitX() : Vec2d::UnitY(), 0.0};
    const double deep = 2.0 * FloorPlan::kHalfWall + 0.03;
    const Swatch paint = door.width > 2.0 ? Swatch::white : Swatch::walnut;
    Shape shape(spot);
    for (const double x : {-0.5 * door.width + 0.5 * kFrame, 0.5 * door.width - 0.5 * kFrame}) {
      shape.block({x, 0, 0.5 * door.high}, {kFrame, deep, door.high}, paint);
    }
    shape.block({0, 0, door.high - 0.5 * kFrame}, {door.width - 2.0 * kFrame, deep, kFrame}, paint);
    shape.block({0, 0, 0.004}, {door.width - 2.0 * kFrame, deep, 0.008}, Swatch::dark_grey);  // threshold
    if (door.width < 2.0) add_leaf(shape, door);
    furniture_.add(shape, Kind::door);
  }

  // Adds a door leaf: closed in its frame, or open against a wall beside it if there is room.
  void add_leaf(Shape& shape, const Door& door) {
    const double width = door.width - 2.0 * kFrame, high = door.high - kFrame, off = FloorPlan::kHalfWall + 0.06;
    const auto leaf = [&](double x, double y, double side, double handle) {
      shape.block({x, y, 0.5 * high + 0.01}, {width, 0.045, high - 0.03}, Swatch::oak);
      for (const double out : {-0.05, 0.05}) {
        if (side * out < 0.0) continue;
        shape.block({x + handle * (0.5 * width - 0.12), y + out, 1.02}, {0.13, 0.02, 0.025}, Swatch::steel);
      }
    };
    if (door.is_closed) return leaf(0, 0, 0.0, 1.0);
    for (const double side : {1.0, -1.0}) {
      for (const double hinge : {1.0, -1.0}) {
        const Vec2d ahead = door.is_across_x ? Vec2d::UnitX() : Vec2d::UnitY(), right(ahead.y(), -ahead.x());
        const Vec2d middle = door.at + side * off * ahead + hinge * (0.5 * door.width + 0.5 * width) * right;
        const Vec2d half = 0.5 * width * right.cwiseAbs() + 0.05 * ahead.cwiseAbs();
        const Rect rect{middle - half, middle + half};
        for (std::size_t i : {door.from, door.to}) {
          const Room& room = plan_.rooms[i];
          if (!room.inside().contains(rect.grown(0.005)) || !is_clear_of_openings(room, rect)) continue;
          if (config_.walkers > 0) {
            leaves_.push_back({&door, side, hinge});
          } else {
            leaf(hinge * (0.5 * door.width + 0.5 * width), side * off, side, hinge);
          }
          places_.add(rect);
          hung_[i].push_back({side_at(room, door), 0, 0, 0, 0, false});
          Opening& span = hung_[i].back();
          const int axis = door.is_across_x ? 1 : 0;
          span.from = rect.low[axis];
          span.to = rect.high[axis];
          span.high = high;
          return;
        }
      }
    }
  }

  Side side_at(const Room& room, const Door& door) const {
    if (door.is_across_x) return room.cell.center().x() > door.at.x() ? Side::west : Side::east;
    return room.cell.center().y() > door.at.y() ? Side::south : Side::north;
  }

  // Returns whether a rectangle along a wall is free and blocks no opening.
  bool is_clear_of_openings(const Room& room, const Rect& rect) const {
    for (const Opening& opening : room.openings) {
      const Rect in = room.inside();
      const bool is_x = is_along_x(opening.side);
      const bool is_low = opening.side == Side::south || opening.side == Side::west;
      const double wall = (is_low ? in.low : in.high)[is_x ? 1 : 0];
      const Rect hole = is_x ? Rect{{opening.from, wall - 0.3}, {opening.to, wall + 0.3}}
                             : Rect{{wall - 0.3, opening.from}, {wall + 0.3, opening.to}};
      if (hole.overlaps(rect)) return false;
    }
    return !places_.is_taken(rect);
  }

  // --------------------------------------------------------------------------------------------------------- furniture

  const Room& room() const { return plan_.rooms[room_]; }
  bool chance(double share) { return draws_.uniform(0.0, 1.0) < share; }

  static Rect covered(const Spot& spot, double across, double deep) {
    const bool is_y = std::abs(spot.facing.y()) > 0.5;
    const Vec2d half = 0.5 * (is_y ? Vec2d(across, deep) : Vec2d(deep, across));
    return {spot.at - half, spot.at + half};
  }

  // Reserves the place if it is free.
  bool take(const Spot& spot, double across, double deep) {
    return places_.take(covered(spot, across, deep), room().inside().grown(-0.01));
  }

  bool is_wall_free(Side side, double from, double to, double low, double high) const {
    const auto is_in_the_way = [&](const Opening& other) {
      return other.side == side && other.from < to && other.to > from && other.low < high && other.high > low;
    };
    return std::none_of(room().openings.begin(), room().openings.end(), is_in_the_way) &&
           std::none_of(hung_[room_].begin(), hung_[room_].end(), is_in_the_way);
  }

  // Finds a free place on a wall for something between two heights. gap: to the ends of the wall; margin: to what else hangs
  // there. accepts(spot) may move it.
  template <class Accepts>
  std::optional<Spot> on_free_wall(double across, double gap, double margin, double low, double high, const Accepts& accepts) {
    const Rect in = room().inside();
    for (int i = 0; i < 16; ++i) {
      const Side side = kSides[static_cast<std::size_t>(draws_.below(4))];
      const int axis = is_along_x(side) ? 0 : 1;
      const double first = in.low[axis] + 0.5 * across + gap, last = in.high[axis] - 0.5 * across - gap;
      if (last < first) continue;
      const double along = draws_.uniform(first, last);
      const double from = along - 0.5 * across - margin, to = along + 0.5 * across + margin;
      if (!is_wall_free(side, from, to, low, high)) continue;
      Spot spot = on_wall(in, side, along);
      if (!accepts(spot)) continue;
      hung_[room_].push_back({side, from, to, low, high, false});
      return spot;
    }
    return std::nullopt;
  }

  // Reserves a free place with its back to a wall, for a piece `high` m tall.
  std::optional<Spot> against_wall(double across, double deep, double high) {
    return on_free_wall(across, 0.04, 0.0, 0.0, high, [&](Spot& spot) {
      spot.at += (0.5 * deep + 0.03) * spot.facing;
      return take(spot, across, deep);
    });
  }

  // Finds a free place on a wall, centred at height z.
  std::optional<Spot> hang(double across, double high, double z) {
    return on_free_wall(across, 0.2, 0.15, z - 0.5 * high, z + 0.5 * high, [&](const Spot& spot) {
      return places_.is_off_lane(covered({spot.at + 0.05 * spot.facing, spot.facing, 0.0}, across, 0.1));
    });
  }

  std::optional<Spot> anywhere(double across, double deep) {
    const Rect in = room().inside();
    constexpr std::array<std::array<int, 2>, 4> kWays{{{0, 1}, {0, -1}, {1, 0}, {-1, 0}}};
    for (int i = 0; i < 16; ++i) {
      const auto& way = kWays[static_cast<std::size_t>(draws_.below(4))];
      const Spot spot{draws_.point(in.low, in.high), {static_cast<double>(way[0]), static_cast<double>(way[1])}, 0.0};
      if (take(spot, across, deep)) return spot;
    }
    return std::nullopt;
  }

  // Returns how often to try placing something, scaled by the furniture density.
  int times(double full) { return static_cast<int>(full * static_cast<double>(config_.furniture) + draws_.uniform(0.0, 1.0)); }

  void furnish() {
    switch (room().use) {
      case RoomUse::corridor:
        return furnish_corridor();
      case RoomUse::lounge:
        return furnish_lounge();
      case RoomUse::open_plan:
        return furnish_open_plan();
      case RoomUse::meeting:
        return furnish_meeting();
      case RoomUse::single:
        return furnish_single();
      case RoomUse::storage:
        return furnish_storage();
    }
  }

  // Darkens the floor below a rectangle and `out` m around it. Only carpet gets this, because it would break the pattern of
  // planks and tiles.
  void add_shade(const Rect& rect, double out) {
    const bool is_carpet = floor_of(room().use) == Floor::carpet;
    if (is_carpet && room().inside().contains(rect.grown(out))) builder_.mesh(shade(rect, out, kRepeat), shade_);
  }

  void add_pictures(int count) {
    struct Painting {
      Swatch swatch;
      double shape;  // width over height
    };
    constexpr std::array<Painting, 5> kPaintings{{{Swatch::painting_a, 1.0},
                                                  {Swatch::painting_d, 2.0},
                                                  {Swatch::painting_b, 1.0},
                                                  {Swatch::painting_e, 2.0},
                                                  {Swatch::painting_c, 1.0}}};
    for (int i = 0; i < count; ++i) {
      painting_ = (painting_ + 1 + static_cast<std::size_t>(draws_.below(4))) % kPaintings.size();  // no repeats
      const double high = draws_.uniform(0.5, 0.75), across = kPaintings[painting_].shape * high;
      if (const auto spot = hang(across, high, 1.6)) {
        furniture_.framed(*spot, 1.6, across, high, kPaintings[painting_].swatch, Kind::picture);
      }
    }
  }

  void add_plants(int count, double low, double high) {
    for (int i = 0; i < count; ++i) {
      const double tall = draws_.uniform(low, high);
      if (const auto place = against_wall(0.6, 0.6, 0.6)) furniture_.plant(*place, tall);
    }
  }

  void add_shelves(int count) {
    for (int i = 0; i < count; ++i) {
      const bool is_low = draws_.below(3) == 0;
      const double across = draws_.uniform(0.8, 1.4), high = is_low ? 0.78 : draws_.uniform(1.7, 2.1);
      const Vec3d size(across, is_low ? 0.45 : 0.34, high);
      if (const auto place = against_wall(size.x(), size.y(), size.z())) {
        is_low ? furniture_.cabinet(*place, size) : furniture_.bookshelf(*place, size);
      }
    }
  }

  void furnish_corridor() {
    add_pictures(times(room().cell.size().x() / 2.5));
    add_plants(times(1.5), 0.8, 1.3);
    if (chance(0.5)) {
      if (const auto place = against_wall(0.36, 0.36, 1.5)) furniture_.water_cooler(*place);
    }
  }

  void furnish_open_plan() {
    const Rect in = room().inside();
    const bool is_turned = draws_.below(2) == 0;  // desk islands along y
    constexpr double kDesk = 1.62, kHalf = 1.68, kIsland = 4.0;
    const Vec2d size = is_turned ? Vec2d(in.size().y(), in.size().x()) : in.size();
    const auto at = [&](double u, double v) -> Vec2d { return in.low + (is_turned ? Vec2d(v, u) : Vec2d(u, v)); };
    const Vec2d ahead = is_turned ? Vec2d::UnitX() : Vec2d::UnitY();
    const int rows = std::max(1, static_cast<int>((size.y() - 0.4) / kIsland));
    const Swatch cloth = draws_.below(3) == 0 ? Swatch::blue : draws_.below(2) == 0 ? Swatch::dark_grey : Swatch::teal;
    for (int row = 0; row < rows; ++row) {
      const double v = size.y() * (row + 0.5) / rows;
      for (double u = 1.0 + 0.5 * kDesk; u + 0.5 * kDesk < size.x() - 0.6; u += kDesk) {
        for (const double side : {1.0, -1.0}) {
          if (!chance(0.25 + 0.75 * static_cast<double>(config_.furniture))) continue;
          if (!take({at(u, v + side * 0.5 * kHalf), ahead, 0.0}, kDesk - 0.02, kHalf - 0.02)) continue;
          furniture_.desk({at(u, v + side * 0.42), side * ahead, 0.0});
          add_shade(covered({at(u, v + side * 0.55), ahead, 0.0}, 1.1, 0.5), 0.25);
          const Vec2d aside = draws_.point({-0.3, -0.3}, {0.3, 0.3});
          furniture_.chair(
              {at(u + 0.4 * aside.x(), v + side * (1.22 + 0.3 * aside.y())), Vec2d(-side * ahead + aside).normalized(), 0.0},
              cloth);
        }
      }
    }
    add_shelves(times(in.area() / 14.0));
    add_plants(times(in.area() / 16.0), 0.9, 1.7);
    if (chance(0.7)) {
      if (const auto spot = hang(2.0, 1.1, 1.45)) furniture_.framed(*spot, 1.45, 2.0, 1.1, Swatch::whiteboard, Kind::whiteboard);
    }
    if (chance(0.4)) {
      if (const auto place = against_wall(0.7, 0.65, 1.1)) furniture_.printer(*place);
    }
    add_pictures(times(3.0));
    if (const auto place = against_wall(0.36, 0.36, 0.4)) furniture_.bin(*place);
  }

  void furnish_meeting() {
    const Rect in = room().inside();
    const bool is_turned = in.size().y() > in.size().x();
    const double longer = in.size().maxCoeff();
    const Vec2d facing = is_turned ? Vec2d::UnitX() : Vec2d::UnitY();
    for (int i = 0; i < 40; ++i) {
      const double across = std::clamp(longer - 2.6 - 0.06 * i, 1.6, 4.8), deep = 1.25;
      const Vec2d aside = 0.03 * i * draws_.point({-1, -1}, {1, 1});
      const Spot spot{in.center() + aside, facing, 0.0};
      if (!take(spot, across + 0.2, deep + 1.5)) continue;
      furniture_.meeting_table(spot, across, deep);
      add_shade(covered(spot, across - 0.5, deep - 0.5), 0.45);
      break;
    }
    if (const auto spot = hang(1.7, 1.0, 1.5)) furniture_.framed(*spot, 1.5, 1.7, 1.0, Swatch::slides, Kind::monitor);
    if (const auto spot = hang(2.0, 1.1, 1.45)) furniture_.framed(*spot, 1.45, 2.0, 1.1, Swatch::whiteboard, Kind::whiteboard);
    if (chance(0.6)) {
      if (const auto place = against_wall(1.6, 0.45, 0.78)) furniture_.cabinet(*place, {1.6, 0.45, 0.78});
    }
    add_plants(times(2.5), 1.0, 1.8);
    add_pictures(times(2.0));
  }

  void furnish_single() {
    const Swatch cloth = draws_.below(2) == 0 ? Swatch::dark_grey : Swatch::rust;
    const int desks = 1 + (room().cell.area() > 22.0 ? 1 : 0);
    for (int i = 0; i < desks; ++i) {
      if (const auto spot = anywhere(1.7, 2.0)) {
        furniture_.desk({spot->at - 0.55 * spot->facing, spot->facing, 0.0});
        furniture_.chair(
            {spot->at + 0.3 * spot->facing, Vec2d(-spot->facing + draws_.point({-0.3, -0.3}, {0.3, 0.3})).normalized(), 0.0},
            cloth);
      }
    }
    add_shelves(times(3.0));
    if (chance(0.4)) {
      if (const auto place = against_wall(1.5, 0.9, 0.85)) furniture_.sofa(*place, 1.45, cloth);
    }
    add_plants(times(2.0), 0.8, 1.6);
    add_pictures(times(3.0));
    if (const auto place = against_wall(0.36, 0.36, 0.4)) furniture_.bin(*place);
  }

  void furnish_storage() {
    add_shelves(times(room().cell.area() / 3.0));
    if (const auto place = against_wall(0.7, 0.65, 1.1)) furniture_.printer(*place);
    for (int i = times(4.0); i > 0; --i) {
      if (const auto place = against_wall(0.66, 0.56, 1.0)) furniture_.cartons(*place, 1 + draws_.below(3));
    }
  }

  void furnish_lounge() {
    const Rect in = room().inside();
    const double area = in.area();
    // A kitchenette with a fridge beside it.
    if (const auto place = against_wall(3.5, 0.68, 2.15)) {
      Spot kitchen = *place, fridge = *place;
      const Vec2d right(kitchen.facing.y(), -kitchen.facing.x());
      kitchen.at -= 0.36 * right;
      fridge.at += 1.4 * right;
      furniture_.kitchen(kitchen, 2.7);
      furniture_.fridge(fridge);
    }
    for (int i = 0; i < std::max(2, static_cast<int>(area / 30.0)); ++i) {
      const double radius = 0.22;
      for (int k = 0; k < 16; ++k) {
        const Vec2d at = draws_.point(in.low + Vec2d::Constant(0.6), in.high - Vec2d::Constant(0.6));
        if (!take({at, Vec2d::UnitY(), 0.0}, 2.0 * radius + 0.3, 2.0 * radius + 0.3)) continue;
        Shape column({at, Vec2d::UnitY(), 0.0});
        const std::array<Vec2d, 2> side{Vec2d(radius, 0.0), Vec2d(radius, kHigh)};
        column.turned({0, 0}, side, Swatch::white, 16);
        furniture_.add(column, Kind::column);
        break;
      }
    }
    constexpr std::array<Swatch, 4> kCloths{Swatch::teal, Swatch::rust, Swatch::navy, Swatch::grey};
    for (int i = times(area / 20.0); i > 0; --i) {  // sofas around a table
      const auto spot = anywhere(2.6, 3.2);
      if (!spot) continue;
      const Swatch cloth = kCloths[static_cast<std::size_t>(draws_.below(4))];
      furniture_.rug(*spot, 2.4, 2.9);
      furniture_.coffee_table(*spot);
      furniture_.sofa({spot->at - 1.1 * spot->facing, spot->facing, 0.0}, 2.1, cloth);
      if (chance(0.7)) furniture_.sofa({spot->at + 1.1 * spot->facing, -spot->facing, 0.0}, 2.1, cloth);
    }
    for (int i = times(area / 16.0); i > 0; --i) {  // stools around a table
      const auto spot = anywhere(2.1, 2.1);
      if (!spot) continue;
      furniture_.round_table(*spot, 0.45);
      const auto first = static_cast<std::size_t>(draws_.below(16));
      for (std::size_t k = 0; k < 3; ++k)
        furniture_.stool({spot->at + 0.75 * circle()[(first + 5 * k) % 16], Vec2d::UnitY(), 0.0});
    }
    if (const auto place = against_wall(0.36, 0.36, 1.5)) furniture_.water_cooler(*place);
    add_shelves(times(2.0));
    add_plants(times(area / 14.0), 1.0, 1.9);
    add_pictures(times(area / 16.0));
  }

  const OfficeConfig& config_;
  Draws draws_;
  Vec2d size_;
  FloorPlan plan_;
  WorldBuilder builder_;
  Furniture furniture_;
  std::vector<Vec2d> lane_;                 // corner points
  Places places_;                           // footprints of furniture and door swings
  std::vector<std::vector<Opening>> hung_;  // per room: wall areas in use
  // Leaves of open doors in an office with people: the side on which it opens, and the side of its hinge seen from there.
  struct Leaf {
    const Door* door;
    double side, hinge;
  };
  std::vector<Leaf> leaves_;
  std::size_t painting_ = 0;  // index of the last painting hung
  std::size_t room_ = 0;      // index of the room being furnished

  struct Pair {
    std::uint16_t first = 0, second = 0;
  };
  std::array<Pair, 3> floors_;  // per Floor: middle, edge
  std::array<Pair, 2> walls_;   // walls along x, walls along y: plain, accented
  std::uint16_t shade_ = 0, ceiling_ = 0, lamp_ = 0, facade_ = 0;
};

std::shared_ptr<const World> with_walkers(const std::shared_ptr<const World>& world, const Office& office,
                                          const OfficeConfig& config, std::uint32_t attempt) {
  if (config.walkers == 0) return world;
  constexpr std::array<std::array<float, 3>, 3> kClothes{{{0.10F, 0.16F, 0.35F}, {0.35F, 0.10F, 0.10F}, {0.25F, 0.25F, 0.22F}}};
  std::vector<BodyConfig> walkers;
  for (const auto& color : kClothes) {
    BodyConfig walker;
    walker.name = "walker";
    walker.shape = BodyShape::capsule;
    walker.size_m = {0.5F, 0.5F, 1.75F};
    walker.position_m[2] = 0.955F;
    walker.color = color;
    walkers.push_back(walker);
  }
  Movers movers(*world, Draws::kOffice, config.seed, attempt);
  const Aabb area{Vec3::Zero(), Vec3(config.size_m[0], config.size_m[1], 0.0F)};
  office.hang_doors(movers);
  movers.add_on_lines(walkers, config.walkers, {.area = area, .least_m = 2.0, .most_m = 8.0, .least_mps = 0.6, .most_mps = 1.4});
  return world->with_bodies(movers.bodies());
}

}  // namespace
}  // namespace flockstep::indoors

namespace flockstep {

void OfficeConfig::validate() const { check_fields(*this, "office: "); }

std::shared_ptr<const World> office(const OfficeConfig& config) {
  using namespace indoors;
  return with_crooked_lane<Office>(config, "office: seed",
                                   [&](const std::shared_ptr<const World>& world, const Office& layout, std::uint32_t attempt) {
                                     return with_walkers(world, layout, config, attempt);
                                   });
}

}  // namespace flockstep
