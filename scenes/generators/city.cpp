// Generates cities: streets, blocks of houses, street furniture, traffic, and a flight lane through it all.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/world_builder.hpp"
#include "generators/city_parts.hpp"
#include "generators/layouts.hpp"
#include "generators/movers.hpp"
#include "generators/noise.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep::streets {
namespace {

struct Span {  // m, interval along an axis
  double low, high;
  double middle() const { return 0.5 * (low + high); }
  double length() const { return high - low; }
};

struct Rectangle {
  Vec2d low, high;
};

struct Built {
  Lot lot;
  double height;  // m
};

class City {
  static constexpr double kRoadway = 10.0, kPavement = 4.0, kKerb = 0.25;  // m, widths
  static constexpr double kRim = 13.0, kBeyond = 4.0;                      // m, depth of the outer houses, margin behind them
  static constexpr double kMinBlock = 34.0, kMaxBlock = 46.0;              // m, kerb to kerb
  static constexpr double kSlit = 0.01;                                    // m, gap on each side of a party wall
  static constexpr double kHouse = 11.0;                                   // m, minimum width of a lot after a split
  static constexpr double kZebra = 5.0;                                    // m along the road, stop line included
  static constexpr double kSpawnReach = 0.5, kSpawnHeight = 0.25;          // m, half sizes of the spawn box
  // Flight lane, in m: height range, maximum sideways swing, length of a bend, spacing of its points, minimum clearance.
  static constexpr double kLaneLow = 2.4, kLaneHigh = 5.4, kLaneSwing = 3.2, kLaneBend = 14.0, kLaneStep = 0.5, kLaneGap = 1.0;

 public:
  City(const CityConfig& config, std::uint32_t attempt)
      : config_(config), draws_(Draws::kCity, config.seed, attempt), wander_(Draws::kCity, config.seed, 16 * attempt + 2) {
    for (std::size_t axis = 0; axis < 2; ++axis) lay_roads(axis);
    lay_lane();
  }

  std::vector<Vec3> lane() const { return rounded(lane_); }

  // Lets cars drive around blocks, clockwise on the lane beside them: on the right.
  void drive(const World& city, Movers& movers) const {
    constexpr int kDarts = 50;
    constexpr double kAside = 1.5;  // m, from the middle of the road
    constexpr float kLift = 0.08F, kCornerRadius = 4.5F;
    constexpr std::array kKinds{CarKind::hatchback, CarKind::sedan, CarKind::estate, CarKind::taxi, CarKind::van, CarKind::sedan};
    Draws& draws = movers.draws();
    std::vector<std::shared_ptr<const World>> cars;  // shared by the bodies
    for (const CarKind kind : kKinds) cars.push_back(moving_car(city, surfaces_.car, kind, draws));
    for (int i = 0; i < config_.traffic; ++i) {
      Interrupt::poll();
      BodyConfig car;
      car.name = "car";
      car.shape = BodyShape::mesh;
      car.mesh = cars[static_cast<std::size_t>(draws.below(static_cast<int>(cars.size())))];
      car.semantic = city.semantic(surfaces_.car);
      bool is_added = false;
      for (int dart = 0; dart < kDarts && !is_added; ++dart) {
        std::array<Span, 2> around{};
        for (std::size_t axis = 0; axis < 2; ++axis) {
          const int first = draws.below(config_.blocks[axis]);
          const int last = std::min(first + draws.below(2), config_.blocks[axis] - 1);
          around[axis] = {roads_[axis][static_cast<std::size_t>(first)].middle() + kAside,
                          roads_[axis][static_cast<std::size_t>(last) + 1].middle() - kAside};
        }
        const auto corner = [&](double x, double y) {
          return std::array<float, 3>{static_cast<float>(centimetres(x)), static_cast<float>(centimetres(y)), 0.0F};
        };
        const auto& [x, y] = around;
        car.motion.kind = BodyMotionKind::waypoints;
        car.motion.points_m = {corner(x.low, y.low), corner(x.low, y.high), corner(x.high, y.high), corner(x.high, y.low)};
        car.position_m = car.motion.points_m.front();
        car.motion.corner_radius_m = kCornerRadius;
        car.motion.faces_travel = true;
        car.motion.speed_mps = static_cast<float>(centimetres(draws.uniform(3.0, 7.0)));
        is_added = movers.add(car, kLift);
      }
      if (!is_added) return;
    }
  }

  WorldBuilder built() {
    WorldBuilder builder("city/seed-" + std::to_string(config_.seed));
    surfaces_ = add_city_surfaces(builder, config_.seed);
    add_roads(builder);
    const int blocks = config_.blocks[0] * config_.blocks[1];
    const int square = blocks > 1 ? draws_.below(blocks) : -1;
    for (int i = 0; i < blocks; ++i) {
      Interrupt::poll();
      const Rectangle block{{blocks_[0][column(i)].low, blocks_[1][row(i)].low},
                            {blocks_[0][column(i)].high, blocks_[1][row(i)].high}};
      i == square ? add_square(builder, block) : add_block_of_houses(builder, block);
    }
    add_rim(builder);
    add_bridges(builder);
    add_cables(builder);
    if (config_.traffic == 0) add_traffic(builder);

    Light light;  // late afternoon
    light.sun_direction = {-0.80F, -0.40F, 0.52F};
    light.sun_color = {1.95F, 1.58F, 1.12F};
    light.sky_ambient = {0.46F, 0.55F, 0.70F};
    light.ground_ambient = {0.27F, 0.25F, 0.23F};
    light.zenith_color = {0.12F, 0.30F, 0.66F};
    light.horizon_color = {0.60F, 0.71F, 0.83F};
    builder.light(light);
    builder.start(lane_.front().cast<float>());
    builder.goal(lane_.back().cast<float>());
    const Vec3d reach(kSpawnReach, kSpawnReach, kSpawnHeight);
    builder.spawn_box({(lane_.front() - reach).cast<float>(), (lane_.front() + reach).cast<float>()});
    return builder;
  }

 private:
  std::size_t column(int block) const { return static_cast<std::size_t>(block % config_.blocks[0]); }
  std::size_t row(int block) const { return static_cast<std::size_t>(block / config_.blocks[0]); }
  bool likely(double share) { return draws_.uniform(0.0, 1.0) < share; }

  // ---- plan

  void lay_roads(std::size_t axis) {
    double at = kBeyond + kRim + kPavement;
    for (int i = 0; i <= config_.blocks[axis]; ++i) {
      roads_[axis].push_back({at, at + kRoadway});
      at += kRoadway;
      if (i == config_.blocks[axis]) break;
      const double block = draws_.uniform(kMinBlock, kMaxBlock);
      blocks_[axis].push_back({at, at + block});
      at += block;
    }
    size_[axis] = at + kPavement + kRim + kBeyond;
  }

  // Lays the lane along the road centres, from the first crossing column to the last. It ends in a different row.
  void lay_lane() {
    const auto rows = static_cast<int>(roads_[1].size()), columns = static_cast<int>(roads_[0].size());
    const int first = draws_.below(rows);
    const int last = (first + 1 + draws_.below(rows - 1)) % rows;
    std::vector<Vec2d> corners;
    int here = first;
    for (int i = 0; i < columns; ++i) {
      const double x = roads_[0][static_cast<std::size_t>(i)].middle();
      corners.emplace_back(x, roads_[1][static_cast<std::size_t>(here)].middle());
      const int left = last - here;
      const int next = i + 1 == columns ? last : here + (left > 0 ? draws_.below(left + 1) : -draws_.below(1 - left));
      if (next != here) corners.emplace_back(x, roads_[1][static_cast<std::size_t>(next)].middle());
      here = next;
    }
    double along = 0.0;  // m, length of the lane so far
    for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
      const Vec2d way = corners[i + 1] - corners[i], left = Vec2d(-way.y(), way.x()).normalized();
      const int steps = static_cast<int>(std::ceil(way.norm() / kLaneStep));
      for (int k = i == 0 ? 0 : 1; k <= steps; ++k) {
        const double share = static_cast<double>(k) / steps, far = along + share * way.norm();
        const double room = std::min(1.0, 5.0 * std::min(share, 1.0 - share));  // no swing at the ends of a stretch
        const double aside = kLaneSwing * room * (2.0 * wander_.at(far / kLaneBend, 0.5) - 1.0);
        const Vec2d at = corners[i] + share * way + aside * left;
        lane_.emplace_back(at.x(), at.y(), mixed(kLaneLow, kLaneHigh, wander_.at(far / kLaneBend, 7.5)));
      }
      along += way.norm();
    }
  }

  // Returns whether the box keeps clear of the lane. a and b are opposite corners.
  bool is_clear(const Vec3d& a, const Vec3d& b) const {
    const Vec3d low = a.cwiseMin(b), high = a.cwiseMax(b);
    return std::all_of(lane_.begin(), lane_.end(), [&](const Vec3d& point) {
      const Vec3d outside = (low - point).cwiseMax(point - high).cwiseMax(Vec3d::Zero());
      return outside.squaredNorm() >= kLaneGap * kLaneGap;
    });
  }
  // Same check for a box given in a frame.
  bool is_clear(const Frame& frame, const Vec3d& low, const Vec3d& high) const {
    return is_clear(frame(low.x(), low.y(), low.z()), frame(high.x(), high.y(), high.z()));
  }

  // ---- ground

  static void add_level(MeshPart& part, const Rectangle& at, double z, double repeat_m) {
    add_quad(part, {at.low.x(), at.low.y(), z}, {at.high.x(), at.low.y(), z}, {at.high.x(), at.high.y(), z},
             {at.low.x(), at.high.y(), z}, repeat_m);
  }

  // Adds a stretch of road between two positions along an axis. The texture's s runs across the road, t along it.
  static void add_road(MeshPart& part, std::size_t axis, const Span& across, double from, double to, double s_from, double s_to) {
    // Looking along the road, `low` is the right side for axis 0.
    const auto at = [&](double along, double aside) {
      return axis == 0 ? Vec3d(along, aside, 0.0) : Vec3d(across.low + across.high - aside, along, 0.0);
    };
    const std::int32_t first = add_vertex(part, at(from, across.low), 1.0, s_from);
    add_vertex(part, at(to, across.low), 1.0, s_to);
    add_vertex(part, at(to, across.high), 0.0, s_to);
    add_vertex(part, at(from, across.high), 0.0, s_from);
    const bool is_upright = (to - from) > 0.0;
    is_upright ? add_triangle(part, first, first + 1, first + 2) : add_triangle(part, first, first + 2, first + 1);
    is_upright ? add_triangle(part, first, first + 2, first + 3) : add_triangle(part, first, first + 3, first + 2);
  }

  void add_roads(WorldBuilder& builder) const {
    Thing thing;
    for (const Span& x : roads_[0]) {
      for (const Span& y : roads_[1]) add_level(thing.of(surfaces_.asphalt), {{x.low, y.low}, {x.high, y.high}}, 0.0, 7.0);
    }
    for (std::size_t axis = 0; axis < 2; ++axis) {
      for (const Span& road : roads_[1 - axis]) {
        for (const Span& block : blocks_[axis]) {
          const double from = block.low + kZebra, to = block.high - kZebra;
          // The zebra texture starts at the end away from the crossing.
          add_road(thing.of(surfaces_.zebra), axis, road, from, block.low, 0.0, 1.0);
          add_road(thing.of(surfaces_.zebra), axis, road, to, block.high, 0.0, 1.0);
          add_road(thing.of(surfaces_.lanes), axis, road, from, to, 0.0, (to - from) / kRoadway);
        }
      }
    }
    // The pavement around the whole street grid.
    const Vec2d low(roads_[0].front().low, roads_[1].front().low), high(roads_[0].back().high, roads_[1].back().high);
    add_pavement(thing, {Vec2d::Zero(), Vec2d(size_[0], size_[1])}, {low, high}, surfaces_.pavement, 3.0);
    const std::array<Vec2d, 4> corners{{low, {high.x(), low.y()}, high, {low.x(), high.y()}}};
    for (std::size_t i = 0; i < 4; ++i) add_kerb(thing, corners[(i + 1) % 4], corners[i]);
    thing.into(builder);
  }

  // Adds pavement on the part of the outer rectangle that lies outside the inner one.
  static void add_pavement(Thing& thing, const Rectangle& outer, const Rectangle& inner, std::uint16_t material,
                           double repeat_m) {
    MeshPart& part = thing.of(material);
    const double z = kPavementHeight;
    add_level(part, {outer.low, {outer.high.x(), inner.low.y()}}, z, repeat_m);
    add_level(part, {{outer.low.x(), inner.high.y()}, outer.high}, z, repeat_m);
    add_level(part, {{outer.low.x(), inner.low.y()}, {inner.low.x(), inner.high.y()}}, z, repeat_m);
    add_level(part, {{inner.high.x(), inner.low.y()}, {outer.high.x(), inner.high.y()}}, z, repeat_m);
  }

  // Adds a kerb face. The road is on the right when going from `from` to `to`.
  void add_kerb(Thing& thing, const Vec2d& from, const Vec2d& to) const {
    const double z = kPavementHeight;
    add_quad(thing.of(surfaces_.kerb), {from.x(), from.y(), 0.0}, {to.x(), to.y(), 0.0}, {to.x(), to.y(), z},
             {from.x(), from.y(), z});
  }

  // Adds the kerb and pavement of a block. Returns the rectangle inside.
  Rectangle add_block_ground(WorldBuilder& builder, const Rectangle& block) const {
    Thing thing;
    const Vec2d kerb = Vec2d::Constant(kKerb), walk = Vec2d::Constant(kPavement);
    const Rectangle paved{block.low + kerb, block.high - kerb}, inner{block.low + walk, block.high - walk};
    const std::array<Vec2d, 4> corners{{block.low, {block.high.x(), block.low.y()}, block.high, {block.low.x(), block.high.y()}}};
    for (std::size_t i = 0; i < 4; ++i) add_kerb(thing, corners[i], corners[(i + 1) % 4]);
    add_pavement(thing, block, paved, surfaces_.kerb, 1.0);
    add_pavement(thing, paved, inner, surfaces_.pavement, 3.0);
    thing.into(builder);
    return inner;
  }

  // ---- blocks

  // Houses get taller towards the city centre.
  void add_house_on(WorldBuilder& builder, Lot lot) {
    for (std::size_t side = 0; side < 4; ++side) {  // a gap between houses avoids coincident faces
      if (lot.sides[side] != Side::party) continue;
      const auto i = static_cast<Eigen::Index>(side % 2 == 0 ? 1 : 0);
      side == 1 || side == 2 ? lot.high[i] -= kSlit : lot.low[i] += kSlit;
    }
    const Vec2d middle(0.5 * size_[0], 0.5 * size_[1]);
    const Vec2d away = (0.5 * (lot.low + lot.high) - middle).cwiseQuotient(middle);
    const double central = std::max(0.0, 1.0 - away.norm());
    const double boldness = std::clamp(0.75 * central + draws_.uniform(-0.1, 0.55), 0.05, 1.0);
    const double most = static_cast<double>(config_.height_m);
    houses_.push_back({lot, add_house(builder, surfaces_, lot, most, boldness, draws_)});
  }

  void split(std::vector<Lot>& lots, const Lot& lot) {
    const std::size_t axis = lot.size().x() >= lot.size().y() ? 0 : 1;
    const auto i = static_cast<Eigen::Index>(axis);
    const double length = lot.size()[i];
    const bool has_alley = likely(0.3);
    const double gap = has_alley ? draws_.uniform(2.6, 5.0) : 0.0;
    const bool is_large = length > 24.0 || (length > 2.0 * kHouse + gap && likely(0.8));
    if (!is_large) return lots.push_back(lot);
    const double room = length - gap - 2.0 * kHouse;
    const double cut = lot.low[i] + kHouse + draws_.uniform(0.2, 0.8) * std::max(room, 0.0);
    Lot first = lot, second = lot;
    first.high[i] = cut;
    second.low[i] = cut + gap;
    const Side between = has_alley ? Side::alley : Side::party;
    first.sides[axis == 0 ? 1 : 2] = between;
    second.sides[axis == 0 ? 3 : 0] = between;
    split(lots, first);
    split(lots, second);
  }

  void add_block_of_houses(WorldBuilder& builder, const Rectangle& block) {
    const Rectangle inner = add_block_ground(builder, block);
    MeshPart ground;
    add_level(ground, inner, kPavementHeight, 3.0);
    builder.mesh(ground, surfaces_.pavement);
    std::vector<Lot> lots;
    Lot whole{inner.low, inner.high, {}};
    whole.sides.fill(Side::street);
    split(lots, whole);
    for (const Lot& lot : lots) {
      Interrupt::poll();
      add_house_on(builder, lot);
    }
    furnish_around(builder, block, true);
  }

  // Adds a square: lawns, trees, benches, and a fountain where the two paths cross.
  void add_square(WorldBuilder& builder, const Rectangle& block) {
    const Rectangle inner = add_block_ground(builder, block);
    const Vec2d middle = 0.5 * (inner.low + inner.high);
    constexpr double kPath = 1.8, kCircle = 5.5;
    Thing thing;
    MeshPart &path = thing.of(surfaces_.gravel), &grass = thing.of(surfaces_.grass);
    const double z = kPavementHeight;
    add_level(path, {middle - Vec2d::Constant(kCircle), middle + Vec2d::Constant(kCircle)}, z, 2.0);
    for (const double x : {-1.0, 1.0}) {
      const double edge = x < 0.0 ? inner.low.x() : inner.high.x();
      const Vec2d a(std::min(edge, middle.x() + x * kCircle), middle.y() - kPath),
          b(std::max(edge, middle.x() + x * kCircle), middle.y() + kPath);
      add_level(path, {a, b}, z, 2.0);
      const double side = x < 0.0 ? inner.low.y() : inner.high.y();
      const Vec2d c(middle.x() - kPath, std::min(side, middle.y() + x * kCircle)),
          d(middle.x() + kPath, std::max(side, middle.y() + x * kCircle));
      add_level(path, {c, d}, z, 2.0);
      for (const double y : {-1.0, 1.0}) {  // two rectangles: the lawn minus the circle's corner
        const Vec2d out(edge, y < 0.0 ? inner.low.y() : inner.high.y());
        const Vec2d near(middle.x() + x * kCircle, middle.y() + y * kPath),
            corner(middle.x() + x * kPath, middle.y() + y * kCircle);
        add_level(grass, {near.cwiseMin(out), near.cwiseMax(out)}, z, 4.0);
        const Vec2d far(middle.x() + x * kCircle, out.y());
        add_level(grass, {corner.cwiseMin(far), corner.cwiseMax(far)}, z, 4.0);
      }
    }
    thing.into(builder);
    add_fountain(builder, surfaces_, {middle.x(), middle.y(), z});
    for (const Vec2d& out : {Vec2d(1.0, 0.0), Vec2d(0.0, 1.0), Vec2d(-1.0, 0.0), Vec2d(0.0, -1.0)}) {
      const Vec2d along(-out.y(), out.x());
      for (const double aside : {-3.6, 3.6}) {
        const Vec2d at = middle + 5.0 * out + aside * along;
        add_bench(builder, surfaces_, {{at.x(), at.y(), z}, Vec2d(out.y(), -out.x())});
      }
      const Vec2d lamp = middle + 5.2 * out + 2.1 * along;
      add_small_lamp(builder, {lamp.x(), lamp.y(), z});
    }
    std::vector<Vec2d> taken;
    for (int i = 0; i < 80 && taken.size() < 16; ++i) {
      const Vec2d at = draws_.point(inner.low + Vec2d::Constant(1.8), inner.high - Vec2d::Constant(1.8));
      const Vec2d off = (at - middle).cwiseAbs();
      const bool is_on_path = off.minCoeff() < kPath + 0.8 || off.maxCoeff() < kCircle + 1.0;
      const auto is_near = [&](const Vec2d& other) { return (at - other).norm() < 4.2; };
      if (is_on_path || std::any_of(taken.begin(), taken.end(), is_near)) continue;
      if (try_tree(builder, {at.x(), at.y(), z}, draws_.uniform(6.5, 10.5), 2.6)) taken.push_back(at);
    }
    furnish_around(builder, block, false);
  }

  void add_small_lamp(WorldBuilder& builder, const Vec3d& foot) const {
    const Vec3d top = foot + Vec3d(0.0, 0.0, 3.4);
    builder.cylinder((0.5 * (foot + top)).cast<float>(), 0.05F, 3.4F, surfaces_.pole);
    builder.sphere((top + Vec3d(0.0, 0.0, 0.2)).cast<float>(), 0.24F, surfaces_.lamp);
  }

  bool try_tree(WorldBuilder& builder, const Vec3d& foot, double tall, double reach) {
    const TreeSize size{tall, std::max(2.3, 0.3 * tall), reach};
    const Vec3d half(1.2 * reach, 1.2 * reach, 0.0), trunk(0.25, 0.25, 0.0);
    if (!is_clear(foot - half + Vec3d(0.0, 0.0, size.fork), foot + half + Vec3d(0.0, 0.0, 1.1 * tall)) ||
        !is_clear(foot - trunk, foot + trunk + Vec3d(0.0, 0.0, size.fork))) {
      return false;
    }
    add_tree(builder, surfaces_, foot, size, draws_);
    return true;
  }

  // Adds the outer rows of houses along the city's four sides. They face inwards.
  void add_rim(WorldBuilder& builder) {
    const Vec2d low = Vec2d::Constant(kBeyond), high(size_[0] - kBeyond, size_[1] - kBeyond);
    const Vec2d inner_low = low + Vec2d::Constant(kRim), inner_high = high - Vec2d::Constant(kRim);
    const auto add_row = [&](const Vec2d& from, const Vec2d& to, std::size_t axis, std::size_t front) {
      const auto i = static_cast<Eigen::Index>(axis);
      const int count = std::max(1, static_cast<int>((to[i] - from[i]) / 15.0));
      const double pitch = (to[i] - from[i]) / count;
      double at = from[i];
      for (int k = 0; k < count; ++k) {
        Interrupt::poll();
        const double next = k + 1 == count ? to[i] : from[i] + (k + 1) * pitch + draws_.uniform(-0.2, 0.2) * pitch;
        Lot lot{from, to, {}};
        lot.low[i] = at;
        lot.high[i] = next;
        lot.sides.fill(Side::party);
        lot.sides[front] = Side::street;
        add_house_on(builder, lot);
        at = next;
      }
    };
    add_row(low, {high.x(), inner_low.y()}, 0, 2);
    add_row({low.x(), inner_high.y()}, high, 0, 0);
    add_row({low.x(), inner_low.y()}, {inner_low.x(), inner_high.y()}, 1, 1);
    add_row({inner_high.x(), inner_low.y()}, {high.x(), inner_high.y()}, 1, 3);
    for (std::size_t axis = 0; axis < 2; ++axis) {  // pavement of the outer rows, one stretch per block
      for (const Span& block : blocks_[axis]) {
        const double near = roads_[1 - axis].front().low, far = roads_[1 - axis].back().high;
        // The frame's y axis points away from the road.
        axis == 0 ? furnish(builder, {{block.high, near, 0.0}, {-1.0, 0.0}}, block.length(), true)
                  : furnish(builder, {{near, block.low, 0.0}, {0.0, 1.0}}, block.length(), true);
        axis == 0 ? furnish(builder, {{block.low, far, 0.0}, {1.0, 0.0}}, block.length(), true)
                  : furnish(builder, {{far, block.high, 0.0}, {0.0, -1.0}}, block.length(), true);
      }
    }
  }

  // ---- street furniture and cars

  void furnish_around(WorldBuilder& builder, const Rectangle& block, bool has_houses) {
    const Vec2d size = block.high - block.low;
    furnish(builder, {{block.low.x(), block.low.y(), 0.0}, {1.0, 0.0}}, size.x(), has_houses);
    furnish(builder, {{block.high.x(), block.low.y(), 0.0}, {0.0, 1.0}}, size.y(), has_houses);
    furnish(builder, {{block.high.x(), block.high.y(), 0.0}, {-1.0, 0.0}}, size.x(), has_houses);
    furnish(builder, {{block.low.x(), block.high.y(), 0.0}, {0.0, -1.0}}, size.y(), has_houses);
  }

  // Furnishes one side of a block. The side starts at a corner and follows the kerb, with the pavement on its left and the road
  // on its right.
  void furnish(WorldBuilder& builder, const Frame& side, double length, bool has_houses) {
    constexpr double kFromKerb = 0.75;
    const auto on_pavement = [&](double x, double y) { return Frame{side(x, y, kPavementHeight), side.along}; };
    const int slots = static_cast<int>((length - 6.0) / 4.6);
    const int bus_stop = likely(0.3) ? 1 + draws_.below(std::max(1, slots - 2)) : -9;
    for (int i = 0; i < slots; ++i) {
      const double x = 3.0 + (i + 0.5) * (length - 6.0) / slots;
      const Frame here = on_pavement(x, kFromKerb);
      const double luck = draws_.uniform(0.0, 1.0), tall = draws_.uniform(5.5, 8.0), reach = draws_.uniform(1.5, 2.1);
      if (i == bus_stop) {
        const Frame stop = on_pavement(x, 1.6);
        if (is_clear(stop, {-2.3, -0.9, 0.0}, {2.3, 0.9, 2.6})) add_bus_stop(builder, surfaces_, stop);
      } else if (i % 4 == 1) {
        if (is_clear(here, {-0.2, -0.2, 0.0}, {0.2, 0.2, 6.4}) && is_clear(here, {-0.2, -2.0, 6.1}, {0.2, 0.0, 6.6})) {
          add_lamp(builder, surfaces_, here);
        }
      } else if (i % 4 != 3 && luck < 0.62 && std::abs(i - bus_stop) > 1) {
        if (try_tree(builder, here.at, tall, reach)) add_grating(builder, here);
      } else if (luck < 0.2) {
        add_hydrant(builder, surfaces_, here);
      } else if (luck < 0.4) {
        add_bin(builder, surfaces_, here);
      } else if (luck < 0.7) {
        add_bench(builder, surfaces_, on_pavement(x, 0.9));
      } else {
        add_planter(builder, surfaces_, here, draws_);
      }
    }
    for (double x = 6.0; has_houses && x < length - 6.0; x += draws_.uniform(2.6, 9.0)) {
      if (likely(0.2)) add_table(builder, surfaces_, on_pavement(x, kPavement - 1.35), draws_);
    }
    const Frame corner = on_pavement(length - 0.8, kFromKerb);
    const double arm = draws_.uniform(2.4, 3.6);
    if (is_clear(corner, {-0.5, -arm, 4.7}, {0.3, 0.2, 6.0}) && is_clear(corner, {-0.4, -0.2, 0.0}, {0.2, 0.2, 5.7})) {
      add_traffic_light(builder, surfaces_, corner, arm);
    }
    park(builder, side, length);
  }

  void add_grating(WorldBuilder& builder, const Frame& at) const {
    MeshPart part;
    add_block(part, at, {0.0, 0.0, 0.0}, {1.2, 1.2, 0.05});
    builder.mesh(part, surfaces_.bark);
  }

  CarKind a_car() {
    constexpr std::array<CarKind, 8> kKinds{CarKind::hatchback, CarKind::hatchback, CarKind::sedan, CarKind::sedan,
                                            CarKind::estate,    CarKind::estate,    CarKind::taxi,  CarKind::van};
    return kKinds[static_cast<std::size_t>(draws_.below(static_cast<int>(kKinds.size())))];
  }

  void try_car(WorldBuilder& builder, const Frame& at, CarKind kind) {
    const CarSize size = size_of(kind);
    const Vec3d half(0.5 * size.length, 0.5 * size.width, 0.0);
    if (is_clear(at, -half, half + Vec3d(0.0, 0.0, size.height + 0.05))) add_car(builder, surfaces_.car, at, kind, draws_);
  }

  // Parks cars in the bays painted on the lanes' texture.
  void park(WorldBuilder& builder, const Frame& side, double length) {
    for (double x = kZebra + 3.2; x < length - kZebra - 3.0; x += draws_.uniform(5.8, 6.4)) {
      if (!likely(0.4)) continue;
      const double skew = draws_.uniform(-0.02, 0.02);
      Vec2d along = (side.along + skew * Vec2d(-side.along.y(), side.along.x())).normalized();
      if (likely(0.15)) along = -along;
      try_car(builder, {side(x, -1.1 + draws_.uniform(-0.08, 0.08), 0.0), along}, a_car());
    }
  }

  // Puts cars on the lanes. They drive on the right.
  void add_traffic(WorldBuilder& builder) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      for (const Span& road : roads_[1 - axis]) {
        for (const Span& block : blocks_[axis]) {
          for (const double way : {-1.0, 1.0}) {
            const int cars = likely(0.6) ? 1 + draws_.below(2) : 0;
            double x = draws_.uniform(2.0, 10.0);
            for (int i = 0; i < cars; ++i) {
              const CarKind kind = likely(0.12) ? CarKind::bus : a_car();
              const double half = 0.5 * size_of(kind).length;
              x += half;
              if (x + half + 6.0 > block.length()) break;
              const double along = block.middle() + way * (0.5 * block.length() - x - kZebra);
              // Right of the driving direction: -y when driving along +x.
              const double aside = road.middle() + (axis == 0 ? -way : way) * 1.5;
              const Frame at = axis == 0 ? Frame{{along, aside, 0.0}, {way, 0.0}} : Frame{{aside, along, 0.0}, {0.0, way}};
              try_car(builder, at, kind);
              x += half + draws_.uniform(2.0, 14.0);
            }
          }
        }
      }
    }
  }

  // ---- bridges and cables over the roads

  // Returns the house whose wall faces the road at `along`, on the side given by the sign of `way`, or nullptr if there is
  // none.
  const Built* house_beside(std::size_t axis, const Span& road, double along, double way) const {
    const double wall = way < 0.0 ? road.low - kPavement : road.high + kPavement;
    const auto i = static_cast<Eigen::Index>(axis), k = static_cast<Eigen::Index>(1 - axis);
    for (const Built& house : houses_) {
      const double face = way < 0.0 ? house.lot.high[k] : house.lot.low[k];
      if (std::abs(face - wall) < 0.01 && house.lot.low[i] < along - 0.5 && house.lot.high[i] > along + 0.5) return &house;
    }
    return nullptr;
  }

  // Returns the point on the house wall beside a road, at `along` and height z. The sign of `way` selects the side.
  Vec3d wall_point(std::size_t axis, const Span& road, double along, double way, double z) const {
    const double wall = way < 0.0 ? road.low - kPavement : road.high + kPavement;
    return axis == 0 ? Vec3d(along, wall, z) : Vec3d(wall, along, z);
  }

  void add_bridges(WorldBuilder& builder) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      for (const Span& road : roads_[1 - axis]) {
        for (const Span& block : blocks_[axis]) {
          if (!likely(0.22)) continue;
          const double along = draws_.uniform(block.low + 10.0, block.high - 10.0), z = draws_.uniform(6.4, 8.0);
          const Built *left = house_beside(axis, road, along, -1.0), *right = house_beside(axis, road, along, 1.0);
          if (left == nullptr || right == nullptr || std::min(left->height, right->height) < z + 4.0) continue;
          const Vec3d half = axis == 0 ? Vec3d(1.3, -0.1, 0.0) : Vec3d(-0.1, 1.3, 0.0);
          const Vec3d low = wall_point(axis, road, along, -1.0, z) - half;
          const Vec3d high = wall_point(axis, road, along, 1.0, z + 3.2) + half;
          if (is_clear(low, high)) add_bridge(builder, surfaces_, low, high);
        }
      }
    }
  }

  void add_cables(WorldBuilder& builder) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      for (const Span& road : roads_[1 - axis]) {
        for (const Span& block : blocks_[axis]) {
          const bool has_flags = likely(0.25);  // marks a shopping street
          for (double along = block.low + draws_.uniform(6.0, 10.0); along < block.high - 6.0;
               along += draws_.uniform(5.0, 14.0)) {
            const double z = draws_.uniform(5.0, 8.5), tilt = draws_.uniform(-0.6, 0.6), sag = draws_.uniform(0.4, 0.9);
            const bool has_lamp = likely(0.3);
            const Built *left = house_beside(axis, road, along, -1.0), *right = house_beside(axis, road, along, 1.0);
            if (left == nullptr || right == nullptr || std::min(left->height, right->height) < z + 0.5) continue;
            const Vec3d from = wall_point(axis, road, along, -1.0, z + tilt), to = wall_point(axis, road, along, 1.0, z - tilt);
            const Hung hung = has_flags ? Hung::flags : has_lamp ? Hung::lamp : Hung::nothing;
            const Vec3d lowest(0.0, 0.0, sag + (hung == Hung::nothing ? 0.0 : 0.5)), thick = Vec3d::Constant(0.3);
            // Check the sagging cable in four pieces.
            bool is_free = true;
            for (int i = 0; i < 4 && is_free; ++i) {
              const Vec3d a = from + 0.25 * i * (to - from), b = from + 0.25 * (i + 1) * (to - from);
              is_free = is_clear(a.cwiseMin(b) - lowest - thick, a.cwiseMax(b) + thick);
            }
            if (is_free) add_cable(builder, surfaces_, from, to, sag, hung);
          }
        }
      }
    }
  }

  const CityConfig& config_;
  Draws draws_;
  Noise wander_;
  CitySurfaces surfaces_;
  std::array<std::vector<Span>, 2> roads_, blocks_;  // per axis: intervals along that axis
  std::array<double, 2> size_{};
  std::vector<Vec3d> lane_;
  std::vector<Built> houses_;
};

}  // namespace
}  // namespace flockstep::streets

namespace flockstep {

void CityConfig::validate() const { check_fields(*this, "city: "); }

std::shared_ptr<const World> city(const CityConfig& config) {
  using namespace streets;
  constexpr std::uint32_t kAttempts = 16;
  config.validate();
  const collision::Hull hull(DroneModel::quadrotor650());
  const auto build = [&](std::uint32_t attempt) -> std::shared_ptr<const World> {
    City city(config, attempt);
    auto world = city.built().build();
    if (!is_free_way(*world, hull, city.lane())) return nullptr;
    if (config.traffic == 0) return world;
    Movers movers(*world, Draws::kCity, config.seed, attempt);
    city.drive(*world, movers);
    return world->with_bodies(movers.bodies());
  };
  if (auto world = first_layout(kAttempts, build)) return world;
  std::ostringstream expected;
  expected << "one with a free path through " << config.blocks[0] << " x " << config.blocks[1] << " blocks";
  refuse("city: seed", expected.str(), config.seed);
}

}  // namespace flockstep
