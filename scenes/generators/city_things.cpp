#include "generators/city_things.hpp"

#include <array>
#include <cmath>
#include <vector>

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

}  // namespace flockstep::streets
