// Worlds that are generated with bodies: none ever touches the static world, except the floor under wheels, and the static world
// is that without bodies.
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "bodies/body_script.hpp"
#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/scenes.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

// The corners of a box around a body.
DroneModel box_around(const BodyConfig& body) {
  std::vector<Vec3> corners;
  if (body.mesh) {
    constexpr float kAboveFloor = 0.05F;  // m
    Aabb box = body.mesh->bounds();
    box.min.z() += kAboveFloor;
    for (int i = 0; i < 8; ++i) {
      corners.emplace_back((i & 1 ? box.max : box.min).x(), (i & 2 ? box.max : box.min).y(), (i & 4 ? box.max : box.min).z());
    }
    return DroneModel(corners);
  }
  const Vec3 half = 0.5F * Vec3(body.size_m[0], body.size_m[1], body.size_m[2]);
  const float round = body.shape == BodyShape::box ? 1.0F : 0.70F;  // inside of a cylinder
  for (int i = 0; i < 8; ++i) {
    corners.emplace_back((i & 1 ? round : -round) * half.x(), (i & 2 ? round : -round) * half.y(), (i & 4 ? 1 : -1) * half.z());
  }
  return DroneModel(corners);
}

void expect_free_ways(const World& world) {
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  for (const BodyConfig& body : world.bodies()) {
    SCOPED_TRACE(world.name() + ", " + body.name);
    const bodies::BodyScript script(body);
    EXPECT_TRUE(script.moves() || body.name == "door");  // some stay open
    const collision::Hull hull(box_around(body));
    for (std::int64_t episode = 0; episode < 3; ++episode) {
      for (int i = 0; i < 300; ++i) {
        const bodies::Moment moment = script.at(0.37 * i, {.seed = 5, .episode = episode});
        ASSERT_FALSE(collision::overlaps(obstacles, hull, moment.pose)) << moment.pose.position.transpose();
      }
    }
  }
}

TEST(Movers, NeverTouchTheStaticWorld) {
  for (const char* name : {"living_playground/seed-1", "living_playground/seed-2", "living_playground/seed-3",
                           "living_warehouse/seed-1", "living_office/seed-1", "living_office/seed-2", "living_city/seed-1"}) {
    const auto world = load_scene(name, {});
    EXPECT_GE(world->bodies().size(), 3U) << name;
    expect_free_ways(*world);
  }
}

TEST(Movers, LeaveTheStaticWorldUnchanged) {
  EXPECT_EQ(playground({.seed = 4, .movers = 5})->with_bodies({})->content_hash(), playground({.seed = 4})->content_hash());
  EXPECT_EQ(warehouse({.seed = 4, .forklifts = 3})->with_bodies({})->content_hash(), warehouse({.seed = 4})->content_hash());
  // An office with people has doors that move instead of leaves that stand open.
  const auto still = office({.seed = 4}), living = office({.seed = 4, .walkers = 4});
  EXPECT_EQ(living->primitives().size(), still->primitives().size());
  EXPECT_LT(living->triangles().triangles.size(), still->triangles().triangles.size());
  EXPECT_TRUE(living->bounds().min == still->bounds().min && living->bounds().max == still->bounds().max);
}

TEST(Movers, TheSameSeedGivesTheSameBodies) {
  const auto a = playground({.seed = 9, .movers = 5}), b = playground({.seed = 9, .movers = 5});
  EXPECT_EQ(a->bodies().size(), 5U);
  EXPECT_EQ(a->content_hash(), b->content_hash());
  EXPECT_NE(a->content_hash(), playground({.seed = 9, .movers = 4})->content_hash());
}

TEST(Movers, LeaveRoomForTheStart) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto world = playground({.seed = seed, .movers = 8});
    const Vec3 start = *world->markers().start;
    for (const BodyConfig& body : world->bodies()) {
      const bodies::BodyScript script(body);
      for (int i = 0; i < 100; ++i) {
        const Vec3 position = script.at(0.31 * i, {.seed = seed}).pose.position;
        ASSERT_GT((position - start).head<2>().norm(), 1.0F) << seed;
      }
    }
  }
}

}  // namespace
}  // namespace flockstep
