// Bodies of worlds: their checks, their files, and the copies of a world that keep them.
#include <nlohmann/json.hpp>
#include <set>

#include "base/packed_fields.hpp"
#include "batch_helpers.hpp"
#include "flockstep/body.hpp"
#include "flockstep/raycast.hpp"
#include "flockstep/world_builder.hpp"
#include "formats/scene_json.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;

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

std::shared_ptr<const World> world_with(std::vector<BodyConfig> bodies) { return closet()->with_bodies(std::move(bodies)); }

TEST(WorldBodies, AreKeptInOrder) {
  const auto world = world_with(three_bodies());
  EXPECT_EQ(packed(world->bodies()), packed(three_bodies()));
  EXPECT_EQ(world->with_bodies({})->content_hash(), closet()->content_hash());
}

TEST(WorldBodies, AreNoGeometry) {
  const auto world = world_with(three_bodies());
  EXPECT_EQ(world->bounds().min, closet()->bounds().min);
  EXPECT_EQ(world->bounds().max, closet()->bounds().max);
  EXPECT_EQ(world->primitives().size(), closet()->primitives().size());
  SceneDescription empty;
  empty.bodies = three_bodies();
  EXPECT_REFUSED(World world_of_bodies(empty), "scene: ... primitive");
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
  const TempFolder folder;
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
    return refusal([&] { world_with(bodies); });
  };
  EXPECT_TRUE(names(message([](BodyConfig& body) { body.motion.period_s = 0.0F; }), "bodies[2].motion.period_s:"));
  EXPECT_TRUE(names(message([](BodyConfig& body) { body.size_m[1] = -1.0F; }), "bodies[2].size_m[1]:"));
  EXPECT_TRUE(names(message([](BodyConfig& body) { body.motion.kind = BodyMotionKind::waypoints; }),
                    R"(bodies[2].motion.points_m: ... "waypoints" ... 0)"));
  EXPECT_REFUSED(world_with(std::vector<BodyConfig>(kMaxBodies + 1)), "bodies: ... 4096 ... 4097");
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
  const auto message = [](const std::string& bodies) { return refusal([&] { scene_with(bodies); }); };
  EXPECT_TRUE(names(message("{}"), "scene: /bodies: ... array ... {}"));
  EXPECT_TRUE(names(message("[{}, 3]"), "scene: bodies[1]: ... 3"));
  EXPECT_TRUE(names(message(R"([{"motion": {"period_s": "x"}}])"), "scene: bodies[0].motion.period_s: expected a number"));
  EXPECT_TRUE(names(message(R"([{"motion": {"period_s": 0}}])"), "scene: bodies[0].motion.period_s:"));
  EXPECT_TRUE(names(message(R"([{"shape": "cube"}])"), "scene: bodies[0].shape: ... cylinder"));
  EXPECT_TRUE(names(message(R"([{"motoin": {}}])"), "scene: bodies[0].motoin: ... shape ... motion?"));
  EXPECT_TRUE(names(message(R"([{"motion": {"kind": "orbit", "axis": [0, 0, 0]}}])"), "bodies[0].motion.axis: ... 1e-06 ... 0"));
}

TEST(WorldBodies, ArePlacedWithTheirWorld) {
  const auto world = world_with(three_bodies());
  const TempFolder folder;
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
}

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
  const TempFolder folder;
  for (const char* const name : {"a.glb", "a.gltf"}) {
    world.save(folder / name);
    const auto read = World::load(folder / name);
    EXPECT_EQ(read->content_hash(), world.content_hash()) << name;
    EXPECT_TRUE(read->ignored().empty()) << name;
  }
}

TEST(Gate, PlacementMovesScalesAndTurnsThem) {
  const TempFolder folder;
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
  const TempFolder folder;
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
  EXPECT_TRUE(names(refusal([](auto& node) { node["scale"] = {1, 2, 1}; }), "a gate that is moved, turned and scaled alike"));
  EXPECT_TRUE(names(refusal([](auto& node) { node["extras"]["flockstep"]["gate"]["shape"] = "oval"; }), "square, ring"));
  EXPECT_TRUE(names(refusal([](auto& node) { node["translation"] = {1e7, 0, 0}; }), "a gate"));
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
  struct Case {
    std::function<void(Gate&)> spoil;
    std::string message;
  };
  const std::vector<Case> cases{
      {[](Gate& g) { g.shape = static_cast<GateShape>(2); }, "gates[1].shape: ... 2"},
      {[](Gate& g) { g.center.x() = kNan; }, "gates[1].center: ... +-1e+06 ... (nan, -2, 5)"},
      {[](Gate& g) { g.size = 0.0F; }, "gates[1].size: ... [2e-06, 2000000] ... 0.000000"},
      {[](Gate& g) { g.bar = kNan; }, "gates[1].bar: ... [2e-06, 2000000] ... nan"},
      {[](Gate& g) { g.rotation = Quat(1, 1, 0, 0); }, "gates[1].rotation: ... norm 1.414214"},
      {[](Gate& g) { g.material = 2; }, "gates[1].material: ... 2 ... 2"},
      {[](Gate& g) { g.visibility = static_cast<Visibility>(3); }, "gates[1].visibility: ... 3"},
      {[](Gate& g) { g.center.x() = 999'999.75F, g.size = 1e4F; }, "gates[1] (its frame).center: ... coordinates"},
  };
  for (const Case& bad : cases) {
    SceneDescription scene = hall();
    bad.spoil(scene.gates[1]);
    EXPECT_REFUSED(const World world(scene), bad.message);
  }
  SceneDescription many = hall();
  many.gates.resize(4097, many.gates[0]);
  EXPECT_REFUSED(const World world(many), "gates: ... 4096 ... 4097");
  SceneDescription unseen;
  unseen.gates = {{.visibility = Visibility::visual}};
  EXPECT_REFUSED(const World world(unseen), "scene: ... primitive");
}

TEST(Gate, BadFilesAreRefused) {
  const auto refusal = [](const std::string& gate) {
    return testing::refusal([&] { parse_scene(R"({"flockstep_scene": 1, "gates": [)" + gate + "]}", "x.json", {}); });
  };
  EXPECT_EQ(refusal(R"({"center": [0, 0, 0]})"), "accepted");
  EXPECT_TRUE(names(refusal(R"({"center": [0, 0, 0], "shape": "oval"})"),
                    R"(x.json: /gates/0/shape: expected one of square, ring, got oval)"));
  EXPECT_TRUE(names(refusal(R"({"center": [0, 0, 0], "size": 0})"), "x.json: /gates/0/size: ... 0 ... 0"));
  EXPECT_TRUE(names(refusal(R"({"center": [0, 0, 0], "bar": -1})"), "x.json: /gates/0/bar: ... 0 ... -1"));
  EXPECT_TRUE(names(refusal(R"({"size": 1})"), R"(x.json: /gates/0: ... "center")"));
}

}  // namespace
}  // namespace flockstep
