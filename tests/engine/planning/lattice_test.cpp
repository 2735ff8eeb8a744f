#include "planning/lattice.hpp"

#include <gtest/gtest.h>

#include <random>

namespace flockstep {
namespace {

// A room with obstacles of every kind, tilted and level.
World clutter(unsigned seed) {
  std::mt19937 random(seed);
  const auto draw = [&random](float low, float high) { return std::uniform_real_distribution<float>(low, high)(random); };
  const auto place = [&] { return Vec3(draw(0, 8), draw(0, 6), draw(0, 3)); };
  SceneDescription scene;
  scene.primitives.push_back({.kind = PrimitiveKind::room, .center = {4, 3, 1.5F}, .half_extents = {4, 3, 1.5F}});
  for (const PrimitiveKind kind : {PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::capsule, PrimitiveKind::sphere}) {
    for (int i = 0; i < 5; ++i) {
      const float radius = draw(0.05F, 0.3F);
      Vec3 half(radius, radius, kind == PrimitiveKind::sphere ? radius : radius + draw(0.0F, 0.5F));
      if (kind == PrimitiveKind::box) half.y() = draw(0.05F, 0.5F);
      const bool is_turned = i % 2 == 0 && kind != PrimitiveKind::sphere;
      const Quat turned = Quat(draw(-1, 1), draw(-1, 1), draw(-1, 1), draw(-1, 1)).normalized();
      scene.primitives.push_back(
          {.kind = kind, .center = place(), .rotation = is_turned ? turned : Quat::Identity(), .half_extents = half});
    }
  }
  for (std::int32_t i = 0; i < 60; i += 3) {
    const Vec3 corner = place();
    for (int j = 0; j < 3; ++j) scene.mesh.vertices.push_back(corner + Vec3(draw(-1, 1), draw(-1, 1), draw(-1, 1)));
    scene.mesh.triangles.push_back({i, i + 1, i + 2});
  }
  return World(std::move(scene));
}

TEST(Lattice, AgreesWithTheSweepOnFreeSpace) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const World world = clutter(seed);
    const FreeSpace space(world, DroneModel::quadrotor650());
    std::mt19937 random(seed);
    const auto place = [&random] {
      const auto draw = [&random](float most) { return std::uniform_real_distribution<float>(-0.2F, most + 0.2F)(random); };
      return Vec3(draw(8), draw(6), draw(3));
    };
    for (const float cell : {0.1F, 0.3F, 1.0F}) {
      Lattice lattice(space, world.bounds(), {4, 3, 1.5F}, {1, 1, 1}, cell, false);
      int clear = 0;
      for (int i = 0; i < 1000; ++i) {
        const Vec3 from = place();
        const Vec3 to = i % 3 == 0 ? from : Vec3(from + (i % 3 == 1 ? 0.2F : 1.0F) * (place() - from));
        const bool expected = from == to ? space.is_free(from) : space.is_free_leg(from, to);
        EXPECT_EQ(lattice.is_clear(from, to), expected) << from.transpose() << " to " << to.transpose() << ", cell " << cell;
        clear += static_cast<int>(expected);
      }
      EXPECT_GT(clear, 50);
      EXPECT_LT(clear, 950);
    }
  }
}

TEST(Lattice, NodesAreMultiplesOfTheCellFromTheStart) {
  const World world = clutter(1);
  const FreeSpace space(world, DroneModel::quadrotor650());
  const Vec3 start(2, 3, 1);
  const Vec3 goal(7.13F, 3.2F, 1.4F);
  Lattice lattice(space, world.bounds(), start, goal, 0.25F, false);
  EXPECT_EQ(lattice.position(lattice.start()), start);
  EXPECT_EQ(lattice.position(Lattice::kGoal), goal);
  int count = 0;
  lattice.for_each_neighbour(lattice.start(), [&](std::int32_t node) {
    const Vec3 away = lattice.position(node) - start;
    EXPECT_FLOAT_EQ(away.lpNorm<Eigen::Infinity>(), 0.25F);
    ++count;
  });
  EXPECT_EQ(count, 26);
  // The goal and the nodes around its nearest node are neighbours, in both directions.
  count = 0;
  lattice.for_each_neighbour(Lattice::kGoal, [&](std::int32_t node) {
    bool back = false;
    lattice.for_each_neighbour(node, [&](std::int32_t neighbour) { back |= neighbour == Lattice::kGoal; });
    EXPECT_TRUE(back);
    ++count;
  });
  EXPECT_EQ(count, 27);
}

}  // namespace
}  // namespace flockstep
