#include "generators/floor_plan.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <optional>
#include <utility>

namespace flockstep::indoors {
namespace {

class FloorPlanner {
  static constexpr double kGrid = 0.5;
  static constexpr double kCorridor = 2.5, kLounge = 7.0;      // m, widths including walls
  static constexpr double kMinRoom = 3.5;                      // m, minimum side of a room
  static constexpr double kDoor = 1.5, kDoorHigh = 2.2;        // m, including the frame
  static constexpr double kPassage = 2.1, kPassageHigh = 2.5;  // m, opening between corridor and lounge
  static constexpr double kFromCorner = 0.5;                   // m, distance of openings from corners

  static double on_grid(double metres) { return kGrid * std::floor(metres / kGrid + 0.5); }

 public:
  FloorPlanner(const Vec2d& size, Draws& draws) : draws_(draws) { plan_.size = size; }

  FloorPlan drawn() {
    lay_out();
    add_doors();
    add_windows();
    return std::move(plan_);
  }

 private:
  void add_room(const Rect& cell, RoomUse use) { plan_.rooms.push_back({cell, use, {}}); }

  // Wings and lounges alternate along x. Each wing is sliced from front to back; a slice has a corridor with rooms on both
  // sides.
  void lay_out() {
    const Vec2d size = plan_.size;
    const int lounges = std::max(1, static_cast<int>(std::ceil((size.x() - 20.0) / 24.0)));
    const double wing = (size.x() - lounges * kLounge) / (lounges + 1);
    const int slices = std::max(1, static_cast<int>(size.y() / 17.0 + 0.5));
    double x = 0.0;
    for (int i = 0; i <= lounges; ++i) {
      const double end = i == lounges ? size.x() : on_grid((i + 1) * wing + i * kLounge);
      for (int slice = 0; slice < slices; ++slice) {
        const double low = on_grid(size.y() * slice / slices), high = on_grid(size.y() * (slice + 1) / slices);
        const double share = draws_.uniform(0.38, 0.62);
        const double corridor = on_grid(low + share * (high - low - kCorridor));
        split({{x, low}, {end, corridor}}, Side::north);
        add_room({{x, corridor}, {end, corridor + kCorridor}}, RoomUse::corridor);
        split({{x, corridor + kCorridor}, {end, high}}, Side::south);
      }
      if (i == lounges) break;
      x = end + kLounge;
      add_room({{end, 0.0}, {x, size.y()}}, RoomUse::lounge);
    }
  }

  // Splits a cell into rooms of a practical size. `corridor` is the side with the corridor.
  void split(const Rect& cell, Side corridor) {
    const Vec2d size = cell.size();
    const double most = draws_.uniform(4.5, 9.5);
    if (size.x() > most && size.x() >= 2.0 * kMinRoom) {
      const double at = on_grid(draws_.uniform(cell.low.x() + kMinRoom, cell.high.x() - kMinRoom));
      split({cell.low, {at, cell.high.y()}}, corridor);
      split({{at, cell.low.y()}, cell.high}, corridor);
      return;
    }
    if (size.y() >= 9.0 && draws_.below(3) > 0) {  // a room at the back, reached through the front one
      const double at = on_grid(draws_.uniform(cell.low.y() + 4.0, cell.high.y() - 4.0));
      add_room({cell.low, {cell.high.x(), at}}, any_use(size.x() * (at - cell.low.y())));
      add_room({{cell.low.x(), at}, cell.high}, any_use(size.x() * (cell.high.y() - at)));
      return;
    }
    add_room(cell, any_use(cell.area()));
  }

  RoomUse any_use(double area) {
    const double chance = draws_.uniform(0.0, 1.0);
    if (area > 38.0) return chance < 0.75 ? RoomUse::open_plan : RoomUse::meeting;
    if (area > 20.0) return chance < 0.4 ? RoomUse::meeting : chance < 0.75 ? RoomUse::open_plan : RoomUse::single;
    return chance < 0.75 ? RoomUse::single : RoomUse::storage;
  }

  // Returns the shared wall of two cells and its two ends, if it has room for an opening.
  struct Shared {
    bool is_across_x;
    double wall, from, to;
  };
  std::optional<Shared> shared(const Rect& a, const Rect& b) const {
    const double least = kDoor + 2.0 * kFromCorner;
    for (const int axis : {0, 1}) {
      const double wall = a.high[axis] == b.low[axis] ? a.high[axis] : a.low[axis];
      if (a.high[axis] != b.low[axis] && a.low[axis] != b.high[axis]) continue;
      const double from = std::max(a.low[1 - axis], b.low[1 - axis]), to = std::min(a.high[1 - axis], b.high[1 - axis]);
      if (to - from >= least - 1e-9) return Shared{axis == 0, wall, from, to};
    }
    return std::nullopt;
  }

  bool join(std::size_t a, std::size_t b) {
    const std::optional<Shared> wall = shared(plan_.rooms[a].cell, plan_.rooms[b].cell);
    if (!wall) return false;
    const bool is_passage = is_hall(a) && is_hall(b);
    const double width = is_passage ? kPassage : kDoor, high = is_passage ? kPassageHigh : kDoorHigh;
    const double margin = is_passage ? 0.5 * (wall->to - wall->from) : kFromCorner + 0.5 * width;
    const double at = draws_.uniform(wall->from + margin, wall->to - margin);
    const Vec2d middle = wall->is_across_x ? Vec2d(wall->wall, at) : Vec2d(at, wall->wall);
    plan_.doors.push_back({a, b, wall->is_across_x, middle, width, high, false});
    for (const std::size_t room : {a, b}) {
      const bool is_low = plan_.rooms[room].cell.low[wall->is_across_x ? 0 : 1] == wall->wall;
      const Side side = wall->is_across_x ? (is_low ? Side::west : Side::east) : (is_low ? Side::south : Side::north);
      plan_.rooms[room].openings.push_back({side, at - 0.5 * width, at + 0.5 * width, 0.0, high, false});
    }
    return true;
  }

  bool is_hall(std::size_t room) const {
    return plan_.rooms[room].use == RoomUse::corridor || plan_.rooms[room].use == RoomUse::lounge;
  }

  // Joins the halls first. Each other room then gets a door to a corridor, else to a room that has a door, else to a lounge.
  // Some extra doors join rooms.
  void add_doors() {
    const std::size_t count = plan_.rooms.size();
    std::vector<bool> is_reached(count, false);
    for (std::size_t a = 0; a < count; ++a) {
      is_reached[a] = is_hall(a);
      for (std::size_t b = 0; b < a; ++b) {
        if (is_hall(a) && is_hall(b)) join(b, a);
      }
    }
    const auto reach_by = [&](auto&& is_wanted) {
      bool is_any = false;
      for (std::size_t a = 0; a < count; ++a) {
        if (is_reached[a]) continue;
        for (std::size_t b = 0; b < count && !is_reached[a]; ++b) {
          if (is_reached[b] && is_wanted(plan_.rooms[b].use)) is_reached[a] = join(b, a);
        }
        is_any = is_any || is_reached[a];
      }
      return is_any;
    };
    reach_by([](RoomUse use) { return use == RoomUse::corridor; });
    while (reach_by([](RoomUse use) { return use != RoomUse::corridor && use != RoomUse::lounge; })) {
    }
    reach_by([](RoomUse) { return true; });
    for (std::size_t a = 0; a < count; ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        const bool are_joined = std::any_of(plan_.doors.begin(), plan_.doors.end(), [&](const Door& door) {
          return (door.from == a && door.to == b) || (door.from == b && door.to == a);
        });
        if (!is_hall(a) && !is_hall(b) && !are_joined && draws_.below(4) == 0) join(b, a);
      }
    }
  }

  // Adds ribbon windows on outer walls.
  void add_windows() {
    const Vec2d size = plan_.size;
    const double pier = draws_.uniform(0.3, 0.9), wish = draws_.uniform(1.6, 2.6),
                 sill = 0.05 * std::floor(draws_.uniform(14.0, 19.0));
    for (Room& room : plan_.rooms) {
      const std::array<bool, 4> is_outer{room.cell.low.y() == 0.0, room.cell.high.x() == size.x(), room.cell.high.y() == size.y(),
                                         room.cell.low.x() == 0.0};
      for (const Side side : kSides) {
        if (!is_outer[static_cast<std::size_t>(side)]) continue;
        const int axis = is_along_x(side) ? 0 : 1;
        const double from = room.cell.low[axis] + kFromCorner, to = room.cell.high[axis] - kFromCorner;
        const int count = std::max(1, static_cast<int>((to - from + pier) / (wish + pier)));
        const double width = (to - from + pier) / count - pier;
        for (int i = 0; i < count; ++i) {
          const double left = from + i * (width + pier);
          room.openings.push_back({side, left, left + width, sill, 2.5, true});
        }
      }
    }
  }

  Draws& draws_;
  FloorPlan plan_;
};

}  // namespace

Rect Room::inside() const { return cell.grown(-FloorPlan::kHalfWall); }

std::vector<std::size_t> FloorPlan::doors_between(std::size_t from, std::size_t to) const {
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> by(rooms.size(), kNone);
  std::deque<std::size_t> next{from};
  while (!next.empty() && by[to] == kNone) {
    const std::size_t room = next.front();
    next.pop_front();
    for (std::size_t i = 0; i < doors.size(); ++i) {
      if (doors[i].from != room && doors[i].to != room) continue;
      const std::size_t other = doors[i].from == room ? doors[i].to : doors[i].from;
      if (other == from || by[other] != kNone) continue;
      by[other] = i;
      next.push_back(other);
    }
  }
  std::vector<std::size_t> way;
  for (std::size_t room = to; room != from;) {
    way.insert(way.begin(), by[room]);
    room = doors[by[room]].from == room ? doors[by[room]].to : doors[by[room]].from;
  }
  return way;
}

FloorPlan floor_plan(const Vec2d& size, Draws& draws) { return FloorPlanner(size, draws).drawn(); }

}  // namespace flockstep::indoors
