#include <array>
#include <vector>

#include "generators/city_parts.hpp"

namespace flockstep::streets {
namespace {

Vec2d a_turn(Draws& draws) {
  for (;;) {
    const Vec2d way = draws.point(Vec2d::Constant(-1.0), Vec2d::Constant(1.0));
    if (way.norm() > 0.1) return way.normalized();
  }
}

void add_pole(WorldBuilder& builder, const Vec3d& from, const Vec3d& to, double radius, std::uint16_t material) {
  const Vec3d way = to - from;
  builder.cylinder((0.5 * (from + to)).cast<float>(), static_cast<float>(radius), static_cast<float>(way.norm()), material,
                   turned_to(way.normalized()));
}

using Profile = std::vector<std::array<double, 2>>;

}  // namespace

void add_tree(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot, const TreeSize& size, Draws& draws) {
  Thing thing;
  const double radius = 0.013 * size.tall + 0.05, high = size.tall - size.fork;
  const std::size_t kind = static_cast<std::size_t>(draws.uniform(0.0, 1.0) < 0.1 ? 2 : draws.below(2));
  const Vec2d turn = a_turn(draws);
  add_trunk(thing.of(surfaces.bark), foot.head<2>(), foot.z() - 0.1, foot.z() + size.fork + 0.3 * high, radius, 0.6 * radius,
            turn);
  MeshPart& crown = thing.of(surfaces.leaves[kind]);
  const double wide = 0.68 * size.reach;
  const auto add_clump = [&](const Vec3d& out, double half_height) {
    const Vec3d center = foot + Vec3d(0.0, 0.0, size.fork) + out, half(wide, wide, half_height);
    const std::size_t first = crown.vertices.size();
    add_ball(crown, center, half, 3, 0.16, draws);
    for (std::size_t i = first; i < crown.vertices.size(); ++i) {  // octahedral mapping, so the texture covers the ball evenly
      const Vec3d way = (crown.vertices[i].cast<double>() - center).cwiseQuotient(half);
      const double sum = way.cwiseAbs().sum();
      crown.uv[i] = {static_cast<float>(1.3 * wide * way.x() / sum), static_cast<float>(-1.3 * half_height * way.z() / sum)};
    }
  };
  const double out = size.reach - wide;
  add_clump({-0.3 * out * turn.x(), -0.3 * out * turn.y(), 0.66 * high}, 0.34 * high);
  for (const double way : {-1.0, 1.0}) {
    const double up = draws.uniform(0.33, 0.45) * high, half_height = draws.uniform(0.3, 0.36) * high;
    add_clump({way * out * turn.y(), -way * out * turn.x(), up}, half_height);
  }
  thing.into(builder);
}

void add_lamp(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame) {
  add_pole(builder, frame(0.0, 0.0, 0.0), frame(0.0, 0.0, 0.9), 0.13, surfaces.pole);
  add_pole(builder, frame(0.0, 0.0, 0.9), frame(0.0, 0.0, 6.3), 0.065, surfaces.pole);
  add_pole(builder, frame(0.0, 0.06, 6.22), frame(0.0, -1.5, 6.5), 0.04, surfaces.pole);
  Thing thing;
  add_block(thing.of(surfaces.pole), frame, {0.0, -1.6, 6.5}, {0.26, 0.7, 0.1});
  add_block(thing.of(surfaces.lamp), frame, {0.0, -1.62, 6.43}, {0.2, 0.55, 0.06});
  thing.into(builder);
}

void add_traffic_light(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, double arm_m) {
  add_pole(builder, frame(0.0, 0.0, 0.0), frame(0.0, 0.0, 5.7), 0.09, surfaces.pole);
  add_pole(builder, frame(0.0, 0.0, 5.45), frame(0.0, -arm_m, 5.55), 0.05, surfaces.pole);
  Thing thing;
  const auto head = [&](const Vec3d& at) {
    add_block(thing.of(surfaces.pole), frame, at, {0.3, 0.34, 0.95});
    double z = at.z() + 0.29;
    for (const std::uint16_t light : {surfaces.red, surfaces.amber, surfaces.green}) {
      builder.sphere(frame(at.x() - 0.13, at.y(), z).cast<float>(), 0.1F, light);
      z -= 0.29;
    }
  };
  head({0.0, -arm_m + 0.2, 5.25});
  head({-0.25, 0.0, 3.0});
  add_block(thing.of(surfaces.sign), frame, {0.0, -1.0, 5.78}, {0.05, 1.3, 0.32});
  thing.into(builder);
}

void add_bench(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame) {
  Thing thing;
  MeshPart& wood = thing.of(surfaces.wood);
  for (const double y : {-0.12, 0.12}) add_block(wood, frame, {0.0, y, 0.45}, {1.8, 0.2, 0.06});
  add_block(wood, frame, {0.0, 0.29, 0.74}, {1.8, 0.05, 0.3});
  for (const double x : {-0.7, 0.7}) {
    add_block(thing.of(surfaces.bin), frame, {x, 0.0, 0.21}, {0.07, 0.45, 0.42});
  }
  thing.into(builder);
}

void add_hydrant(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame) {
  MeshPart part;
  add_turned(
      part, frame(0.0, 0.0, 0.0),
      Profile{{0.17, 0.0}, {0.17, 0.06}, {0.115, 0.08}, {0.115, 0.5}, {0.15, 0.52}, {0.15, 0.58}, {0.1, 0.68}, {0.0, 0.74}});
  builder.mesh(part, surfaces.hydrant);
  add_pole(builder, frame(-0.2, 0.0, 0.42), frame(0.2, 0.0, 0.42), 0.055, surfaces.hydrant);
}

void add_bin(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame) {
  MeshPart part;
  add_turned(part, frame(0.0, 0.0, 0.0), Profile{{0.2, 0.02}, {0.27, 0.8}, {0.27, 0.86}, {0.0, 0.97}});
  builder.mesh(part, surfaces.bin);
}

void add_planter(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws) {
  Thing thing;
  add_turned(thing.of(surfaces.trim), frame(0.0, 0.0, 0.0),
             Profile{{0.34, 0.0}, {0.46, 0.5}, {0.5, 0.5}, {0.5, 0.58}, {0.0, 0.58}});
  add_ball(thing.of(surfaces.leaves[0]), frame(0.0, 0.0, 0.8), {0.48, 0.48, 0.38}, 2, 0.15, draws);
  thing.into(builder);
}

void add_bus_stop(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame) {
  Thing thing;
  MeshPart& iron = thing.of(surfaces.pole);
  add_block(iron, frame, {0.0, 0.0, 2.5}, {4.2, 1.6, 0.12});
  for (const double x : {-1.9, 0.0, 1.9}) add_block(iron, frame, {x, 0.65, 1.22}, {0.08, 0.08, 2.44});
  MeshPart& panes = thing.of(surfaces.panes);
  add_block(panes, frame, {0.0, 0.68, 1.3}, {3.8, 0.04, 2.0}, 2.0);
  add_block(panes, frame, {-1.9, 0.1, 1.3}, {0.04, 1.1, 2.0}, 2.0);
  add_block(iron, frame, {1.9, 0.1, 1.3}, {0.1, 1.1, 2.1});
  for (const double out : {-0.06, 0.06}) {
    const double turn = out < 0.0 ? 1.0 : -1.0, x = 1.9 + out;
    add_panel(thing.of(surfaces.poster), frame(x, 0.1 + 0.5 * turn, 0.4), frame(x, 0.1 - 0.5 * turn, 0.4),
              frame(x, 0.1 - 0.5 * turn, 2.2), frame(x, 0.1 + 0.5 * turn, 2.2), {0.0, 1.0}, {1.0, 0.0});
  }
  add_block(thing.of(surfaces.wood), frame, {-0.5, 0.42, 0.48}, {2.4, 0.4, 0.06});
  add_block(iron, frame, {-0.5, 0.42, 0.24}, {0.1, 0.3, 0.44});
  thing.into(builder);
}

void add_table(WorldBuilder& builder, const CitySurfaces& surfaces, const Frame& frame, Draws& draws) {
  Thing thing;
  add_turned(thing.of(surfaces.wood), frame(0.0, 0.0, 0.0), Profile{{0.0, 0.7}, {0.38, 0.7}, {0.38, 0.74}, {0.0, 0.74}});
  for (const double x : {-0.75, 0.75}) {
    add_block(thing.of(surfaces.wood), frame, {x, 0.0, 0.44}, {0.42, 0.42, 0.05});
    add_block(thing.of(surfaces.wood), frame, {x > 0.0 ? x + 0.2 : x - 0.2, 0.0, 0.66}, {0.04, 0.42, 0.42});
    add_block(thing.of(surfaces.bin), frame, {x, 0.0, 0.21}, {0.3, 0.3, 0.42});
  }
  const std::uint16_t cloth = surfaces.awnings[static_cast<std::size_t>(draws.below(static_cast<int>(surfaces.awnings.size())))];
  add_turned(thing.of(cloth), frame(0.0, 0.0, 0.0), Profile{{0.0, 2.24}, {1.15, 2.05}, {1.15, 2.1}, {0.0, 2.5}});
  thing.into(builder);
  add_pole(builder, frame(0.0, 0.0, 0.0), frame(0.0, 0.0, 2.4), 0.03, surfaces.pole);
}

void add_fountain(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& foot) {
  Thing thing;
  add_turned(thing.of(surfaces.trim), foot,
             Profile{{3.0, 0.0}, {3.0, 0.16}, {2.1, 0.16}, {2.1, 0.62}, {2.25, 0.62}, {2.25, 0.74}, {1.9, 0.74}, {1.9, 0.5}}, 12);
  add_turned(thing.of(surfaces.water), foot, Profile{{1.95, 0.55}, {0.0, 0.56}}, 12);
  add_turned(
      thing.of(surfaces.trim), foot,
      Profile{{0.5, 0.4}, {0.35, 0.7}, {0.22, 0.9}, {0.2, 1.5}, {0.3, 1.7}, {1.05, 2.0}, {1.1, 2.1}, {0.9, 2.1}, {0.85, 1.95}},
      12);
  add_turned(thing.of(surfaces.water), foot, Profile{{0.9, 2.02}, {0.0, 2.03}}, 12);
  add_turned(thing.of(surfaces.trim), foot,
             Profile{{0.3, 2.0}, {0.14, 2.2}, {0.12, 2.7}, {0.3, 2.9}, {0.32, 3.1}, {0.2, 3.3}, {0.0, 3.38}}, 12);
  thing.into(builder);
}

void add_cable(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& from, const Vec3d& to, double sag_m, Hung hung) {
  constexpr int kPieces = 10;
  std::vector<Vec3d> points;
  for (int i = 0; i <= kPieces; ++i) {
    const double share = static_cast<double>(i) / kPieces;
    points.push_back(from + share * (to - from) - Vec3d(0.0, 0.0, 4.0 * sag_m * share * (1.0 - share)));
  }
  Thing thing;
  add_wire(thing.of(surfaces.cable), points, 0.035);
  if (hung == Hung::flags) {
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      MeshPart& cloth = thing.of(surfaces.awnings[i % surfaces.awnings.size()]);
      for (const double share : {0.2, 0.7}) {
        const Vec3d a = points[i] + share * (points[i + 1] - points[i]),
                    b = points[i] + (share + 0.3) * (points[i + 1] - points[i]);
        const std::int32_t first = add_vertex(cloth, a, 0.25, 0.5);
        add_vertex(cloth, 0.5 * (a + b) - Vec3d(0.0, 0.0, 0.42), 0.25, 0.5);
        add_vertex(cloth, b, 0.25, 0.5);
        add_triangle(cloth, first, first + 1, first + 2);
      }
    }
  }
  thing.into(builder);
  if (hung == Hung::lamp) {
    const Vec3d at = points[kPieces / 2] - Vec3d(0.0, 0.0, 0.25);
    builder.cylinder(at.cast<float>(), 0.28F, 0.18F, surfaces.pole);
    builder.cylinder((at - Vec3d(0.0, 0.0, 0.12)).cast<float>(), 0.2F, 0.1F, surfaces.lamp);
  }
}

void add_bridge(WorldBuilder& builder, const CitySurfaces& surfaces, const Vec3d& low, const Vec3d& high) {
  Thing thing;
  const Vec3d center = 0.5 * (low + high), size = high - low;
  add_block(thing.of(surfaces.panes), center, size - Vec3d(0.02, 0.02, 0.5), Vec2d::UnitX(), size.z() - 0.5);
  for (const double z : {low.z() + 0.2, high.z() - 0.15}) {
    add_block(thing.of(surfaces.trim), {center.x(), center.y(), z}, {size.x(), size.y(), z < center.z() ? 0.4 : 0.3},
              Vec2d::UnitX(), 2.0);
  }
  thing.into(builder);
}

namespace {

// A cross-section of the body: x as a share of the length, bottom and top in m, width as a share of the car's width.
struct Section {
  double x, low, high, wide;
};

struct Window {
  double from, to, low, high;  // from, to: shares of the length; low, high: m
};

struct Shape {
  CarSize size;
  std::vector<Section> body;  // from tail to nose
  // The cabin: the ends of its glass at the bottom and at the top, as shares of the length, and its heights. No cabin if roof
  // is 0.
  double tail_low, tail_high, nose_high, nose_low, belt, roof;
  std::vector<Window> windows;  // in the sides of the body
  std::array<double, 2> axles;
  double wheel;  // m
};

const Shape& shape_of(CarKind kind) {
  static const std::vector<Section> kCar{{-0.5, 0.32, 0.80, 0.86}, {-0.485, 0.22, 0.88, 0.94}, {-0.4, 0.2, 0.94, 1.0},
                                         {0.25, 0.2, 0.91, 1.0},   {0.44, 0.2, 0.78, 0.97},    {0.485, 0.22, 0.72, 0.9},
                                         {0.5, 0.3, 0.64, 0.82}};
  static const Shape kHatchback{{4.0, 1.76, 1.5}, kCar, -0.47, -0.37, 0.09, 0.26, 0.92, 1.5, {}, {-0.31, 0.31}, 0.31};
  static const Shape kSedan{{4.65, 1.82, 1.45}, kCar, -0.36, -0.19, 0.07, 0.24, 0.92, 1.45, {}, {-0.3, 0.31}, 0.33};
  static const Shape kEstate{{4.7, 1.9, 1.7}, kCar, -0.48, -0.42, 0.08, 0.23, 0.93, 1.7, {}, {-0.3, 0.31}, 0.37};
  static const Shape kVan{{5.4, 2.0, 2.35},
                          {{-0.5, 0.35, 2.28, 0.95},
                           {-0.49, 0.25, 2.35, 1.0},
                           {0.2, 0.25, 2.35, 1.0},
                           {0.27, 0.25, 2.22, 1.0},
                           {0.39, 0.25, 1.25, 1.0},
                           {0.48, 0.25, 1.02, 0.96},
                           {0.5, 0.35, 0.85, 0.9}},
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          {{0.14, 0.26, 1.25, 1.9}},
                          {-0.31, 0.33},
                          0.36};
  static const Shape kBus{{10.8, 2.5, 3.05},
                          {{-0.5, 0.4, 2.9, 0.97}, {-0.495, 0.3, 3.05, 1.0}, {0.49, 0.3, 3.05, 1.0}, {0.5, 0.4, 2.9, 0.96}},
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          0.0,
                          {{-0.48, -0.3, 1.25, 2.6},
                           {-0.29, -0.12, 1.25, 2.6},
                           {-0.09, -0.01, 0.5, 2.6},
                           {0.02, 0.19, 1.25, 2.6},
                           {0.2, 0.37, 1.25, 2.6},
                           {0.4, 0.47, 0.5, 2.6}},
                          {-0.27, 0.3},
                          0.48};
  switch (kind) {
    case CarKind::hatchback:
      return kHatchback;
    case CarKind::sedan:
    case CarKind::taxi:
      return kSedan;
    case CarKind::estate:
      return kEstate;
    case CarKind::van:
      return kVan;
    default:
      return kBus;
  }
}

class Car {
  static constexpr double kOut = 0.012;  // m, offset of details from the surface below

 public:
  Car(const Frame& frame, const Shape& shape, int paint)
      : frame_(frame), shape_(shape), paint_(static_cast<int>(CarColor::first_paint) + paint) {}

  MeshPart made() {
    add_body();
    if (shape_.roof > 0.0) add_cabin();
    add_windows();
    for (const double axle : shape_.axles) {
      for (const double side : {-1.0, 1.0}) add_wheel(axle * shape_.size.length, side);
    }
    return part_;
  }

 private:
  static double s_of(int color) { return (color + 0.5) / kCarColors; }
  static double s_of(CarColor color) { return s_of(static_cast<int>(color)); }
  double half_width() const { return 0.5 * shape_.size.width; }

  void quad(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, double s) {
    add_panel(part_, frame_(a.x(), a.y(), a.z()), frame_(b.x(), b.y(), b.z()), frame_(c.x(), c.y(), c.z()),
              frame_(d.x(), d.y(), d.z()), {s, 0.5}, {s, 0.5});
  }
  // Adds a pane of glass. The upper corners c and d are lighter.
  void glass(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const double low = s_of(CarColor::glass_low), high = s_of(CarColor::glass_high);
    const std::int32_t first = add_vertex(part_, frame_(a.x(), a.y(), a.z()), low, 0.5);
    add_vertex(part_, frame_(b.x(), b.y(), b.z()), low, 0.5);
    add_vertex(part_, frame_(c.x(), c.y(), c.z()), high, 0.5);
    add_vertex(part_, frame_(d.x(), d.y(), d.z()), high, 0.5);
    add_triangle(part_, first, first + 1, first + 2);
    add_triangle(part_, first, first + 2, first + 3);
  }

  // Returns the outline of a section from the right side over the top to the left side.
  std::array<Vec3d, 8> ring(const Section& at) const {
    const double x = at.x * shape_.size.length, wide = at.wide * half_width();
    const double shoulder = at.high - 0.25 * (at.high - at.low), sill = at.low + 0.12;
    return {{{x, -0.9 * wide, at.low},
             {x, -wide, sill},
             {x, -wide, shoulder},
             {x, -0.9 * wide, at.high},
             {x, 0.9 * wide, at.high},
             {x, wide, shoulder},
             {x, wide, sill},
             {x, 0.9 * wide, at.low}}};
  }

  void add_body() {
    const double paint = s_of(paint_), plastic = s_of(CarColor::plastic);
    for (std::size_t i = 0; i + 1 < shape_.body.size(); ++i) {
      const auto back = ring(shape_.body[i]), front = ring(shape_.body[i + 1]);
      for (std::size_t k = 0; k < 7; ++k) quad(back[k], front[k], front[k + 1], back[k + 1], k == 0 || k == 6 ? plastic : paint);
    }
    const auto tail = ring(shape_.body.front()), nose = ring(shape_.body.back());
    for (std::size_t k = 0; k < 3; ++k) {  // from one sill to the other, in slices
      quad(nose[k], nose[7 - k], nose[6 - k], nose[k + 1], k == 0 ? plastic : paint);
      quad(tail[7 - k], tail[k], tail[k + 1], tail[6 - k], k == 0 ? plastic : paint);
    }
    const double end = 0.5 * shape_.size.length + kOut, wide = half_width();
    const Section &front = shape_.body.back(), &rear = shape_.body.front();
    for (const double side : {-1.0, 1.0}) {
      const double inner = side * 0.48 * wide, outer = side * 0.8 * wide;
      const double left = std::max(inner, outer), right = std::min(inner, outer);
      const double low = mixed_height(front, 0.45), high = mixed_height(front, 0.75);
      quad({end, right, low}, {end, left, low}, {end, left, high}, {end, right, high}, s_of(CarColor::head));
      const double below = mixed_height(rear, 0.45), above = mixed_height(rear, 0.74);
      quad({-end, left, below}, {-end, right, below}, {-end, right, above}, {-end, left, above}, s_of(CarColor::tail));
    }
  }
  static double mixed_height(const Section& at, double share) { return at.low + share * std::min(at.high - at.low, 0.8); }

  // Adds a window inside the quad with lower corners a, b and upper corners c, d, as seen from outside. left, right, low and
  // high are shares of its width and height.
  void inlaid(const std::array<Vec3d, 4>& corners, double left, double right, double low, double high) {
    const Vec3d &a = corners[0], &b = corners[1], &c = corners[2], &d = corners[3];
    const Vec3d out = kOut * (b - a).cross(d - a).normalized();
    const auto at = [&](double u, double v) -> Vec3d { return (1.0 - v) * (a + u * (b - a)) + v * (d + u * (c - d)) + out; };
    glass(at(left, low), at(right, low), at(right, high), at(left, high));
  }

  void add_cabin() {
    const double length = shape_.size.length, paint = s_of(paint_);
    const double wide = 0.9 * half_width(), narrow = 0.7 * half_width(), low = shape_.belt - 0.06, high = shape_.roof;
    const double back = shape_.tail_low * length, back_top = shape_.tail_high * length;
    const double front = shape_.nose_low * length, front_top = shape_.nose_high * length;
    const std::array<Vec3d, 4> nose{
        {{front, -wide, low}, {front, wide, low}, {front_top, narrow, high}, {front_top, -narrow, high}}};
    const std::array<Vec3d, 4> tail{{{back, wide, low}, {back, -wide, low}, {back_top, -narrow, high}, {back_top, narrow, high}}};
    const std::array<Vec3d, 4> right{
        {{back, -wide, low}, {front, -wide, low}, {front_top, -narrow, high}, {back_top, -narrow, high}}};
    const std::array<Vec3d, 4> left{{{front, wide, low}, {back, wide, low}, {back_top, narrow, high}, {front_top, narrow, high}}};
    for (const auto* side : {&nose, &tail, &right, &left}) quad((*side)[0], (*side)[1], (*side)[2], (*side)[3], paint);
    const double crown = high + 0.04, inner = 0.62 * half_width();  // slightly domed roof
    const double inset = 0.06 * length;
    const Vec3d a{back_top + inset, -inner, crown}, b{front_top - inset, -inner, crown}, c{front_top - inset, inner, crown},
        d{back_top + inset, inner, crown};
    quad(a, b, c, d, paint);
    quad(right[3], right[2], b, a, paint);
    quad(nose[3], nose[2], c, b, paint);
    quad(left[3], left[2], d, c, paint);
    quad(tail[3], tail[2], a, d, paint);
    inlaid(nose, 0.06, 0.94, 0.12, 0.94);
    inlaid(tail, 0.08, 0.92, 0.2, 0.9);
    inlaid(right, 0.08, 0.47, 0.16, 0.88);
    inlaid(right, 0.51, 0.92, 0.16, 0.88);
    inlaid(left, 0.08, 0.49, 0.16, 0.88);
    inlaid(left, 0.53, 0.92, 0.16, 0.88);
  }

  void add_windows() {
    const double length = shape_.size.length, wide = half_width() + kOut;
    for (const auto& [from, to, low, high] : shape_.windows) {
      const double a = from * length, b = to * length;
      glass({a, -wide, low}, {b, -wide, low}, {b, -wide, high}, {a, -wide, high});
      glass({b, wide, low}, {a, wide, low}, {a, wide, high}, {b, wide, high});
    }
    if (shape_.windows.size() == 1) {  // van: the windscreen is part of the body
      const Section &above = shape_.body[3], &below = shape_.body[4];
      const auto top = ring(above), foot = ring(below);
      inlaid({foot[3], foot[4], top[4], top[3]}, 0.05, 0.95, 0.08, 0.95);
    } else if (!shape_.windows.empty()) {
      const double end = 0.5 * length + kOut, half = 0.85 * half_width();
      glass({end, -half, 1.2}, {end, half, 1.2}, {end, half, 2.6}, {end, -half, 2.6});
      glass({-end, half, 1.6}, {-end, -half, 1.6}, {-end, -half, 2.5}, {-end, half, 2.5});
    }
  }

  // Adds a disc that faces outwards, or its upper half.
  void add_face(double x, double y, double side, double radius, double s, int sides, bool is_half = false) {
    const std::span<const Vec2d> ring = circle(sides);
    const std::int32_t middle = add_vertex(part_, frame_(x, y, shape_.wheel), s, 0.5);
    const std::size_t steps = is_half ? ring.size() / 2 : ring.size();
    for (std::size_t i = 0; i <= steps; ++i) {
      const Vec2d at = radius * ring[i % ring.size()];
      add_vertex(part_, frame_(x + at.x(), y, shape_.wheel + at.y()), s, 0.5);
      if (i == 0) continue;
      const auto here = middle + 1 + static_cast<std::int32_t>(i);
      side < 0.0 ? add_triangle(part_, middle, here - 1, here) : add_triangle(part_, middle, here, here - 1);
    }
  }

  void add_wheel(double x, double side) {
    const double y = side * half_width(), radius = shape_.wheel, tyre = s_of(CarColor::tyre);
    add_face(x, y + side * kOut, side, 1.22 * radius, tyre, 8, true);
    add_face(x, y + 2.0 * side * kOut, side, radius, s_of(CarColor::plastic), 12);
    add_face(x, y + 3.0 * side * kOut, side, 0.62 * radius, s_of(CarColor::hub), 8);
    const double inner = y - side * 0.22, outer = y + 2.0 * side * kOut;
    for (std::size_t i = 4; i < 8; ++i) {  // visible part of the tread
      const Vec2d from = radius * circle(8)[i], to = radius * circle(8)[(i + 1) % 8];
      const Vec3d a{x + from.x(), inner, radius + from.y()}, b{x + from.x(), outer, radius + from.y()};
      const Vec3d c{x + to.x(), outer, radius + to.y()}, d{x + to.x(), inner, radius + to.y()};
      side < 0.0 ? quad(b, a, d, c, tyre) : quad(a, b, c, d, tyre);
    }
  }

  const Frame& frame_;
  const Shape& shape_;
  int paint_;
  MeshPart part_;
};

}  // namespace

CarSize size_of(CarKind kind) { return shape_of(kind).size; }

void add_car(WorldBuilder& builder, std::uint16_t material, const Frame& frame, CarKind kind, Draws& draws) {
  constexpr int kTaxi = 5, kBus = 3;
  const int paint = kind == CarKind::taxi ? kTaxi : kind == CarKind::bus ? kBus : draws.below(kCarPaints);
  builder.mesh(Car(frame, shape_of(kind), paint).made(), material);
}

std::shared_ptr<const World> moving_car(const World& city, std::uint16_t material, CarKind kind, Draws& draws) {
  WorldBuilder builder("car");
  Material paint = city.materials()[material];
  if (paint.texture) paint.texture = builder.texture(city.textures()[*paint.texture]);
  add_car(builder, builder.material(paint), Frame{Vec3d::Zero(), Vec2d(1.0, 0.0)}, kind, draws);
  return builder.build();
}

}  // namespace flockstep::streets
