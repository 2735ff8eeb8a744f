// Generates warehouses: a hall with racks of pallets, and a flight lane around the racks and through empty bays.
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

class Warehouse {
  // Lengths in m.
  static constexpr double kFront = 9.0, kBack = 8.0;    // along x, areas for unloading and packing
  static constexpr double kAisle = 3.0;                 // minimum width between racks
  static constexpr double kEnd = 2.6;                   // between the ends of racks and the walls
  static constexpr double kCross = 2.8;                 // width of an aisle across the racks
  static constexpr double kRack = 1.1, kBetween = 0.2;  // depth of a rack, gap between two back to back
  static constexpr double kBay = 2.8, kLevel = 1.9;     // distance of uprights, distance of beams
  static constexpr double kFrame = 6.0;                 // approximate spacing of the hall's frames
  static constexpr double kRoof = 0.12;                 // height of the roof above its frames
  static constexpr double kFlightHeight = 1.5;          // height of start and goal
  static constexpr double kLaneHalfWidth = 0.8, kMarkerClearance = 1.2, kSpawnReach = 0.25;
  static constexpr double kRepeat = 4.0;  // width of the floor texture

  struct Row {
    double x = 0.0;  // middle of the back-to-back racks
    struct Block {
      double from = 0.0;  // y
      int bays = 0;
    };
    std::vector<Block> blocks;
    // An empty bay through both racks that a drone can pass.
    struct Gap {
      std::size_t block = 0;
      int bay = 0, level = 0;
    };
    std::vector<Gap> gaps;
  };

 public:
  Warehouse(const WarehouseConfig& config, std::uint32_t attempt)
      : config_(config),
        draws_(Draws::kWarehouse, config.seed, attempt),
        size_(static_cast<double>(config.size_m[0]), static_cast<double>(config.size_m[1])),
        high_(static_cast<double>(config.height_m)),
        ridge_(high_ + 0.06 * size_.y()),
        levels_(std::clamp(static_cast<int>((high_ - 0.7) / kLevel), 2, 5)),
        builder_("warehouse/seed-" + std::to_string(config.seed)),
        furniture_(builder_, Draws::kWarehouse, config.seed, draws_) {
    lay_out();
    lay_lane();
  }

  std::vector<Vec3> lane() const { return rounded(lane_); }

  WorldBuilder built() {
    make_materials();
    add_hall();
    add_doors();
    for (const Row& row : rows_) {
      Interrupt::poll();
      add_row(row);
    }
    add_markings();
    std::vector<Vec2d> flat;
    for (const Vec3d& point : lane_) flat.emplace_back(point.head<2>());
    places_.keep_off(flat, kLaneHalfWidth, kMarkerClearance);
    furnish();
    Light light;  // even light from lamps, and the sun through the skylights
    light.sun_direction = {-0.22F, -0.36F, 0.91F};
    light.sun_color = {1.1F, 1.0F, 0.84F};
    light.sky_ambient = {0.86F, 0.87F, 0.88F};
    light.ground_ambient = {0.62F, 0.62F, 0.62F};
    light.zenith_color = {0.30F, 0.52F, 0.85F};
    light.horizon_color = {0.86F, 0.92F, 0.98F};
    builder_.light(light);
    mark_lane(builder_, lane(), kSpawnReach, config_.waypoints);
    return builder_;
  }

 private:
  static double depth() { return 2.0 * kRack + kBetween; }

  void lay_out() {
    const double room = size_.x() - kFront - kBack;
    const int count = std::max(1, static_cast<int>((room + kAisle) / (depth() + kAisle)));
    const double pitch = (room + kAisle) / count;
    const bool is_crossed = size_.y() >= 24.0;
    const double cross = is_crossed ? draws_.uniform(0.4, 0.6) * size_.y() : 0.0;
    for (int i = 0; i < count; ++i) {
      Row row{kFront + 0.5 * (pitch - kAisle) + i * pitch, {}, {}};
      const auto add_block = [&](double from, double to) {
        const int bays = std::max(1, static_cast<int>((to - from - 0.1) / kBay));
        row.blocks.push_back({0.5 * (from + to - bays * kBay), bays});
      };
      if (is_crossed) {
        add_block(kEnd, cross - 0.5 * kCross);
        add_block(cross + 0.5 * kCross, size_.y() - kEnd);
      } else {
        add_block(kEnd, size_.y() - kEnd);
      }
      rows_.push_back(row);
    }
  }

  double marker_y() { return draws_.uniform(0.2 * size_.y(), 0.8 * size_.y()); }

  // Lays the lane from row to row, around their ends or through a bay.
  void lay_lane() {
    Vec3d at(2.4, marker_y(), kFlightHeight);
    lane_.push_back(at);
    for (Row& row : rows_) {
      const Vec3d gate = draw_gate(row, at.y());
      const double aside = 0.5 * depth() + 0.5 * kAisle;
      lane_.emplace_back(row.x - aside, gate.y(), gate.z());
      lane_.emplace_back(row.x + aside, gate.y(), gate.z());
      at = gate;
    }
    lane_.emplace_back(size_.x() - 2.4, marker_y(), kFlightHeight);
  }

  Vec3d draw_gate(Row& row, double from) {
    const auto draw = [&]() -> Vec3d {
      const bool is_round = draws_.below(4) == 0;
      if (is_round && row.blocks.size() > 1 && draws_.below(2) == 0) {
        const double low = row.blocks[0].from + row.blocks[0].bays * kBay, high = row.blocks[1].from;
        return {row.x, 0.5 * (low + high), draws_.uniform(1.2, 3.0)};
      }
      if (is_round) {
        const Row::Block& last = row.blocks.back();
        const double low = 0.5 * row.blocks.front().from, high = 0.5 * (last.from + last.bays * kBay + size_.y());
        return {row.x, draws_.below(2) == 0 ? low : high, draws_.uniform(1.2, 2.5)};
      }
      const auto block = static_cast<std::size_t>(draws_.below(static_cast<int>(row.blocks.size())));
      const int bay = draws_.below(row.blocks[block].bays), level = draws_.below(2);
      row.gaps.assign(1, {block, bay, level});
      return {row.x, row.blocks[block].from + (bay + 0.5) * kBay, level * kLevel + 0.97};
    };
    Vec3d gate = draw();
    for (int i = 0; i < 20; ++i) {  // off to the side, but not across the whole hall
      const double aside = std::abs(gate.y() - from);
      if (aside > 2.5 && aside < 12.0) break;
      row.gaps.clear();
      gate = draw();
    }
    return gate;
  }

  // -------------------------------------------------------------------------------------------------------------- hall

  void make_materials() {
    const std::uint64_t seed = config_.seed;
    const Noise noise(Draws::kWarehouse, seed, 20);
    const auto concrete = [&](double x, double y) {  // x, y in m; repeats every kRepeat
      const double cloud = noise.octaves(x, y, 4, static_cast<int>(kRepeat));
      const double grain = noise.at(32.0 * x, 32.0 * y, static_cast<int>(32.0 * kRepeat));
      return mixed(Color{0.25F, 0.25F, 0.245F}, Color{0.42F, 0.415F, 0.40F},
                   std::clamp(1.6 * cloud - 0.35 + 0.15 * grain, 0.0, 1.0));
    };
    const std::uint16_t slab = builder_.texture("concrete", 512, 512, [&](float s, float t) {
      const double x = kRepeat * static_cast<double>(s), y = kRepeat * static_cast<double>(t);
      const bool is_joint = x < 0.016 || y < 0.016;
      return is_joint ? Color{0.14F, 0.14F, 0.14F} : concrete(x, y);
    });
    floor_ = builder_.material({"floor", {1.0F, 1.0F, 1.0F}, semantic(Kind::floor), slab});
    const std::uint16_t shade = builder_.texture("shade", 256, 32, [&](float s, float t) {
      const double light = static_cast<double>(t);
      return mixed(Color{0.0F, 0.0F, 0.0F}, concrete(kRepeat * static_cast<double>(s), 0.6 * light), 0.45 + 0.55 * light);
    });
    shade_ = builder_.material({"shaded floor", {1.0F, 1.0F, 1.0F}, semantic(Kind::floor), shade});
    const double ridge = ridge_ + kRoof;
    const std::uint16_t sheet = builder_.texture("wall", 128, 512, [&](float s, float t) {
      const double z = ridge * (1.0 - static_cast<double>(t)), x = static_cast<double>(s);
      const double dirt = noise.octaves(8.0 * x, 32.0 * static_cast<double>(t), 3, 8);
      if (z < 1.2) {  // concrete base
        const double low = std::clamp(1.0 - z / 0.9, 0.0, 1.0);
        return mixed(mixed(Color{0.27F, 0.27F, 0.26F}, Color{0.36F, 0.355F, 0.34F}, dirt), {0.0F, 0.0F, 0.0F}, 0.35 * low * low);
      }
      const double rib = std::fmod(8.0 * x, 1.0);  // four ribs per metre
      const double fold = rib < 0.12 ? 0.72 : rib < 0.24 ? 1.08 : 0.97;
      const auto light = static_cast<float>((0.93 + 0.07 * dirt) * fold);
      return Color{0.56F * light, 0.585F * light, 0.60F * light};
    });
    walls_ = {builder_.material({"wall", {1.0F, 1.0F, 1.0F}, semantic(Kind::wall), sheet}),
              builder_.material({"wall shaded", {0.86F, 0.86F, 0.87F}, semantic(Kind::wall), sheet})};
    const std::uint16_t roof = builder_.texture("roof", 128, 16, [&](float s, float) {
      const double rib = std::fmod(6.0 * static_cast<double>(s), 1.0);
      const float light = rib < 0.15 ? 0.66F : rib < 0.3 ? 1.06F : 0.95F;
      return Color{0.50F * light, 0.51F * light, 0.52F * light};
    });
    roof_ = builder_.material({"roof", {1.0F, 1.0F, 1.0F}, semantic(Kind::ceiling), roof});
    const std::uint16_t shutter = builder_.texture("shutter", 32, 256, [&](float s, float t) {
      const double slat = std::fmod(24.0 * static_cast<double>(t), 1.0);
      const double light = (slat < 0.16 ? 0.68 : mixed(0.9, 1.06, slat)) * (static_cast<double>(t) > 0.93 ? 0.5 : 1.0);
      const auto value = static_cast<float>(light) * (s < 0.02F ? 0.8F : 1.0F);
      return Color{0.52F * value, 0.55F * value, 0.58F * value};
    });
    shutter_ = builder_.material({"shutter", {1.0F, 1.0F, 1.0F}, semantic(Kind::door), shutter});
    marking_ = builder_.material({"marking", {0.78F, 0.56F, 0.05F}, semantic(Kind::floor), {}});
    glow_ = builder_.material({"glow", {1.0F, 1.0F, 1.0F}, semantic(Kind::lamp), {}});
  }

  // Adds a rectangle whose texture runs along s. Its corners run counter-clockwise as seen; a and b are the lower ones.
  static void add_sheet(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, double s_from,
                        double s_to, const std::array<double, 4>& t) {
    const std::int32_t first = add_vertex(part, a, s_from, t[0]);
    add_vertex(part, b, s_to, t[1]);
    add_vertex(part, c, s_to, t[2]);
    add_vertex(part, d, s_from, t[3]);
    add_triangle(part, first, first + 1, first + 2);
    add_triangle(part, first, first + 2, first + 3);
  }

  double roof_at(double y) const { return mixed(high_, ridge_, 1.0 - std::abs(2.0 * y / size_.y() - 1.0)); }

  void add_hall() {
    const double length = size_.x(), width = size_.y();
    MeshPart floor;
    add_sheet(floor, {0, 0, 0}, {length, 0, 0}, {length, width, 0}, {0, width, 0}, 0.0, length / kRepeat,
              {0.0, 0.0, width / kRepeat, width / kRepeat});
    builder_.mesh(floor, floor_);
    // Inner wall faces. The wall texture is 2 m wide and as high as the ridge.
    const auto t = [&](double z) { return 1.0 - z / (ridge_ + kRoof); };
    MeshPart sides, gables;
    for (const bool is_far : {false, true}) {
      const double y = is_far ? width : 0.0, x = is_far ? length : 0.0;
      const double from = is_far ? 0.0 : length, to = is_far ? length : 0.0;  // from left to right
      const double strip = high_ - 1.9, top = high_ - 0.8;                    // window strip below the eaves
      const auto pane = [&](double left, double right, double low, double high) {
        is_far ? add_sheet(sides, {right, y, low}, {left, y, low}, {left, y, high}, {right, y, high}, right / 2.0, left / 2.0,
                           {t(low), t(low), t(high), t(high)})
               : add_sheet(sides, {left, y, low}, {right, y, low}, {right, y, high}, {left, y, high}, left / 2.0, right / 2.0,
                           {t(low), t(low), t(high), t(high)});
      };
      const double left = std::min(from, to), right = std::max(from, to);
      pane(left, right, 0.0, strip);
      pane(left, right, top, high_ + kRoof);
      const int frames = num_frames();
      for (int i = 0; i < frames; ++i) {  // solid wall around the columns
        const double a = length * i / frames, b = length * (i + 1) / frames;
        pane(a, a + 0.7, strip, top);
        pane(b - 0.7, b, strip, top);
        Shape bars({{0.5 * (a + b), y}, {0.0, is_far ? -1.0 : 1.0}, 0.0});
        const double half = 0.5 * (b - a) - 0.7;
        for (const double u : {-half, -half / 3.0, half / 3.0, half})
          bars.block({u, 0, 0.5 * (strip + top)}, {0.08, 0.12, top - strip}, Swatch::grey);
        for (const double z : {strip, top}) bars.block({0, 0, z}, {2.0 * half, 0.14, 0.08}, Swatch::grey);
        furniture_.add(bars, Kind::window);
      }
      const double low_y = is_far ? 0.0 : width, high_y = is_far ? width : 0.0;  // seen from inside, right to left
      const std::int32_t a = add_vertex(gables, {x, high_y, 0}, high_y / 2.0, t(0)),
                         b = add_vertex(gables, {x, low_y, 0}, low_y / 2.0, t(0));
      const std::int32_t c = add_vertex(gables, {x, low_y, high_ + kRoof}, low_y / 2.0, t(high_ + kRoof)),
                         e = add_vertex(gables, {x, high_y, high_ + kRoof}, high_y / 2.0, t(high_ + kRoof));
      const std::int32_t d = add_vertex(gables, {x, 0.5 * width, ridge_ + kRoof}, 0.25 * width, t(ridge_ + kRoof));
      add_triangle(gables, b, a, e);
      add_triangle(gables, b, e, c);
      add_triangle(gables, c, e, d);
    }
    builder_.mesh(sides, walls_[0]);
    builder_.mesh(gables, walls_[1]);
    add_roof();
    add_frames();
  }

  int num_frames() const { return std::max(2, static_cast<int>(size_.x() / kFrame + 0.5)); }

  // Adds two slopes with a skylight between each pair of frames.
  void add_roof() {
    MeshPart roof;
    const int frames = num_frames();
    const double width = size_.y(), out = 0.3;
    for (int i = 0; i < frames; ++i) {
      const double from = size_.x() * i / frames, to = size_.x() * (i + 1) / frames;
      const double left = from + 0.28 * (to - from), right = to - 0.28 * (to - from);
      for (const bool is_far : {false, true}) {
        const auto y = [&](double share) { return is_far ? width * (1.0 - 0.5 * share) : 0.5 * width * share; };
        const auto point = [&](double x, double share) {
          const double at = share < 0.0 ? (is_far ? width + out : -out) : y(share);
          return Vec3d(x, at, (share < 0.0 ? high_ - 0.12 * out : roof_at(at)) + kRoof);
        };
        const auto pane = [&](double a, double b, double low, double high) {  // seen from below
          const Vec3d p = point(a, low), q = point(b, low), r = point(b, high), s = point(a, high);
          is_far ? add_sheet(roof, p, q, r, s, a, b, {0, 0, 0, 0}) : add_sheet(roof, q, p, s, r, b, a, {0, 0, 0, 0});
        };
        const double low = 0.42, high = 0.72;
        pane(from, to, -1.0, low);
        pane(from, to, high, 1.0);
        pane(from, left, low, high);
        pane(right, to, low, high);
        Shape bars({Vec2d::Zero(), Vec2d::UnitY(), 0.0});
        for (int k = 0; k <= 3; ++k) {
          const double x = mixed(left, right, k / 3.0);
          bars.rod(point(x, low), point(x, high), 0.07, Swatch::white);
        }
        for (const double share : {low, 0.5 * (low + high), high})
          bars.rod(point(left, share), point(right, share), 0.07, Swatch::white);
        furniture_.add(bars, Kind::window);
      }
    }
    builder_.mesh(roof, roof_);
  }

  // Adds columns along the walls, trusses between them, purlins on top, and lamps below.
  void add_frames() {
    const int frames = num_frames();
    const double width = size_.y(), low = high_ - 0.15;
    const int panels = 2 * std::max(3, static_cast<int>(width / 4.6 + 0.5));
    for (int i = 0; i <= frames; ++i) {
      const double x = std::clamp(size_.x() * i / frames, 0.2, size_.x() - 0.2);
      for (const bool is_far : {false, true}) {
        Shape column({{x, is_far ? width - 0.2 : 0.2}, Vec2d::UnitY(), 0.0});
        for (const double y : {-0.14, 0.14}) column.block({0, y, 0.5 * high_}, {0.24, 0.025, high_}, Swatch::steel);
        column.block({0, 0, 0.5 * high_}, {0.025, 0.26, high_}, Swatch::steel);
        column.block({0, 0, 0.03}, {0.4, 0.36, 0.06}, Swatch::grey);
        column.block({0, is_far ? -0.16 : 0.16, 0.65}, {0.3, 0.03, 1.1}, Swatch::stripes);
        furniture_.add(column, Kind::column);
      }
      Shape truss({{x, 0.0}, Vec2d::UnitY(), 0.0});
      const auto y = [&](int k) { return width * k / panels; };
      truss.rod({0, 0.1, low}, {0, width - 0.1, low}, 0.16, Swatch::steel);
      truss.rod({0, 0.1, high_ + 0.02}, {0, 0.5 * width, ridge_ + 0.02}, 0.16, Swatch::steel);
      truss.rod({0, 0.5 * width, ridge_ + 0.02}, {0, width - 0.1, high_ + 0.02}, 0.16, Swatch::steel);
      for (int k = 1; k < panels; ++k) {
        truss.rod({0, y(k), low}, {0, y(k), roof_at(y(k))}, 0.09, Swatch::steel);
        const int next = 2 * k <= panels ? k - 1 : k + 1;
        truss.rod({0, y(k), low}, {0, y(next), roof_at(y(next))}, 0.08, Swatch::steel);
      }
      const int middle = panels / 2;
      truss.rod({0, y(middle), low}, {0, y(middle + 1), roof_at(y(middle + 1))}, 0.08, Swatch::steel);
      furniture_.add(truss, Kind::beam);
    }
    Shape purlins({{0.0, 0.0}, Vec2d::UnitY(), 0.0});
    for (int k = 0; k <= panels; ++k) {
      const double y = std::clamp(width * k / panels, 0.1, width - 0.1), z = roof_at(y) + 0.05;
      purlins.rod({0, y, z}, {size_.x(), y, z}, 0.1, Swatch::light_grey);
    }
    furniture_.add(purlins, Kind::beam);
    for (int i = 0; i < frames; ++i) {
      const double x = size_.x() * (i + 0.5) / frames;
      const int lamps = std::max(2, static_cast<int>(width / 7.0));
      for (int k = 0; k < lamps; ++k) add_lamp({x, width * (k + 0.5) / lamps});
    }
  }

  void add_lamp(const Vec2d& at) {
    const double low = high_ - 0.75;
    Shape lamp({at, Vec2d::UnitY(), low});
    const std::array<Vec2d, 4> bell{Vec2d(0.30, 0.01), Vec2d(0.25, 0.12), Vec2d(0.12, 0.22), Vec2d(0.08, 0.42)};
    lamp.turned({0, 0}, bell, Swatch::light_grey, 16);
    lamp.rod({0, 0, 0.42}, {0, 0, roof_at(at.y()) - low}, 0.02, Swatch::dark_grey);
    furniture_.add(lamp, Kind::lamp);
    builder_.disc(Vec3d(at.x(), at.y(), low - 0.005).cast<float>(), 0.28F, glow_);
  }

  // Adds shutters in the wall at the low end of x, and a door for people in each gable.
  void add_doors() {
    const double width = size_.y();
    const int count = std::max(1, static_cast<int>((width - 4.0) / 7.0));
    const double wide = 3.4, high = std::min(4.0, high_ - 2.2);
    for (int i = 0; i < count; ++i) {
      const double y = width * (i + 0.5) / count;
      MeshPart leaf;
      const double x = 0.06;
      add_sheet(leaf, {x, y - 0.5 * wide, 0}, {x, y + 0.5 * wide, 0}, {x, y + 0.5 * wide, high}, {x, y - 0.5 * wide, high}, 0.0,
                1.0, {1, 1, 0, 0});
      builder_.mesh(leaf, shutter_);
      Shape frame({{0.0, y}, Vec2d::UnitX(), 0.0});
      for (const double side : {-1.0, 1.0}) {
        frame.block({side * (0.5 * wide + 0.08), 0.1, 0.5 * high}, {0.16, 0.2, high}, Swatch::dark_grey);
        frame.block({side * (0.5 * wide + 0.35), 0.6, 0.45}, {0.16, 0.16, 0.9}, Swatch::stripes);
      }
      frame.block({0, 0.2, high + 0.2}, {wide + 0.4, 0.4, 0.4}, Swatch::light_grey);
      furniture_.add(frame, Kind::door);
      places_.add({{0.0, y - 0.5 * wide - 0.5}, {1.2, y + 0.5 * wide + 0.5}});
    }
    for (const bool is_far : {false, true}) {
      const double y = is_far ? 0.3 * width : 1.2;
      Shape door({{is_far ? size_.x() : 0.0, y}, {is_far ? -1.0 : 1.0, 0.0}, 0.0});
      door.block({0, 0.04, 1.05}, {0.94, 0.05, 2.1}, Swatch::teal);
      for (const double x : {-0.52, 0.52}) door.block({x, 0.05, 1.1}, {0.1, 0.1, 2.2}, Swatch::dark_grey);
      door.block({0, 0.05, 2.15}, {0.94, 0.1, 0.1}, Swatch::dark_grey);
      door.block({0.36, 0.09, 1.05}, {0.14, 0.03, 0.03}, Swatch::steel);
      furniture_.add(door, Kind::door);
      const double x = is_far ? size_.x() - 1.0 : 0.0;
      places_.add({{x, y - 0.8}, {x + 1.0, y + 0.8}});
    }
  }

  // ------------------------------------------------------------------------------------------------------------- racks

  void add_row(const Row& row) {
    for (std::size_t number = 0; number < row.blocks.size(); ++number) {
      const Row::Block& block = row.blocks[number];
      const double to = block.from + block.bays * kBay;
      const Rect rect{{row.x - 0.5 * depth(), block.from}, {row.x + 0.5 * depth(), to}};
      places_.add(rect.grown(0.2));
      builder_.mesh(shade(rect, 0.6, kRepeat), shade_);
      for (const double side : {-1.0, 1.0}) {
        const double x = row.x + side * 0.5 * (kBetween + kRack);
        add_rack(x, block);
        for (int bay = 0; bay < block.bays; ++bay) {
          for (int level = 0; level < levels_; ++level) {
            const bool is_gap = std::any_of(row.gaps.begin(), row.gaps.end(), [&](const Row::Gap& gap) {
              return gap.block == number && gap.bay == bay && gap.level == level;
            });
            if (!is_gap && draws_.below(9) > 0) fill(x, block.from + bay * kBay, level * kLevel + (level > 0 ? 0.07 : 0.0));
          }
        }
      }
    }
  }

  void add_rack(double x, const Row::Block& block) {
    Shape shape({{x, block.from}, Vec2d::UnitY(), 0.0});
    const double top = (levels_ - 1) * kLevel + 1.1, half = 0.5 * kRack - 0.05;
    for (int i = 0; i <= block.bays; ++i) {
      const double y = i * kBay;
      for (const double side : {-half, half}) shape.block({side, y, 0.5 * top}, {0.09, 0.09, top}, Swatch::blue);
      double z = 0.3;
      for (bool is_up = true; z + 1.0 < top; is_up = !is_up, z += 1.0) {
        shape.rod({is_up ? -half : half, y, z}, {is_up ? half : -half, y, z + 1.0}, 0.04, Swatch::blue);
      }
      for (const double side : {-half - 0.09, half + 0.09}) shape.block({side, y, 0.2}, {0.06, 0.16, 0.4}, Swatch::yellow);
    }
    for (int level = 1; level < levels_; ++level) {
      const double z = level * kLevel;
      for (int i = 0; i < block.bays; ++i) {
        for (const double side : {-half, half})
          shape.block({side, (i + 0.5) * kBay, z}, {0.05, kBay - 0.09, 0.12}, Swatch::orange);
      }
    }
    furniture_.add(shape, Kind::rack);
  }

  // Places pallets side by side in a bay.
  void fill(double x, double y, double z) {
    for (int i = 0; i < 3; ++i) {
      if (draws_.below(5) == 0) continue;
      const double at = y + kBay * (i + 0.5) / 3.0 + draws_.uniform(-0.02, 0.02);
      const double high = draws_.uniform(0.95, 1.55);
      furniture_.load({{x + draws_.uniform(-0.05, 0.05), at}, Vec2d::UnitY(), z}, high);
    }
  }

  // ------------------------------------------------------------------------------------------------------------- floor

  void add_line(const Vec2d& low, const Vec2d& high) {
    const Vec2d middle = 0.5 * (low + high);
    builder_.plane(Vec3d(middle.x(), middle.y(), 0.006).cast<float>(), (high - low).cast<float>(), marking_);
  }

  void add_markings() {
    constexpr double kWide = 0.1, kOff = 0.35;
    for (const Row& row : rows_) {
      for (const Row::Block& block : row.blocks) {
        const double to = block.from + block.bays * kBay, half = 0.5 * depth() + kOff;
        for (const double x : {row.x - half, row.x + half})
          add_line({x - 0.5 * kWide, block.from - kOff}, {x + 0.5 * kWide, to + kOff});
        for (const double y : {block.from - kOff, to + kOff})
          add_line({row.x - half, y - 0.5 * kWide}, {row.x + half, y + 0.5 * kWide});
      }
    }
    // Pallet bays in front.
    const double from = 3.2, to = 5.8;
    for (double y = 0.16 * size_.y(); y < 0.86 * size_.y(); y += 2.0) add_line({from, y - 0.5 * kWide}, {to, y + 0.5 * kWide});
    add_line({to, 0.12 * size_.y()}, {to + kWide, 0.88 * size_.y()});
    // A walkway at the back.
    for (const double x : {size_.x() - 1.6, size_.x() - 0.5}) add_line({x, 0.8}, {x + kWide, size_.y() - 0.8});
  }

  std::optional<Spot> place(const Rect& zone, double across, double deep) {
    constexpr std::array<std::array<int, 2>, 4> kWays{{{0, 1}, {0, -1}, {1, 0}, {-1, 0}}};
    for (int i = 0; i < 24; ++i) {
      const auto& way = kWays[static_cast<std::size_t>(draws_.below(4))];
      const Spot spot{draws_.point(zone.low, zone.high), {static_cast<double>(way[0]), static_cast<double>(way[1])}, 0.0};
      const Vec2d half = 0.5 * (way[0] == 0 ? Vec2d(across, deep) : Vec2d(deep, across));
      if (places_.take({spot.at - half, spot.at + half}, zone)) return spot;
    }
    return std::nullopt;
  }

  void furnish() {
    const double width = size_.y();
    const Rect front{{0.4, 0.5}, {kFront - 1.4, width - 0.5}},
        back{{size_.x() - kBack + 1.4, 0.5}, {size_.x() - 0.4, width - 0.5}};
    const int many = std::max(2, static_cast<int>(width / 6.0));
    for (int i = 0; i < 1 + many / 4; ++i) {
      if (const auto spot = place(draws_.below(2) == 0 ? front : back, 1.3, 3.2))
        furniture_.forklift({spot->at - 0.4 * spot->facing, spot->facing, 0.0});
    }
    // A conveyor at the back, across the hall's width.
    for (int k = 0; k < 12; ++k) {
      const double deep = draws_.uniform(5.0, 9.0);
      const Spot spot{draws_.point(back.low + Vec2d(0.5, 0.5 * deep), back.high - Vec2d(0.5, 0.5 * deep)), Vec2d::UnitY(), 0.0};
      if (!places_.take({spot.at - Vec2d(0.5, 0.5 * deep), spot.at + Vec2d(0.5, 0.5 * deep)}, back)) continue;
      furniture_.conveyor(spot, deep);
      break;
    }
    for (int i = 0; i < many; ++i) {  // workbenches along the back wall
      const double y = draws_.uniform(1.6, width - 1.6), x = size_.x() - 0.55;
      if (places_.take({{x - 0.45, y - 1.1}, {x + 0.45, y + 1.1}}, back.grown(0.3))) furniture_.workbench({{x, y}, {-1, 0}, 0.0});
    }
    // Pallets stand in their bays in front.
    for (double y = 0.16 * width; y + 2.0 < 0.86 * width; y += 2.0) {
      for (const double x : {3.9, 5.1}) {
        if (draws_.below(3) == 0 || !places_.take({{x - 0.5, y + 0.3}, {x + 0.5, y + 1.7}}, front)) continue;
        furniture_.load({{x, y + 1.0}, Vec2d::UnitX(), 0.0}, draws_.uniform(0.7, 1.6));
      }
    }
    constexpr std::array<Swatch, 4> kPaints{Swatch::blue, Swatch::red, Swatch::teal, Swatch::grey};
    for (int i = 0; i < many; ++i) {
      const Rect& zone = draws_.below(2) == 0 ? front : back;
      if (const auto spot = place(zone, 1.4, 1.4)) {
        const Swatch paint = kPaints[static_cast<std::size_t>(draws_.below(4))];
        for (const double x : {-0.33, 0.33}) {
          for (const double y : {-0.33, 0.33}) {
            if (draws_.below(5) > 0) furniture_.barrel({spot->at + Vec2d(x, y), Vec2d::UnitY(), 0.0}, paint);
          }
        }
      }
      if (const auto spot = place(zone, 0.8, 0.7)) furniture_.cartons(*spot, 1 + draws_.below(4));
      if (const auto spot = place(zone, 1.3, 0.9)) {
        for (int k = draws_.below(6); k >= 0; --k)
          furniture_.pallet({spot->at + draws_.point({-0.03, -0.03}, {0.03, 0.03}), spot->facing, 0.14 * k});
      }
    }
  }

  const WarehouseConfig& config_;
  Draws draws_;
  Vec2d size_;
  double high_, ridge_;  // m, heights of the eaves and the ridge
  int levels_;           // number of pallet levels
  WorldBuilder builder_;
  Furniture furniture_;
  std::vector<Row> rows_;
  std::vector<Vec3d> lane_;
  Places places_;

  std::array<std::uint16_t, 2> walls_{};
  std::uint16_t floor_ = 0, shade_ = 0, roof_ = 0, shutter_ = 0, marking_ = 0, glow_ = 0;
};

std::shared_ptr<const World> with_forklifts(const std::shared_ptr<const World>& world, const WarehouseConfig& config,
                                            std::uint32_t attempt) {
  if (config.forklifts == 0) return world;
  constexpr float kLift = 0.08F;
  Movers movers(*world, Draws::kWarehouse, config.seed, attempt);
  WorldBuilder builder("forklift");
  Furniture(builder, Draws::kWarehouse, config.seed, movers.draws()).moving_forklift({{-0.5, 0.0}, {1.0, 0.0}, 0.0});
  BodyConfig forklift;
  forklift.name = "forklift";
  forklift.shape = BodyShape::mesh;
  forklift.mesh = builder.build();
  forklift.semantic = semantic(Kind::forklift);
  const Aabb area{Vec3::Zero(), Vec3(config.size_m[0], config.size_m[1], 0.0F)};
  movers.add_on_lines(
      {forklift}, config.forklifts,
      {.area = area, .least_m = 5.0, .most_m = 14.0, .is_aligned = true, .least_mps = 1.0, .most_mps = 2.5, .lift_m = kLift});
  return world->with_bodies(movers.bodies());
}

}  // namespace
}  // namespace flockstep::indoors

namespace flockstep {

void WarehouseConfig::validate() const { check_fields(*this, "warehouse: "); }

std::shared_ptr<const World> warehouse(const WarehouseConfig& config) {
  using namespace indoors;
  return with_crooked_lane<Warehouse>(config, "warehouse: seed",
                                      [&](const std::shared_ptr<const World>& world, const Warehouse&, std::uint32_t attempt) {
                                        return with_forklifts(world, config, attempt);
                                      });
}

}  // namespace flockstep
