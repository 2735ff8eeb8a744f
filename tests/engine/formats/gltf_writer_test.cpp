#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "any_world.hpp"
#include "flockstep/generators.hpp"
#include "formats/gltf.hpp"
#include "formats/packed_world.hpp"
#include "formats/scene_json.hpp"
#include "random.hpp"
#include "standard.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Json = nlohmann::json;

GltfFile read_back(const std::string& bytes, const LoadOptions& options = {}) {
  return parse_gltf(bytes, "x.glb", "/nowhere", options);
}

std::string written(const World& world, GltfForm form = GltfForm::binary) {
  if (!world.gates().empty()) {  // World::primitives() has their frames, too
    return write_gltf(canonical(parse_scene(world.to_json(), "x.json", {})), form, "x.glb");
  }
  SceneDescription description{world.name(),
                               {world.materials().begin(), world.materials().end()},
                               {world.textures().begin(), world.textures().end()},
                               {world.primitives().begin(), world.primitives().end()},
                               world.triangles(),
                               world.markers(),
                               world.light()};
  return write_gltf(canonical(std::move(description)), form, "x.glb");
}

void expect_equal_world(const World& world, GltfForm form) {
  GltfFile file = read_back(written(world, form));
  EXPECT_TRUE(file.ignored.empty()) << file.ignored[0];
  const World again(std::move(file.scene));
  EXPECT_EQ(again.content_hash(), world.content_hash());
  EXPECT_EQ(again.name(), world.name());
}

TEST(GltfWriter, AnyWorldComesBackEqual) {
  for (unsigned seed = 0; seed < 300; seed += kThinning) {
    SCOPED_TRACE(seed);
    expect_equal_world(AnyWorld(seed).make(), seed % 2 == 0 ? GltfForm::binary : GltfForm::text);
    if (HasFailure()) break;
  }
}

TEST(GltfWriter, ShippedAndGeneratedWorldsComeBackEqual) {
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(FLOCKSTEP_SCENES)) {
    if (entry.path().extension() != ".json" || entry.path().stem() == "schema") continue;
    SCOPED_TRACE(entry.path());
    expect_equal_world(*World::load(entry.path()), GltfForm::binary);
    ++count;
  }
  EXPECT_GE(count, 10U);
  for (std::uint64_t seed = 0; seed < 5; ++seed) expect_equal_world(*flockstep::playground({.seed = seed}), GltfForm::binary);
  expect_equal_world(*forest({.seed = 1, .trees = 10, .size_m = {20.0F, 20.0F}}), GltfForm::binary);
}

TEST(GltfWriter, VerticesBeyond16BitsAreKept) {
  SceneDescription scene;
  for (std::int32_t i = 0; i < 70000; ++i) {
    scene.mesh.vertices.emplace_back(static_cast<float>(i), static_cast<float>(i % 2), 0.0F);
    if (i >= 2) scene.mesh.triangles.push_back({i - 2, i - 1, i});
  }
  expect_equal_world(World(std::move(scene)), GltfForm::binary);
}

// The tessellation is part of the format: older files must read the same.
TEST(GltfWriter, OlderFilesKeepTheirPrimitives) {
  const std::filesystem::path folder = std::filesystem::path(FLOCKSTEP_CORPUS) / "gltf";
  for (const auto& [name, count] : std::map<std::string, std::size_t>{{"ours_flat.glb", 3}, {"ours_round.glb", 4}}) {
    const auto world = World::load(folder / name);
    EXPECT_EQ(world->primitives().size(), count) << name;
    EXPECT_TRUE(world->ignored().empty()) << name;
  }
}

// ------------------------------------------------------------------------------------------------------ placed and edited

// A box, a cylinder and a capsule with oblique rotations, and a triangle.
World small_world() {
  const Quat askew = Quat(0.5F, 0.1F, -0.7F, 0.3F).normalized();
  SceneDescription scene;
  scene.name = "small";
  scene.primitives = {{PrimitiveKind::room, {0, 0, 5}, Quat::Identity(), {20, 15, 5}, 0},
                      {PrimitiveKind::box, {1, 2, 3}, askew, {1, 2, 3}, 0},
                      {PrimitiveKind::cylinder, {-4, 5, 2}, askew, {0.5F, 0.5F, 2}, 0},
                      {PrimitiveKind::sphere, {7, 5, 2}, Quat::Identity(), {2, 2, 2}, 0},
                      {PrimitiveKind::capsule, {4, -5, 2}, askew, {0.5F, 0.5F, 2}, 0}};
  scene.mesh.vertices = {{0, 0, 1}, {1, 0, 1}, {0, 1, 2}};
  scene.mesh.triangles = {{0, 1, 2}};
  scene.markers = {.radius = 0.5F, .start = Vec3(1, 2, 3), .spawn_box = Aabb{{0, 1, 2}, {3, 5, 7}}};
  scene.light.sun_direction = {0.0F, 0.6F, 0.8F};
  return World(std::move(scene));
}

using Edit = std::function<void(Json&)>;

std::string edited(const Edit& edit) {
  Json json = Json::parse(written(small_world(), GltfForm::text));
  edit(json);
  return json.dump();
}

GltfFile read_edited(const Edit& edit, const LoadOptions& options = {}) { return read_back(edited(edit), options); }

std::string edit_refusal(const Edit& edit) {
  return refusal([&] { read_edited(edit); });
}

void expect_close(const Vec3& a, const Vec3& b) { EXPECT_LT((a - b).norm(), 2e-5F) << a.transpose() << " and " << b.transpose(); }

// Expects two equal solids: the same surface, even if their frames are rotated differently.
void expect_same_solid(const Primitive& a, const Primitive& b, const Eigen::Affine3f& moved) {
  EXPECT_EQ(a.kind, b.kind);
  expect_close(b.center, moved * a.center);
  const Mat3 of_a = moved.linear() * a.rotation * Mat3(a.half_extents.asDiagonal());
  const Mat3 of_b = b.rotation * Mat3(b.half_extents.asDiagonal());
  if (a.kind == PrimitiveKind::sphere) return expect_close(b.half_extents, Vec3::Constant(of_a.col(0).norm()));
  for (int i = 0; i < 3; ++i) {
    int best = 0;  // a room's axes may be permuted
    for (int k = 1; k < 3; ++k)
      best = std::abs(of_b.col(k).dot(of_a.col(i))) > std::abs(of_b.col(best).dot(of_a.col(i))) ? k : best;
    const int k = a.kind == PrimitiveKind::room ? best : i;
    expect_close(of_b.col(k) * (of_b.col(k).dot(of_a.col(i)) < 0 ? -1.0F : 1.0F), of_a.col(i));
  }
}

TEST(GltfWriter, ItIsPlacedAsAWhole) {
  const World world = small_world();
  for (const UpAxis up : {UpAxis::of_format, UpAxis::y, UpAxis::z}) {
    const LoadOptions options{.scale = 2.0, .origin = {10, 20, 30}, .up = up};
    const GltfFile file = read_back(written(world), options);
    EXPECT_TRUE(file.ignored.empty());
    Eigen::Affine3f moved = Eigen::Translation3f(options.origin) * Eigen::Scaling(2.0F);
    if (up == UpAxis::z) moved = moved * Eigen::AngleAxisf(static_cast<float>(-std::acos(0.0)), Vec3::UnitX());
    const World read(file.scene);
    ASSERT_EQ(read.primitives().size(), 5U);
    for (std::size_t i = 0; i < 5; ++i) expect_same_solid(world.primitives()[i], read.primitives()[i], moved);
    for (std::size_t i = 0; i < 3; ++i) expect_close(read.triangles().vertices[i], moved * world.triangles().vertices[i]);
    expect_close(*read.markers().start, moved * *world.markers().start);
    EXPECT_EQ(read.markers().radius, 1.0F);
    const Vec3 a = moved * world.markers().spawn_box->min, b = moved * world.markers().spawn_box->max;
    expect_close(read.markers().spawn_box->min, a.cwiseMin(b));
    expect_close(read.markers().spawn_box->max, a.cwiseMax(b));
    expect_close(Vec3(read.light().sun_direction.data()), moved.linear() * Vec3(world.light().sun_direction.data()) / 2.0F);
  }
}

// Nodes 0 to 4 are the primitives, 5 the mesh, 6 the start, 7 the sun.
TEST(GltfWriter, ObjectsMovedInAnotherProgramMove) {
  const World world = small_world();
  const double half = std::sqrt(0.5);  // a quarter turn about the file's y axis, which is z in the world
  const GltfFile file = read_edited([&](Json& json) {
    json["scenes"][0]["nodes"] = {8};
    json["nodes"].push_back(
        {{"children", {1, 2, 3, 4, 5}}, {"rotation", {0, half, 0, half}}, {"scale", {3, 3, -3}}, {"translation", {5, 6, 7}}});
  });
  EXPECT_TRUE(file.ignored.empty());
  Eigen::Affine3f moved = Eigen::Translation3f(5, -7, 6) * Eigen::AngleAxisf(static_cast<float>(std::acos(0.0)), Vec3::UnitZ()) *
                          Eigen::Scaling(Vec3(3, -3, 3));
  ASSERT_EQ(file.scene.primitives.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) expect_same_solid(world.primitives()[i + 1], file.scene.primitives[i], moved);

  const GltfFile stretched = read_edited([](Json& json) { json["nodes"][1]["scale"] = {1, 7, 2}; });
  EXPECT_EQ(stretched.scene.primitives[1].half_extents, Vec3(1, 2, 7));
  const GltfFile turned = read_edited([](Json& json) { json["nodes"][7]["rotation"] = {0, 0, 0, 1}; });
  expect_close(Vec3(turned.scene.light.sun_direction.data()), Vec3(0, -1, 0));
  const GltfFile twice = read_edited([](Json& json) {
    json["scenes"][0]["nodes"].push_back(8);
    json["nodes"].push_back(json["nodes"][5]);
  });
  EXPECT_EQ(twice.scene.mesh.objects, (std::vector<std::uint16_t>{0, 1}));
}

TEST(GltfWriter, ChangedPrimitivesAreMeshes) {
  const std::string one = "1 primitive whose extras describe another shape than the mesh, which is used instead";
  const std::vector<Edit> edits{
      [](Json& json) { json["nodes"][3]["scale"] = {2, 3, 2}; },                  // an ellipsoid
      [](Json& json) { json["nodes"][2]["scale"] = {1, 2, 3}; },                  // an elliptic cylinder
      [](Json& json) { json["nodes"][0]["rotation"] = {0.6, 0, 0, 0.8}; },        // a rotated room
      [](Json& json) { json["nodes"][3]["mesh"] = json["nodes"][1]["mesh"]; },    // a box in place of a sphere
      [](Json& json) { json["nodes"][4]["extras"]["flockstep"]["height"] = 5; },  // parameters that differ from the mesh
      [](Json& json) { json["accessors"][1]["count"] = 30; },                     // a room with a side missing
      [](Json& json) { json["meshes"][1]["primitives"].push_back(json["meshes"][0]["primitives"][0]); },
      [](Json& json) {  // sheared
        json["nodes"][1].erase("rotation");
        json["nodes"][1].erase("scale");
        json["nodes"][1].erase("translation");
        json["nodes"][1]["matrix"] = {1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
      }};
  for (std::size_t i = 0; i < edits.size(); ++i) {
    SCOPED_TRACE(i);
    const GltfFile file = read_edited(edits[i]);
    EXPECT_EQ(file.ignored, std::vector<std::string>{one});
    EXPECT_EQ(file.scene.primitives.size(), 4U);
    EXPECT_NO_THROW(World{file.scene});
  }
}

TEST(GltfWriter, WithoutExtrasAllIsMeshes) {
  const World world = small_world();
  const GltfFile file = read_edited([](Json& json) {
    json["scenes"][0].erase("extras");
    for (Json& node : json["nodes"]) node.erase("extras");
  });
  EXPECT_TRUE(file.scene.primitives.empty());
  EXPECT_FALSE(file.has_name);
  const World read(file.scene);
  EXPECT_EQ(read.triangles().objects.back(), 5);
  EXPECT_EQ(read.markers().start, world.markers().start);
  expect_close(Vec3(read.light().sun_direction.data()), Vec3(world.light().sun_direction.data()));
  expect_close(read.bounds().min, world.bounds().min);
  expect_close(read.bounds().max, world.bounds().max);
}

TEST(GltfWriter, BadExtrasAreRefused) {
  const auto of_node = [](std::size_t node, const Json& ours) {
    return edit_refusal([&](Json& json) { json["nodes"][node]["extras"]["flockstep"] = ours; });
  };
  const std::string at_1 = "x.glb: /nodes/1/extras/flockstep", at_4 = "x.glb: /nodes/4/extras/flockstep";
  EXPECT_TRUE(names(of_node(1, 3), at_1 + ": ... 3"));
  EXPECT_TRUE(names(of_node(1, {{"primitive", "cube"}}), at_1 + R"(/primitive: ... room, box, cylinder, sphere, ... cube)"));
  EXPECT_TRUE(names(of_node(1, {{"primitive", "box"}, {"radius", 1}}), at_1 + "/radius: unknown field"));
  EXPECT_TRUE(names(of_node(1, {{"shape", "box"}}), at_1 + "/shape: unknown field"));
  EXPECT_TRUE(names(of_node(1, Json::object()), at_1 + R"(: ... "object")"));
  EXPECT_TRUE(names(of_node(4, {{"primitive", "capsule"}, {"radius", 1}}), at_4 + R"(: ... "height")"));
  EXPECT_TRUE(
      names(of_node(4, {{"primitive", "capsule"}, {"radius", 0}, {"height", 3}}), at_4 + "/radius: ... [1e-06, 1000000] ... 0"));
  EXPECT_TRUE(names(of_node(4, {{"primitive", "capsule"}, {"radius", 2}, {"height", 3}}), at_4 + "/height: ... >= ... 3"));
  EXPECT_TRUE(names(of_node(5, {{"object", 65536}}), "x.glb: /nodes/5/extras/flockstep/object: ... [0, 65535] ... 65536"));
  EXPECT_TRUE(names(of_node(5, {{"object", 0}, {"order", {0}}}), "x.glb: /nodes/5/extras/flockstep/order: ... 1"));
  EXPECT_TRUE(names(of_node(5, {{"object", 0}, {"order", {0, -1}}}),
                    "x.glb: /nodes/5/extras/flockstep/order/1: ... [0, 4294967295] ... -1"));
  EXPECT_EQ(of_node(5, {{"object", 0}, {"order", {7, 1}}}), "accepted");  // ignored: belongs to another mesh
  EXPECT_EQ(of_node(5, {{"object", 0}, {"order", {0, 4294967295U}}}), "accepted");
  EXPECT_TRUE(names(of_node(6, {{"primitive", "box"}}), R"(x.glb: /nodes/6/extras: ... "flockstep")"));
  EXPECT_TRUE(names(edit_refusal([](Json& json) { json["nodes"][1]["scale"] = {1e7, 1, 1}; }),
                    "x.glb: /nodes/1: ... +-1e+06 ... >= 1e-06 ... (1, 2, 3)"));
  EXPECT_EQ(edit_refusal([](Json& json) { json["nodes"][1]["extras"] = "anything"; }), "accepted");

  const auto of_scene = [](const Json& ours) {
    return edit_refusal([&](Json& json) { json["scenes"][0]["extras"]["flockstep"] = ours; });
  };
  const std::string scene = "x.glb: /scenes/0/extras/flockstep";
  EXPECT_TRUE(names(of_scene({{"boxes", 1}}), scene + "/boxes: unknown field ... bodies?"));
  EXPECT_TRUE(names(of_scene({{"bodies", 1}}), scene + "/bodies: ... 1"));
  EXPECT_TRUE(names(of_scene({{"bodies", {{{"size_m", {1, 1}}}}}}), "x.glb: bodies[0].size_m: ... 3 ... [1,1]"));
  EXPECT_TRUE(names(of_scene({{"light", {{"gamma", 9}}}}), scene + "/light/gamma: ... [1, 4] ... 9"));
  EXPECT_TRUE(names(of_scene({{"markers", {{"start", {0, 0, 0}}}}}), scene + "/markers/start: unknown field"));
  EXPECT_TRUE(names(of_scene({{"markers", {{"spawn_box", {{"min", {0, 0, "x"}}, {"max", {1, 1, 1}}}}}}}),
                    scene + R"(/markers/spawn_box/min/2: ... "x")"));
}

// ---------------------------------------------------------------------------------------------------------------- files

TEST(GltfWriter, FilesAreSavedBySuffixWholeOrNotAtAll) {
  const TempFolder folder;
  const World world = small_world();
  for (const char* const name : {"a.glb", "a.gltf", "a.json", "B.GLB"}) {
    world.save(folder / name);
    const auto read = World::load(folder / name);
    EXPECT_EQ(read->content_hash(), world.content_hash()) << name;
    EXPECT_EQ(read->name(), "small");
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 4);  // no temporary files remain
  EXPECT_REFUSED(world.save("/nowhere/a.glb"), "/nowhere/a.glb: cannot write a glTF file: No such file or directory");
  EXPECT_REFUSED(world.save("/nowhere/a.obj"), R"(/nowhere/a.obj: ... ".obj")");
}

TEST(GltfWriter, TooLargeWorldsAreRefused) {
  SceneDescription scene;
  scene.primitives = {{PrimitiveKind::sphere, Vec3::Zero(), Quat::Identity(), Vec3::Ones(), 0}};
  scene = canonical(std::move(scene));
  for (const GltfForm form : {GltfForm::text, GltfForm::binary}) {
    const std::size_t size = write_gltf(scene, form, "x").size();
    EXPECT_EQ(write_gltf(scene, form, "x", size).size(), size);
    for (const std::size_t less : {size - 1, size / 2, std::size_t{0}}) {
      EXPECT_REFUSED(write_gltf(scene, form, "x", less), "x: ... " + std::to_string(less));
    }
  }
}

void expect_equal(const World& world) {
  const auto again = World::from_bytes(world.to_bytes());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->name(), world.name());
  EXPECT_EQ(again->to_bytes(), world.to_bytes());
}

TEST(PackedWorld, AnyWorldComesBackEqual) {
  for (unsigned seed = 0; seed < 300; seed += kThinning) {
    SCOPED_TRACE(seed);
    expect_equal(AnyWorld(seed).make());
    if (HasFailure()) break;
  }
}

TEST(PackedWorld, OnlyTrianglesComeBackEqual) {
  SceneDescription scene;
  scene.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  scene.mesh.triangles = {{0, 1, 2}};
  const World world(scene);
  expect_equal(world);
  EXPECT_TRUE(World::from_bytes(world.to_bytes())->primitives().empty());
}

TEST(PackedWorld, GatesAndOtherLightComeBackEqual) {
  const auto track = race_track({.seed = 1});
  expect_equal(*track);
  EXPECT_EQ(World::from_bytes(track->to_bytes())->gates().size(), track->gates().size());
  Lighting lighting{.light = track->light()};
  lighting.light.gamma = 1.5F;
  expect_equal(World(track, lighting));
}

TEST(PackedWorld, DamagedBytesAreRefused) {
  const std::string bytes = AnyWorld(1).make().to_bytes();
  ASSERT_GT(World::from_bytes(bytes)->textures().size(), 0U);
  const std::string expected = "world: expected the bytes of a packed world of this version, got others";
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const std::string message = refusal([&] { World::from_bytes(std::string_view(bytes).substr(0, size)); });
    ASSERT_NE(message, "accepted") << size;
  }
  std::string other = bytes;
  other[8 + std::string_view("flockstep packed world ").size()] = '0';
  EXPECT_EQ(refusal([&] { World::from_bytes(other); }), expected);
  for (std::size_t i = 0; i < bytes.size(); ++i) {  // accepted or refused, without a crash
    std::string spoilt = bytes;
    spoilt[i] = static_cast<char>(~spoilt[i]);
    refusal([&] { World::from_bytes(spoilt); });
  }
}

}  // namespace
}  // namespace flockstep
