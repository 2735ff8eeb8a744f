#include <algorithm>
#include <cmath>

#include "generators/city_parts.hpp"

namespace flockstep::streets {
namespace {

class House {
  static constexpr double kParapet = 0.9, kParapetWidth = 0.3;  // m

 public:
  House(WorldBuilder& builder, const CitySurfaces& surfaces, const Lot& lot, Draws& draws)
      : builder_(builder), surfaces_(surfaces), lot_(lot), draws_(draws), roof_(one_of(surfaces.roofs)) {}

  double built(double max_height, double boldness) {
    const double wanted = std::min(max_height, 9.0 + boldness * (max_height - 9.0));
    const double narrow = lot_.size().minCoeff(), luck = draws_.uniform(0.0, 1.0);
    double top = 0.0;
    if (wanted > 21.0 && narrow > 10.0) {
      top = luck < 0.4 ? office(wanted) : luck < 0.8 ? deco(wanted) : slab(wanted);
    } else if (wanted > 14.0 || narrow > 18.0) {
      top = luck < 0.45 ? walkup(wanted) : luck < 0.65 ? slab(wanted) : luck < 0.85 ? townhouse(wanted) : deco(wanted);
    } else {
      top = luck < 0.7 ? townhouse(wanted) : walkup(wanted);
    }
    thing_.into(builder_);
    return top;
  }

 private:
  // Returns the frame of a lot's side, from its first corner to the next, counter-clockwise. Its y axis points into the house.
  static Frame side_of(const Lot& lot, std::size_t side) {
    switch (side) {
      case 0:
        return {{lot.low.x(), lot.low.y(), 0.0}, {1.0, 0.0}};
      case 1:
        return {{lot.high.x(), lot.low.y(), 0.0}, {0.0, 1.0}};
      case 2:
        return {{lot.high.x(), lot.high.y(), 0.0}, {-1.0, 0.0}};
      default:
        return {{lot.low.x(), lot.high.y(), 0.0}, {0.0, -1.0}};
    }
  }
  static double length_of(const Lot& lot, std::size_t side) { return side % 2 == 0 ? lot.size().x() : lot.size().y(); }
  static int bays_of(double length, const Facade& facade) {
    return std::max(1, static_cast<int>(std::floor(length / facade.bay_m + 0.5)));
  }
  template <class T>
  const T& one_of(const std::vector<T>& several) {
    return several[static_cast<std::size_t>(draws_.below(static_cast<int>(several.size())))];
  }

  // Adds a wall that shows a whole number of bays and floors, or a wall without windows.
  void add_wall(const Lot& lot, std::size_t side, double low, double high, const Facade& facade, int floors, bool has_windows) {
    const Frame frame = side_of(lot, side);
    const double length = length_of(lot, side);
    const Vec3d a = frame(0.0, 0.0, low), b = frame(length, 0.0, low), c = frame(length, 0.0, high), d = frame(0.0, 0.0, high);
    if (!has_windows) return add_quad(thing_.of(facade.plain), a, b, c, d, 4.0 * facade.bay_m);
    const int column = draws_.below(4), row = draws_.below(facade.floors);
    const double left = column / 4.0, right = (column + bays_of(length, facade)) / 4.0;
    const double bottom = static_cast<double>(row + floors) / facade.floors, top = static_cast<double>(row) / facade.floors;
    add_panel(thing_.of(facade.windows), a, b, c, d, {left, bottom}, {right, top});
  }

  // Adds all four walls. Party walls get no windows if has_blind_walls is set. Returns the height of the top.
  double add_floors(const Lot& lot, double low, const Facade& facade, int floors, bool has_blind_walls) {
    const double high = low + floors * facade.floor_m;
    for (std::size_t side = 0; side < 4; ++side) {
      add_wall(lot, side, low, high, facade, floors, !has_blind_walls || lot.sides[side] != Side::party);
    }
    return high;
  }

  // Adds a slab from low to high that protrudes from the walls by `out`.
  void add_course(const Lot& lot, double low, double high, double out, std::uint16_t material) {
    const Vec2d center = 0.5 * (lot.low + lot.high), size = lot.size() + Vec2d::Constant(2.0 * out);
    add_block(thing_.of(material), {center.x(), center.y(), 0.5 * (low + high)}, {size.x(), size.y(), high - low}, Vec2d::UnitX(),
              2.0);
  }

  void add_deck(const Lot& lot, double z, std::uint16_t material) {
    add_quad(thing_.of(material), {lot.low.x(), lot.low.y(), z}, {lot.high.x(), lot.low.y(), z}, {lot.high.x(), lot.high.y(), z},
             {lot.low.x(), lot.high.y(), z}, 8.0);
  }

  void add_parapet(const Lot& lot, double z, std::uint16_t wall) {
    const double length = lot.size().x(), width = lot.size().y() - 2.0 * kParapetWidth;
    const Vec2d center = 0.5 * (lot.low + lot.high);
    const double half = 0.5 * kParapetWidth, mid = z + 0.5 * kParapet;
    MeshPart& part = thing_.of(wall);
    for (const double y : {lot.low.y() + half, lot.high.y() - half}) {
      add_block(part, {center.x(), y, mid}, {length, kParapetWidth, kParapet}, Vec2d::UnitX(), 8.0);
    }
    for (const double x : {lot.low.x() + half, lot.high.x() - half}) {
      add_block(part, {x, center.y(), mid}, {kParapetWidth, width, kParapet}, Vec2d::UnitX(), 8.0);
    }
    add_deck(lot, z + 0.03, roof_);  // above the undersides of rooftop objects, to avoid coincident faces
  }

  // Adds the ground floor: shops or a hall on street sides, the upper floors' wall on the other sides.
  double add_ground_floor(const Facade& front, const Facade& above) {
    const double low = kPavementHeight - 0.05, high = kPavementHeight + front.floor_m;
    bool has_entrance = false;
    for (std::size_t side = 0; side < 4; ++side) {
      const bool is_street = lot_.sides[side] == Side::street;
      if (!is_street) {
        add_wall(lot_, side, low, high, above, 1, false);
        continue;
      }
      add_wall(lot_, side, low, high, front, 1, true);
      if (front.windows == surfaces_.shops.windows) {
        add_awnings(side);
      } else if (!has_entrance) {
        add_entrance(side);
        has_entrance = true;
      }
    }
    return high;
  }

  void add_awnings(std::size_t side) {
    const Frame frame = side_of(lot_, side);
    const double length = length_of(lot_, side);
    const int bays = bays_of(length, surfaces_.shops);
    const double pitch = length / bays;
    const std::uint16_t cloth = one_of(surfaces_.awnings);
    for (int i = 0; i < bays; ++i) {
      const double left = i * pitch + 0.25, right = (i + 1) * pitch - 0.25;
      if (draws_.uniform(0.0, 1.0) < 0.25) {  // a projecting sign
        add_block(thing_.of(surfaces_.iron), frame, {left, -0.5, 4.05}, {0.05, 1.0, 0.05});
        add_block(thing_.of(surfaces_.sign), frame, {left, -0.55, 3.65}, {0.1, 0.8, 0.7});
      }
      if (draws_.uniform(0.0, 1.0) < 0.45) continue;
      const double out = draws_.uniform(1.0, 1.5), top = 3.3, low = 2.75, hem = 2.5;
      MeshPart& part = thing_.of(cloth);
      const std::array<double, 2> first{0.0, 1.0}, third{0.5 * std::floor(right - left), 0.0};
      const Vec3d a = frame(left, -out, low), b = frame(right, -out, low);
      add_panel(part, a, b, frame(right, 0.0, top), frame(left, 0.0, top), first, third);
      add_panel(part, frame(left, -out, hem), frame(right, -out, hem), b, a, first, third);
      for (const double x : {left, right}) {  // its side walls
        const std::int32_t corner = add_vertex(part, frame(x, -out, low), 0.25, 0.5);
        add_vertex(part, frame(x, 0.0, low), 0.25, 0.5);
        add_vertex(part, frame(x, 0.0, top), 0.25, 0.5);
        x == left ? add_triangle(part, corner + 1, corner, corner + 2) : add_triangle(part, corner, corner + 1, corner + 2);
      }
    }
  }

  void add_entrance(std::size_t side) {
    const Frame frame = side_of(lot_, side);
    const double x = 0.5 * length_of(lot_, side), z = kPavementHeight;
    MeshPart& trim = thing_.of(surfaces_.trim);
    add_block(trim, frame, {x, -0.12, z + 1.6}, {2.3, 0.24, 3.3}, 2.0);
    add_panel(thing_.of(surfaces_.door), frame(x - 0.8, -0.26, z + 0.3), frame(x + 0.8, -0.26, z + 0.3),
              frame(x + 0.8, -0.26, z + 2.8), frame(x - 0.8, -0.26, z + 2.8), {0.0, 1.0}, {1.0, 0.0});
    add_block(trim, frame, {x, -0.5, z + 0.08}, {2.3, 1.0, 0.16}, 2.0);
    add_block(trim, frame, {x, -0.38, z + 0.22}, {2.3, 0.6, 0.14}, 2.0);
    add_block(thing_.of(surfaces_.iron), frame, {x, -0.7, z + 3.15}, {2.8, 1.4, 0.14});
  }

  // Adds pillars in front of the wall, between the bays.
  void add_pillars(const Lot& lot, double low, double high, const Facade& facade, double width, double out,
                   std::uint16_t material) {
    for (std::size_t side = 0; side < 4; ++side) {
      if (lot.sides[side] == Side::party) continue;
      const Frame frame = side_of(lot, side);
      const double length = length_of(lot, side);
      const int bays = bays_of(length, facade);
      for (int i = 0; i <= bays; ++i) {
        const double x = std::clamp(length * i / bays, 0.5 * width, length - 0.5 * width);
        add_block(thing_.of(material), frame, {x, 0.0, 0.5 * (low + high)}, {width, 2.0 * out, high - low}, 2.0);
      }
    }
  }

  void add_balconies(double low, const Facade& facade, int floors, std::uint16_t rail) {
    for (std::size_t side = 0; side < 4; ++side) {
      if (lot_.sides[side] != Side::street) continue;
      const Frame frame = side_of(lot_, side);
      const double length = length_of(lot_, side);
      const int bays = bays_of(length, facade);
      const double pitch = length / bays;
      for (int i = 1; i + 1 < bays; i += 2) {
        for (int floor = 0; floor < floors; ++floor) {
          const double x = (i + 0.5) * pitch, z = low + floor * facade.floor_m;
          add_block(thing_.of(surfaces_.trim), frame, {x, -0.6, z + 0.06}, {0.92 * pitch, 1.2, 0.16}, 2.0);
          add_block(thing_.of(rail), frame, {x, -1.17, z + 0.6}, {0.92 * pitch, 0.06, 0.92}, 4.0);
        }
      }
    }
  }

  void add_fire_escape(double low, const Facade& facade, int floors) {
    std::size_t side = 0;
    while (side < 4 && (lot_.sides[side] != Side::street || length_of(lot_, side) < 9.0)) ++side;
    if (side == 4) return;
    const Frame frame = side_of(lot_, side);
    const double x = draws_.uniform(3.0, length_of(lot_, side) - 3.0), half = 2.0;
    MeshPart& iron = thing_.of(surfaces_.iron);
    for (int floor = 0; floor < floors; ++floor) {
      const double z = low + floor * facade.floor_m + 0.35;
      add_block(iron, frame, {x, -0.6, z}, {2.0 * half, 1.2, 0.07});
      for (const double up : {0.5, 1.0}) {
        add_block(iron, frame, {x, -1.18, z + up}, {2.0 * half, 0.05, 0.05});
        for (const double end : {-half, half}) add_block(iron, frame, {x + end, -0.6, z + up}, {0.05, 1.2, 0.05});
      }
      for (const double end : {-half, 0.0, half}) add_block(iron, frame, {x + end, -1.18, z + 0.5}, {0.05, 0.05, 1.0});
      if (floor + 1 == floors) break;
      const double turn = floor % 2 == 0 ? 1.0 : -1.0, next = z + facade.floor_m;
      for (const double y : {-0.95, -0.45}) {  // stringers, with the steps between them
        add_quad(iron, frame(x - turn * 1.5, y, z), frame(x + turn * 1.5, y, next), frame(x + turn * 1.5, y, next + 0.2),
                 frame(x - turn * 1.5, y, z + 0.2));
      }
      add_quad(iron, frame(x - turn * 1.5, -0.95, z + 0.1), frame(x + turn * 1.5, -0.95, next + 0.1),
               frame(x + turn * 1.5, -0.45, next + 0.1), frame(x - turn * 1.5, -0.45, z + 0.1));
    }
  }

  // Adds air conditioners below windows.
  void add_coolers(double low, const Facade& facade, int floors, double share) {
    for (std::size_t side = 0; side < 4; ++side) {
      if (lot_.sides[side] == Side::party) continue;
      const Frame frame = side_of(lot_, side);
      const double length = length_of(lot_, side);
      const int bays = bays_of(length, facade);
      for (int i = 0; i < bays * floors; ++i) {
        if (draws_.uniform(0.0, 1.0) > share) continue;
        const double x = (i % bays + 0.5) * length / bays, z = low + (i / bays) * facade.floor_m + 1.18;
        add_block(thing_.of(surfaces_.machine), frame, {x, -0.15, z}, {0.66, 0.5, 0.42}, 0.66);
      }
    }
  }

  void add_tank(const Vec2d& at, double z) {
    const double legs = draws_.uniform(1.8, 2.8), radius = draws_.uniform(1.2, 1.6), tall = 2.0 * radius;
    for (const double x : {-0.6, 0.6}) {
      for (const double y : {-0.6, 0.6}) {
        builder_.cylinder(Vec3d(at.x() + x * radius, at.y() + y * radius, z + 0.5 * legs).cast<float>(), 0.09F,
                          static_cast<float>(legs), surfaces_.iron);
      }
    }
    add_block(thing_.of(surfaces_.iron), {at.x(), at.y(), z + legs}, {2.0 * radius, 2.0 * radius, 0.12});
    const std::array<std::array<double, 2>, 4> barrel{{{0.0, 0.06}, {radius, 0.06}, {radius, tall}, {0.0, tall + 0.02}}};
    add_turned(thing_.of(surfaces_.tank), {at.x(), at.y(), z + legs}, barrel, 12);
    const std::array<std::array<double, 2>, 2> hat{{{1.1 * radius, tall - 0.02}, {0.0, tall + 0.7 * radius}}};
    add_turned(thing_.of(surfaces_.iron), {at.x(), at.y(), z + legs}, hat, 12);
  }

  void add_mast(const Vec2d& at, double z, double tall) {
    builder_.cylinder(Vec3d(at.x(), at.y(), z + 0.5 * tall).cast<float>(), 0.06F, static_cast<float>(tall), surfaces_.pole);
    for (const double share : {0.6, 0.75, 0.9}) {
      add_block(thing_.of(surfaces_.pole), {at.x(), at.y(), z + share * tall}, {0.04, 2.4 * (1.2 - share), 0.04});
    }
  }

  // Furnishes a flat roof on a square grid, with at most one object per cell.
  void furnish_roof(const Lot& roof, double z, const Facade& facade, bool may_have_tank) {
    const Vec2d room = roof.size() - Vec2d::Constant(2.0 * kParapetWidth + 0.6);
    const int columns = static_cast<int>(room.x() / 4.2), rows = static_cast<int>(room.y() / 4.2);
    if (columns < 1 || rows < 1) return;
    const int stairs = draws_.below(columns * rows), tank = draws_.below(columns * rows), mast = draws_.below(columns * rows);
    const bool has_tank = may_have_tank && draws_.uniform(0.0, 1.0) < 0.55;
    for (int i = 0; i < columns * rows; ++i) {
      const Vec2d corner = roof.low + Vec2d::Constant(kParapetWidth + 0.3);
      const Vec2d at = corner + Vec2d((i % columns + 0.5) * room.x() / columns, (i / columns + 0.5) * room.y() / rows);
      const double luck = draws_.uniform(0.0, 1.0);
      if (i == stairs) {
        add_block(thing_.of(facade.plain), {at.x(), at.y(), z + 1.3}, {3.0, 2.6, 2.6}, Vec2d::UnitX(), 8.0);
        add_block(thing_.of(roof_), {at.x(), at.y(), z + 2.66}, {3.3, 2.9, 0.12}, Vec2d::UnitX(), 4.0);
      } else if (i == tank && has_tank) {
        add_tank(at, z);
      } else if (i == mast && luck < 0.6) {
        add_mast(at, z, draws_.uniform(3.0, 6.0));
      } else if (luck < 0.35) {
        const Vec2d size = draws_.point({1.2, 0.9}, {2.6, 1.8});
        const double tall = draws_.uniform(0.8, 1.5);
        add_block(thing_.of(surfaces_.machine), {at.x(), at.y(), z + 0.5 * tall + 0.15}, {size.x(), size.y(), tall},
                  Vec2d::UnitX(), 0.9);
        add_block(thing_.of(surfaces_.iron), {at.x(), at.y(), z + 0.08}, {size.x() - 0.3, size.y() - 0.3, 0.16});
      } else if (luck < 0.5) {
        const double tall = draws_.uniform(0.7, 1.3);
        builder_.cylinder(Vec3d(at.x(), at.y(), z + 0.5 * tall).cast<float>(), 0.2F, static_cast<float>(tall), surfaces_.bin);
      } else if (luck < 0.62) {  // skylight
        add_block(thing_.of(surfaces_.trim), {at.x(), at.y(), z + 0.2}, {2.0, 1.4, 0.4});
        add_block(thing_.of(surfaces_.panes), {at.x(), at.y(), z + 0.42}, {1.8, 1.2, 0.1});
      }
    }
  }

  // Adds a roof with four slopes, or with two slopes and two gables.
  void add_pitched_roof(const Lot& lot, double z, const Facade& facade) {
    constexpr double kEaves = 0.35;
    const bool is_along_x = lot.size().x() > lot.size().y();
    const Vec2d center = 0.5 * (lot.low + lot.high);
    const Frame frame{{center.x(), center.y(), z}, is_along_x ? Vec2d(1.0, 0.0) : Vec2d(0.0, 1.0)};
    const double half = 0.5 * lot.size().maxCoeff(), wide = 0.5 * lot.size().minCoeff();
    const double slope = draws_.uniform(0.65, 0.9), rise = slope * wide, drop = slope * kEaves;
    const bool is_hipped = draws_.uniform(0.0, 1.0) < 0.5;
    const double ridge = is_hipped ? std::max(half - wide, 0.3) : half + 0.1, end = half + (is_hipped ? kEaves : 0.1);
    const double out = wide + kEaves;
    MeshPart& tiles = thing_.of(surfaces_.tiles);
    const Vec3d left = frame(-ridge, 0.0, rise), right = frame(ridge, 0.0, rise);
    add_quad(tiles, frame(-end, -out, -drop), frame(end, -out, -drop), right, left, 4.0);
    add_quad(tiles, frame(end, out, -drop), frame(-end, out, -drop), left, right, 4.0);
    for (const double way : {-1.0, 1.0}) {
      MeshPart& part = is_hipped ? tiles : thing_.of(facade.plain);
      const double x = way * (is_hipped ? end : half), y = is_hipped ? out : wide, low = is_hipped ? -drop : 0.0;
      const double top = is_hipped ? ridge : half;
      const std::int32_t corner = add_vertex(part, frame(x, -way * y, low), 0.0, 0.0);
      add_vertex(part, frame(x, way * y, low), 0.5 * y, 0.0);
      add_vertex(part, frame(way * top, 0.0, rise), 0.25 * y,
                 is_hipped ? -0.25 * std::sqrt(out * out + rise * rise) : -0.1 * rise);
      add_triangle(part, corner, corner + 1, corner + 2);
    }
    for (int i = draws_.below(3); i >= 0; --i) {
      const double x = draws_.uniform(-0.6, 0.6) * half, y = draws_.uniform(-0.4, 0.4) * wide;
      const double foot = rise - slope * std::abs(y) - 0.4;
      add_block(thing_.of(surfaces_.brick[0].plain), frame, {x, y, foot + 0.8}, {0.9, 0.6, 1.6}, 8.0);
      add_block(thing_.of(surfaces_.trim), frame, {x, y, foot + 1.65}, {1.05, 0.75, 0.12});
    }
  }

  static Lot inset(const Lot& lot, double by) {
    return {lot.low + Vec2d::Constant(by), lot.high - Vec2d::Constant(by), lot.sides};
  }
  static int floors_in(double height, const Facade& facade, int least) {
    return std::max(least, static_cast<int>(height / facade.floor_m));
  }

  // A plastered house with a tiled roof.
  double townhouse(double wanted) {
    const Facade& facade = one_of(surfaces_.plaster);
    const bool has_shops = draws_.uniform(0.0, 1.0) < 0.5;
    const double first = add_ground_floor(has_shops ? surfaces_.shops : surfaces_.hall, facade);
    add_course(lot_, first - 0.12, first + 0.1, 0.12, surfaces_.trim);
    const bool is_pitched = lot_.size().minCoeff() < 15.0;
    const double roof = is_pitched ? 0.4 * lot_.size().minCoeff() : kParapet;
    const int floors = floors_in(wanted - first - roof, facade, 1);
    const double top = add_floors(lot_, first, facade, floors, true);
    add_course(lot_, top - 0.3, top - 0.02, 0.2, surfaces_.trim);
    if (is_pitched) {
      add_pitched_roof(lot_, top, facade);
    } else {
      add_parapet(lot_, top, facade.plain);
      furnish_roof(lot_, top, facade, false);
    }
    return top;
  }

  // A brick house with a cornice, a fire escape and a tank on the roof.
  double walkup(double wanted) {
    const Facade& facade = one_of(surfaces_.brick);
    const bool has_shops = draws_.uniform(0.0, 1.0) < 0.65;
    const double first = add_ground_floor(has_shops ? surfaces_.shops : surfaces_.hall, facade);
    add_course(lot_, first - 0.1, first + 0.18, 0.16, surfaces_.trim);
    const int floors = floors_in(wanted - first - kParapet, facade, 2);
    const double top = add_floors(lot_, first, facade, floors, true);
    add_course(lot_, top - 0.62, top - 0.4, 0.16, surfaces_.trim);
    add_course(lot_, top - 0.4, top - 0.05, 0.45, surfaces_.trim);
    add_parapet(lot_, top, facade.plain);
    furnish_roof(lot_, top, facade, true);
    add_coolers(first, facade, floors, 0.1);
    if (draws_.uniform(0.0, 1.0) < 0.6) add_fire_escape(first, facade, floors);
    return top;
  }

  // A concrete house with balconies.
  double slab(double wanted) {
    const Facade& facade = one_of(surfaces_.concrete);
    const double first = add_ground_floor(draws_.uniform(0.0, 1.0) < 0.5 ? surfaces_.shops : surfaces_.hall, facade);
    add_course(lot_, first - 0.1, first + 0.1, 0.3, facade.plain);
    const int floors = floors_in(wanted - first - kParapet, facade, 2);
    const double top = add_floors(lot_, first, facade, floors, false);
    if (draws_.uniform(0.0, 1.0) < 0.7) add_balconies(first, facade, floors, facade.plain);
    add_parapet(lot_, top, facade.plain);
    furnish_roof(lot_, top, facade, false);
    return top;
  }

  // A glass tower, sometimes on a wider base.
  double office(double wanted) {
    const Facade& facade = one_of(surfaces_.glass);
    const double first = add_ground_floor(surfaces_.hall, facade);
    add_course(lot_, first - 0.15, first + 0.15, 0.25, facade.plain);
    int floors = floors_in(wanted - first - kParapet, facade, 3);
    Lot lot = lot_;
    double low = first;
    if (draws_.uniform(0.0, 1.0) < 0.5 && lot.size().minCoeff() > 13.0) {
      const int foot = 1 + draws_.below(2);
      low = add_floors(lot, low, facade, foot, false);
      add_parapet(lot, low, facade.plain);
      lot = inset(lot, draws_.uniform(1.6, 2.6));
      lot.sides.fill(Side::street);
      floors -= foot;
    }
    const double top = add_floors(lot, low, facade, floors, false);
    add_pillars(lot, low, top, facade, 0.09, 0.14, facade.plain);
    add_parapet(lot, top, facade.plain);
    if (lot.size().minCoeff() > 9.0) {
      const Lot house = inset(lot, 2.8);
      const Vec2d center = 0.5 * (house.low + house.high), size = house.size();
      add_block(thing_.of(surfaces_.machine), {center.x(), center.y(), top + 1.4}, {size.x(), size.y(), 2.8}, Vec2d::UnitX(),
                1.4);
      add_deck(house, top + 2.82, roof_);
      add_mast(center, top + 2.8, draws_.uniform(4.0, 8.0));
    } else {
      furnish_roof(lot, top, facade, false);
    }
    return top;
  }

  // A stepped stone tower.
  double deco(double wanted) {
    const Facade& facade = one_of(surfaces_.stone);
    double low = add_ground_floor(draws_.uniform(0.0, 1.0) < 0.4 ? surfaces_.shops : surfaces_.hall, facade);
    add_course(lot_, low - 0.2, low + 0.15, 0.3, surfaces_.trim);
    int floors = floors_in(wanted - low - kParapet, facade, 2);
    Lot lot = lot_;
    for (;;) {
      const bool is_last = floors < 4 || lot.size().minCoeff() < 10.0;
      const int here = is_last ? floors : (floors + 1) / 2 + draws_.below(floors / 4 + 1);
      const double high = add_floors(lot, low, facade, here, false);
      add_pillars(lot, low, high + 0.5 * kParapet, facade, 0.6, 0.22, facade.plain);
      add_course(lot, high - 0.45, high - 0.05, 0.14, surfaces_.trim);
      add_parapet(lot, high, facade.plain);
      low = high;
      floors -= here;
      if (is_last || floors < 1) break;
      lot = inset(lot, draws_.uniform(1.4, 2.4));
      lot.sides.fill(Side::street);
    }
    furnish_roof(lot, low, facade, true);
    return low;
  }

  WorldBuilder& builder_;
  const CitySurfaces& surfaces_;
  const Lot& lot_;
  Draws& draws_;
  std::uint16_t roof_;  // material of flat roofs
  Thing thing_;
};

}  // namespace

double add_house(WorldBuilder& builder, const CitySurfaces& surfaces, const Lot& lot, double max_height_m, double boldness,
                 Draws& draws) {
  return House(builder, surfaces, lot, draws).built(max_height_m, boldness);
}

}  // namespace flockstep::streets
