#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/raycast.hpp"
#include "flockstep/world.hpp"
#include "flockstep/world_builder.hpp"
#include "formats/scene_json.hpp"
#include "refusal.hpp"

namespace flockstep {
namespace {

const Quat kAskew = Quat(0.9F, 0.1F, -0.3F, 0.4F).normalized();

// A hall with a square and a ring, both askew.
SceneDescription hall() {
  SceneDescription scene;
  scene.name = "hall";
  scene.materials = {{"wall", {0.8F, 0.8F, 0.8F}}, {"gate", {0.9F, 0.3F, 0.1F}}};
  scene.primitives = {{.kind = PrimitiveKind::room, .center = {0, 0, 5}, .half_extents = {10, 10, 5}},
                      {.kind = PrimitiveKind::box, .center = {8, 8, 1}, .half_extents = {1, 1, 1}},
                      {.kind = PrimitiveKind::capsule, .center = {-8, 8, 2}, .half_extents = {0.5F, 0.5F, 2}}};
  scene.gates = {{.center = {3, 1, 4}, .rotation = kAskew, .size = 1.6F, .bar = 0.2F, .material = 1},
                 {.shape = GateShape::ring, .center = {-3, -2, 5}, .rotation = kAskew.conjugate(), .material = 1}};
  return scene;
}

// Distances along rays that leave the gate's plane from 1 m before it, at places of its opening, parallel to its normal.
std::vector<float> through(const World& world, const Gate& gate, const std::vector<Eigen::Vector2f>& places) {
  std::vector<float> origins, directions;
  for (const auto& place : places) {
    const Vec3 origin = gate.center + gate.rotation * Vec3(-1.0F, place.x(), place.y());
    const Vec3 direction = gate.rotation * Vec3::UnitX();
    origins.insert(origins.end(), origin.data(), origin.data() + 3);
    directions.insert(directions.end(), direction.data(), direction.data() + 3);
  }
  return raycast(world, origins, directions, 2.0F).t_hit;
}

std::vector<Eigen::Vector2f> around(float radius, int count) {
  std::vector<Eigen::Vector2f> places;
  for (int i = 0; i < count; ++i) {
    const float angle = 6.2831853F * static_cast<float>(i) / static_cast<float>(count);
    places.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
  }
  return places;
}

TEST(Gate, TheOpeningIsFreeAndTheFrameClosesRoundIt) {
  const World world(hall());
  const Gate &square = world.gates()[0], &ring = world.gates()[1];
  const float half = square.size / 2, inside = ring.size / 2;
  std::vector<Eigen::Vector2f> free, solid;
  for (const float a : {-0.99F, -0.3F, 0.5F, 0.99F}) {
    for (const float b : {-0.99F, 0.99F}) {
      free.emplace_back(a * half, b * half);
      free.emplace_back(b * half, a * half);
      const float beyond = std::copysign(half + 0.5F * square.bar, b);
      solid.emplace_back(a * half, beyond);
      solid.emplace_back(beyond, a * half);
      solid.emplace_back(beyond, beyond);  // the corners
    }
  }
  for (const float t : through(world, square, free)) EXPECT_TRUE(std::isinf(t)) << t;
  for (const float t : through(world, square, solid)) EXPECT_NEAR(t, 1.0F - square.bar / 2, 1e-4F);
  for (const float t : through(world, ring, around(0.999F * inside, 97))) EXPECT_TRUE(std::isinf(t)) << t;
  // The axes of the bars are a polygon: their middles are half a bar from the opening, their ends 2 % farther out.
  for (const float t : through(world, ring, around(inside + 0.6F * ring.bar, 97))) EXPECT_LE(t, 1.0F);
  for (const float t : through(world, ring, around(1.03F * (inside + 1.5F * ring.bar), 97))) EXPECT_TRUE(std::isinf(t)) << t;
}

TEST(Gate, BarsAreAmongThePrimitivesByKind) {
  const World world(hall());
  const auto all = world.primitives();
  ASSERT_EQ(all.size(), 3 + 4 + kRingBars);
  EXPECT_TRUE(std::ranges::is_sorted(all, {}, &Primitive::kind));
  EXPECT_EQ(all[1].center, Vec3(8, 8, 1)) << "other boxes come first";
  for (std::size_t i = 2; i < 6; ++i) EXPECT_EQ(all[i].material, 1);
  EXPECT_EQ(all[6].center, Vec3(-8, 8, 2));
  EXPECT_EQ(world.mesh().objects.empty(), false);
  EXPECT_EQ(World(SceneDescription{.gates = {Gate{}}}).primitives().size(), 4U) << "a gate alone is a world";
}

TEST(Gate, BoundsContainTheFrame) {
  SceneDescription scene;
  scene.gates = {{.center = {1, 2, 3}, .size = 2.0F, .bar = 0.5F}};
  const Aabb bounds = World(scene).bounds();
  EXPECT_EQ(bounds.min, Vec3(0.75F, 0.5F, 1.5F));
  EXPECT_EQ(bounds.max, Vec3(1.25F, 3.5F, 4.5F));
}

TEST(Gate, DronesTouchTheFrameAndFlyThroughTheOpening) {
  SceneDescription scene = hall();
  scene.gates[0].rotation = Quat::Identity();
  const auto flies = [&](Visibility visibility, float aside) {
    scene.gates[0].visibility = visibility;
    Batch batch({.num_envs = 1}, {std::make_shared<const World>(scene)});
    batch.set_pose(std::vector<float>{1, 1 + aside, 4}, std::vector<float>{1, 0, 0, 0});
    batch.move(std::vector<float>{5, 1 + aside, 4}, {});
    return batch.state().contact.hit[0] == 0;
  };
  EXPECT_TRUE(flies(Visibility::full, 0.0F));
  EXPECT_FALSE(flies(Visibility::full, 0.9F));
  EXPECT_FALSE(flies(Visibility::solid, 0.9F));
  EXPECT_TRUE(flies(Visibility::visual, 0.9F));
}

TEST(Gate, ScenesRoundTripThroughBothFormats) {
  SceneDescription scene = hall();
  scene.gates[1].visibility = Visibility::visual;
  scene.gates.push_back({.center = {0.1F, 0.2F, 0.3F}, .visibility = Visibility::solid});
  const World world(scene);
  const auto again = World::from_json(world.to_json());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->to_json(), world.to_json());
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_gate_test";
  std::filesystem::create_directories(folder);
  for (const char* const name : {"a.glb", "a.gltf"}) {
    world.save(folder / name);
    const auto read = World::load(folder / name);
    EXPECT_EQ(read->content_hash(), world.content_hash()) << name;
    EXPECT_TRUE(read->ignored().empty()) << name;
  }
}

TEST(Gate, PlacementMovesScalesAndTurnsThem) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_gate_test";
  std::filesystem::create_directories(folder);
  const World world(hall());
  for (const char* const name : {"b.json", "b.glb"}) {
    world.save(folder / name);
    const bool is_gltf = std::string(name) == "b.glb";
    // The same turn for both: the scene's y axis becomes up.
    const auto placed = World::load(folder / name, {.scale = 2.0, .origin = {1, 2, 3}, .up = is_gltf ? UpAxis::y : UpAxis::z});
    ASSERT_EQ(placed->gates().size(), 2U);
    for (std::size_t i = 0; i < 2; ++i) {
      const Gate &before = world.gates()[i], &after = placed->gates()[i];
      EXPECT_LT((after.center - (2.0F * before.center + Vec3(1, 2, 3))).norm(), 1e-5F);
      EXPECT_LT(after.rotation.angularDistance(before.rotation), 1e-3F);
      EXPECT_FLOAT_EQ(after.size, 2.0F * before.size);
      EXPECT_FLOAT_EQ(after.bar, 2.0F * before.bar);
    }
  }
  const auto turned = World::load(folder / "b.json", {.up = UpAxis::y});
  EXPECT_EQ(turned->gates()[0].center, Vec3(3, -4, 1));
  const Vec3 normal = world.gates()[0].rotation * Vec3::UnitX(), after = turned->gates()[0].rotation * Vec3::UnitX();
  EXPECT_LT((after - Vec3(normal.x(), -normal.z(), normal.y())).norm(), 1e-5F);
}

TEST(Gate, NodesOfGltfFilesMayBeMovedAndScaledEvenly) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_gate_test";
  std::filesystem::create_directories(folder);
  const World world(hall());
  world.save(folder / "c.gltf");
  const auto edited = [&](const auto& edit) {
    std::ifstream file(folder / "c.gltf");
    nlohmann::json json = nlohmann::json::parse(file);
    for (auto& node : json["nodes"]) {
      if (node["name"] == "gate 1") edit(node);
    }
    std::ofstream(folder / "d.gltf") << json;
    return World::load(folder / "d.gltf");
  };
  const auto scaled = edited([](auto& node) {
    node["scale"] = {2, 2, 2};
    node["translation"] = {1, 2, 3};
  });
  EXPECT_EQ(scaled->gates()[1].center, Vec3(1, -3, 2));
  EXPECT_NEAR(scaled->gates()[1].size, 3.0F, 1e-5F);
  EXPECT_NEAR(scaled->gates()[1].bar, 0.2F, 1e-6F);
  EXPECT_LT(scaled->gates()[1].rotation.angularDistance(world.gates()[1].rotation), 1e-3F);
  const auto refusal = [&](const auto& edit) { return testing::refusal([&] { edited(edit); }); };
  EXPECT_NE(refusal([](auto& node) { node["scale"] = {1, 2, 1}; }).find("a gate that is moved, turned and scaled alike"),
            std::string::npos);
  EXPECT_NE(refusal([](auto& node) { node["extras"]["flockstep"]["gate"]["shape"] = "oval"; }).find("\"square\" or \"ring\""),
            std::string::npos);
  EXPECT_NE(refusal([](auto& node) { node["translation"] = {1e7, 0, 0}; }).find("a gate"), std::string::npos);
}

TEST(Gate, CopiesKeepThem) {
  const auto world = std::make_shared<const World>(hall());
  const World lit(world, Lighting{.light = {.gamma = 1.5F}});
  EXPECT_EQ(lit.gates().size(), 2U);
  EXPECT_EQ(lit.primitives().data(), world->primitives().data());
  EXPECT_EQ(World::from_json(lit.to_json())->content_hash(), lit.content_hash());
  const auto marked = lit.with_markers({.goal = Vec3(1, 1, 1)});
  EXPECT_EQ(marked->gates().size(), 2U);
  EXPECT_EQ(marked->primitives().size(), world->primitives().size());
  EXPECT_EQ(marked->mesh().triangles.size(), world->mesh().triangles.size());
}

TEST(Gate, TheBuilderAddsThem) {
  WorldBuilder builder("built");
  const std::uint16_t material = builder.material({"gate"});
  builder.gate({.center = {0, 0, 2}, .material = material});
  builder.gate({.shape = GateShape::ring, .center = {5, 0, 2}, .material = material});
  const auto world = builder.build();
  ASSERT_EQ(world->gates().size(), 2U);
  EXPECT_EQ(world->gates()[1].shape, GateShape::ring);
  EXPECT_EQ(world->primitives().size(), 4 + kRingBars);
}

TEST(Gate, BadOnesAreRefused) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  struct Case {
    std::function<void(Gate&)> spoil;
    std::string message;
  };
  const std::vector<Case> cases{
      {[](Gate& g) { g.shape = static_cast<GateShape>(2); }, "gates[1].shape: expected a GateShape, got 2"},
      {[](Gate& g) { g.center.x() = kNan; }, "gates[1].center: expected finite coordinates within +-1e+06 m, got (nan, -2, 5)"},
      {[](Gate& g) { g.size = 0.0F; }, "gates[1].size: expected a number in [2e-06, 2000000], got 0.000000"},
      {[](Gate& g) { g.bar = kNan; }, "gates[1].bar: expected a number in [2e-06, 2000000], got nan"},
      {[](Gate& g) { g.rotation = Quat(1, 1, 0, 0); }, "gates[1].rotation: expected a unit quaternion, got norm 1.414214"},
      {[](Gate& g) { g.material = 2; }, "gates[1].material: expected an index below 2, got 2"},
      {[](Gate& g) { g.visibility = static_cast<Visibility>(3); }, "gates[1].visibility: expected a Visibility, got 3"},
      {[](Gate& g) { g.center.x() = 999'999.75F, g.size = 1e4F; }, "gates[1] (its frame).center: expected finite coordinates"},
  };
  for (const Case& bad : cases) {
    SceneDescription scene = hall();
    bad.spoil(scene.gates[1]);
    const std::string message = testing::refusal([&] { const World world(scene); });
    EXPECT_TRUE(message.starts_with(bad.message)) << message;
  }
  SceneDescription many = hall();
  many.gates.resize(4097, many.gates[0]);
  EXPECT_EQ(testing::refusal([&] { const World world(many); }), "gates: expected at most 4096 of them, got 4097");
  SceneDescription unseen;
  unseen.gates = {{.visibility = Visibility::visual}};
  EXPECT_EQ(testing::refusal([&] { const World world(unseen); }),
            "scene: expected at least one primitive or triangle that is solid, got none");
}

TEST(Gate, BadFilesAreRefused) {
  const auto refusal = [](const std::string& gate) {
    return testing::refusal([&] { parse_scene(R"({"flockstep_scene": 1, "gates": [)" + gate + "]}", "x.json", {}); });
  };
  EXPECT_EQ(refusal(R"({"center": [0, 0, 0]})"), "accepted");
  EXPECT_EQ(refusal(R"({"center": [0, 0, 0], "shape": "oval"})"),
            "x.json: /gates/0/shape: expected \"square\" or \"ring\", got \"oval\"");
  EXPECT_EQ(refusal(R"({"center": [0, 0, 0], "size": 0})"), "x.json: /gates/0/size: expected a number > 0, got 0");
  EXPECT_EQ(refusal(R"({"center": [0, 0, 0], "bar": -1})"), "x.json: /gates/0/bar: expected a number > 0, got -1");
  EXPECT_EQ(refusal(R"({"size": 1})"), "x.json: /gates/0: expected a field \"center\", found none");
}

}  // namespace
}  // namespace flockstep
