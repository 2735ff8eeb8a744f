// Bodies of worlds: their checks, their files, and the copies of a world that keep them.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/packed_fields.hpp"
#include "batch_helpers.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "flockstep/world_builder.hpp"
#include "refusal.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// Bodies with a value apart from the default in every field.
std::vector<BodyConfig> three_bodies() {
  std::vector<BodyConfig> bodies(3);
  BodyConfig& all = bodies[0];
  all = {.name = "all",
         .shape = BodyShape::capsule,
         .size_m = {0.5F, 0.5F, 1.7F},
         .position_m = {1.1F, 2.2F, -3.3F},
         .quat_wxyz = {0.5F, -0.5F, 0.5F, 0.5F},
         .color = {0.1F, 0.2F, 0.3F},
         .semantic = 77,
         .visibility = Visibility::solid};
  all.motion = {.kind = BodyMotionKind::waypoints,
                .velocity_mps = {1.5F, -0.0F, 2.5F},
                .turn_rate_dps = {10.1F, 20.0F, 30.0F},
                .points_m = {{1, 2, 3}, {4, 5.5F, 6}, {-7, 8, 1.0F / 3.0F}},
                .route = BodyRoute::back_and_forth,
                .speed_mps = 2.5F,
                .corner_radius_m = 0.7F,
                .faces_travel = true,
                .center_m = {3, 2, 1},
                .axis = {0, 1, 1},
                .period_s = 7.7F,
                .angle_deg = -30.0F,
                .travel_m = {1, 0, 2},
                .box_min_m = {-1, -2, -3},
                .box_max_m = {1, 2, 3},
                .phase = 0.25F,
                .random_phase = true,
                .speed_spread = 0.5F};
  bodies[1].shape = BodyShape::sphere;
  bodies[1].motion.kind = BodyMotionKind::orbit;
  return bodies;
}

std::string packed(std::span<const BodyConfig> bodies) {
  FieldPacker packer;
  for (const BodyConfig& body : bodies) packer.add(body);
  return packer.bytes();
}

std::shared_ptr<const World> world_with(std::vector<BodyConfig> bodies) {
  return testing::closet()->with_bodies(std::move(bodies));
}

TEST(WorldBodies, AreKeptInOrder) {
  const auto world = world_with(three_bodies());
  EXPECT_EQ(packed(world->bodies()), packed(three_bodies()));
  EXPECT_EQ(world->with_bodies({})->content_hash(), testing::closet()->content_hash());
}

TEST(WorldBodies, AreNoGeometry) {
  const auto world = world_with(three_bodies());
  EXPECT_EQ(world->bounds().min, testing::closet()->bounds().min);
  EXPECT_EQ(world->bounds().max, testing::closet()->bounds().max);
  EXPECT_EQ(world->primitives().size(), testing::closet()->primitives().size());
  SceneDescription empty;
  empty.bodies = three_bodies();
  EXPECT_EQ(testing::refusal([&] { World world_of_bodies(empty); }),
            "scene: expected at least one primitive or triangle, got an empty scene");
}

TEST(WorldBodies, CopiesOfAWorldKeepThem) {
  const auto world = world_with(three_bodies());
  Lighting lighting{.light = world->light()};
  lighting.light.gamma = 1.5F;
  const auto relit = std::make_shared<const World>(world, lighting);
  const auto marked = relit->with_markers({.start = Vec3(1, 1, 1)});
  const auto changed = relit->with_bodies({BodyConfig()});
  EXPECT_EQ(packed(relit->bodies()), packed(three_bodies()));
  EXPECT_EQ(packed(marked->bodies()), packed(three_bodies()));
  EXPECT_EQ(changed->bodies().size(), 1U);
  EXPECT_EQ(changed->light().gamma, 1.5F);
}

TEST(WorldBodies, ABuilderAddsThem) {
  WorldBuilder builder;
  builder.box(Vec3::Zero(), Vec3::Ones(), builder.material({"white"}));
  for (const BodyConfig& body : three_bodies()) builder.body(body);
  EXPECT_EQ(packed(builder.build()->bodies()), packed(three_bodies()));
}

TEST(WorldBodies, EveryFormatBringsThemBack) {
  const auto world = world_with(three_bodies());
  const auto folder = std::filesystem::path(::testing::TempDir()) / "world_bodies";
  std::filesystem::create_directories(folder);
  std::vector<std::shared_ptr<const World>> again{World::from_json(world->to_json()), World::from_bytes(world->to_bytes())};
  for (const char* name : {"bodies.json", "bodies.glb", "bodies.gltf"}) {
    world->save(folder / name);
    again.push_back(World::load(folder / name));
  }
  for (const auto& other : again) {
    EXPECT_EQ(packed(other->bodies()), packed(three_bodies()));
    EXPECT_EQ(other->content_hash(), world->content_hash());
    EXPECT_EQ(other->to_json(), world->to_json());
  }
  std::filesystem::remove_all(folder);
}

TEST(WorldBodies, EveryFieldIsPartOfTheHash) {
  SceneDescription scene;
  scene.primitives = {{}};
  std::set<std::uint64_t> hashes{content_hash(scene)};
  scene.bodies = three_bodies();
  EXPECT_TRUE(hashes.insert(content_hash(scene)).second);
  const auto change = [&](const char* what, const std::function<void(BodyConfig&)>& by) {
    scene.bodies = three_bodies();
    by(scene.bodies[1]);
    EXPECT_TRUE(hashes.insert(content_hash(scene)).second) << what;
  };
  change("name", [](BodyConfig& body) { body.name = "other"; });
  change("shape", [](BodyConfig& body) { body.shape = BodyShape::box; });
  change("position_m", [](BodyConfig& body) { body.position_m[2] = 1.0F; });
  change("color", [](BodyConfig& body) { body.color[0] = 0.0F; });
  change("visibility", [](BodyConfig& body) { body.visibility = Visibility::visual; });
  change("motion.kind", [](BodyConfig& body) { body.motion.kind = BodyMotionKind::hinge; });
  change("motion.points_m", [](BodyConfig& body) { body.motion.points_m = {{0, 0, 0}}; });
  change("motion.random_phase", [](BodyConfig& body) { body.motion.random_phase = true; });
  scene.bodies = three_bodies();
  std::swap(scene.bodies[1], scene.bodies[2]);
  EXPECT_TRUE(hashes.insert(content_hash(scene)).second);
}

TEST(WorldBodies, RotationsAreNormalised) {
  std::vector<BodyConfig> bodies(1);
  bodies[0].quat_wxyz = {1.0005F, 0.0F, 0.0F, 0.0F};
  EXPECT_EQ(world_with(bodies)->bodies()[0].quat_wxyz[0], 1.0F);
}

TEST(WorldBodies, BadOnesAreNamed) {
  const auto message = [](const std::function<void(BodyConfig&)>& by) {
    std::vector<BodyConfig> bodies(3);
    by(bodies[2]);
    return testing::refusal([&] { world_with(bodies); });
  };
  EXPECT_EQ(message([](BodyConfig& body) { body.motion.period_s = 0.0F; }).rfind("bodies[2].motion.period_s: expected ", 0), 0U);
  EXPECT_EQ(message([](BodyConfig& body) { body.size_m[1] = -1.0F; }).rfind("bodies[2].size_m[1]: expected ", 0), 0U);
  EXPECT_EQ(message([](BodyConfig& body) { body.motion.kind = BodyMotionKind::waypoints; }),
            "bodies[2].motion.points_m: expected at least two points for \"waypoints\", got 0");
  EXPECT_EQ(testing::refusal([] { world_with(std::vector<BodyConfig>(kMaxBodies + 1)); }),
            "bodies: expected at most 4096 of them, got 4097");
}

std::shared_ptr<const World> scene_with(const std::string& bodies) {
  return World::from_json(R"({"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [9, 9, 9]}, "bodies": )" + bodies + "}");
}

TEST(WorldBodies, AFileNeedsOnlyFieldsThatDifferFromTheDefaults) {
  const auto world = scene_with(R"([{}, {"shape": "sphere", "motion": {"kind": "slider", "travel_m": [1, 2, 3]}}])");
  EXPECT_EQ(packed(world->bodies().first(1)), packed(std::vector<BodyConfig>(1)));
  BodyConfig second;
  second.shape = BodyShape::sphere;
  second.motion.kind = BodyMotionKind::slider;
  second.motion.travel_m = {1, 2, 3};
  EXPECT_EQ(packed(world->bodies().last(1)), packed({&second, 1}));
  EXPECT_NE(world->to_json().find(R"({"shape":"sphere","motion":{"kind":"slider","travel_m":[1.0,2.0,3.0]}})"), std::string::npos)
      << world->to_json();
}

TEST(WorldBodies, BadFilesAreRefused) {
  const auto message = [](const std::string& bodies) { return testing::refusal([&] { scene_with(bodies); }); };
  EXPECT_EQ(message("{}"), "scene: /bodies: expected an array, got {}");
  EXPECT_EQ(message("[{}, 3]"), "scene: bodies[1]: expected an object, got 3");
  EXPECT_EQ(message(R"([{"motion": {"period_s": "x"}}])").rfind("scene: bodies[0].motion.period_s: expected a number", 0), 0U);
  EXPECT_EQ(message(R"([{"motion": {"period_s": 0}}])").rfind("scene: bodies[0].motion.period_s: expected a", 0), 0U);
  EXPECT_EQ(message(R"([{"shape": "cube"}])"),
            "scene: bodies[0].shape: expected one of box, cylinder, sphere, capsule, mesh, got cube");
  const std::string unknown = message(R"([{"motoin": {}}])");
  EXPECT_EQ(unknown.rfind("scene: bodies[0].motoin: expected one of name, shape, ", 0), 0U) << unknown;
  EXPECT_NE(unknown.find("id you mean"), std::string::npos) << unknown;
  EXPECT_EQ(message(R"([{"motion": {"kind": "orbit", "axis": [0, 0, 0]}}])"),
            "bodies[0].motion.axis: expected a direction of a length of at least 1e-06, got 0");
}

TEST(WorldBodies, ArePlacedWithTheirWorld) {
  const auto world = world_with(three_bodies());
  const auto folder = std::filesystem::path(::testing::TempDir()) / "placed_bodies";
  std::filesystem::create_directories(folder);
  for (const char* name : {"bodies.json", "bodies.glb"}) {
    world->save(folder / name);
    const auto twice = World::load(folder / name, {.scale = 2.0, .origin = {10, 20, 30}});
    const BodyConfig &before = world->bodies()[0], &after = twice->bodies()[0];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float origin = 10.0F * static_cast<float>(axis + 1);
      EXPECT_FLOAT_EQ(after.size_m[axis], 2.0F * before.size_m[axis]);
      EXPECT_FLOAT_EQ(after.position_m[axis], 2.0F * before.position_m[axis] + origin);
      EXPECT_FLOAT_EQ(after.motion.points_m[2][axis], 2.0F * before.motion.points_m[2][axis] + origin);
      EXPECT_FLOAT_EQ(after.motion.box_max_m[axis], 2.0F * before.motion.box_max_m[axis] + origin);
      EXPECT_FLOAT_EQ(after.motion.travel_m[axis], 2.0F * before.motion.travel_m[axis]);
      EXPECT_FLOAT_EQ(after.motion.velocity_mps[axis], 2.0F * before.motion.velocity_mps[axis]);
      EXPECT_FLOAT_EQ(after.motion.axis[axis], before.motion.axis[axis]);
    }
    EXPECT_EQ(after.motion.speed_mps, 5.0F);
    EXPECT_EQ(after.motion.period_s, before.motion.period_s);
    EXPECT_EQ(after.quat_wxyz, before.quat_wxyz);
  }
  world->save(folder / "bodies.json");
  const BodyConfig turned = World::load(folder / "bodies.json", {.up = UpAxis::y})->bodies()[0];  // (x, y, z) becomes (x, -z, y)
  EXPECT_EQ(turned.position_m, (std::array{1.1F, 3.3F, 2.2F}));
  EXPECT_EQ(turned.motion.box_min_m, (std::array{-1.0F, -3.0F, -2.0F}));
  EXPECT_EQ(turned.motion.box_max_m, (std::array{1.0F, 3.0F, 2.0F}));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace flockstep
