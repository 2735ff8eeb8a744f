// Sunlight in images, compared with the oracle.
#include "batch_helpers.hpp"
#include "flockstep/generators.hpp"
#include "on_target.hpp"
#include "picture_oracle.hpp"
#include "prepared/prepared_world.hpp"
#include "render/raycast/shading.hpp"

namespace flockstep {
namespace {

using namespace testing;
using enum PrimitiveKind;

CameraConfig camera_of(bool shadows, float hfov_deg = 90.0F) {
  return {.width_px = 96, .height_px = 72, .hfov_deg = hfov_deg, .outputs = kAllOutputs, .shadows = shadows};
}

struct View {
  Vec3 from, towards;
};

class LitPictures : public ::testing::Test {
 protected:
  // Returns a batch with images from all views.
  static std::unique_ptr<Batch> pictures(const Batch::Worlds& worlds, const CameraConfig& camera,
                                         const std::vector<View>& views) {
    auto batch = std::make_unique<Batch>(camera_batch(camera, static_cast<int>(views.size())), worlds);
    std::vector<float> places, turns;
    for (const auto& [from, towards] : views) {
      const Vec3 along = towards - from;
      const Quat q = Eigen::AngleAxisf(std::atan2(along.y(), along.x()), Vec3::UnitZ()) *
                     Eigen::AngleAxisf(-std::atan2(along.z(), along.head<2>().norm()), Vec3::UnitY());
      places.insert(places.end(), {from.x(), from.y(), from.z()});
      turns.insert(turns.end(), {q.w(), q.x(), q.y(), q.z()});
    }
    batch->set_pose(places, turns);
    batch->sense();
    return batch;
  }

  static Compared compared(const std::shared_ptr<const World>& world, const CameraConfig& camera, const std::vector<View>& views,
                           std::size_t stride) {
    const auto batch = pictures({world}, camera, views);
    Compared all;
    for (std::size_t drone = 0; drone < views.size(); ++drone) all += expect_picture(*batch, drone, 0, stride);
    return all;
  }
};

// A room on open ground. The sun shines into it and lights its floor, except in a pillar's shadow. The room's shadow lies
// behind it.
TEST_F(LitPictures, ARoomLetsTheSunInAndShadesTheSpaceBehindIt) {
  SceneDescription scene;
  scene.light.sun_direction = {-0.6F, 0.3F, 0.7F};
  scene.primitives = {primitive(room, {0, 0, 1.5F}, {2, 1.5F, 1.4F}), primitive(cylinder, {0.5F, 0, 1.5F}, {0.3F, 0.3F, 1.4F}),
                      primitive(plane, {0, 0, 0}, {12, 12, 0}), primitive(sphere, {4, -0.5F, 0.5F}, {0.5F, 0.5F, 0.5F})};
  scene.markers.goal = Vec3(3.5F, 1, 0.4F);
  const auto world = std::make_shared<const World>(scene);
  const std::vector<View> outside{{{9, -5, 5}, {3, -1, 0}}, {{7, 6, 2}, {3, 0, 0}}};
  ASSERT_TRUE(oracle::is_shaded(*world, {3.5, -0.9, 0.01})) << "by the room alone";
  const Compared out = compared(world, camera_of(true), outside, 1);
  EXPECT_GT(out.shaded, 250U);
  EXPECT_GT(out.lit, 500U);
  const std::vector<View> inside{{{-1.8F, -1.3F, 2.7F}, {0.5F, 0.3F, 0}}};
  const auto in = compared(world, camera_of(true), inside, 3);
  EXPECT_GT(in.shaded, 50U);
  EXPECT_GT(in.lit, 500U);
}

// A mast in front of the sun.
TEST_F(LitPictures, TheSunStandsInTheSky) {
  for (const float radius : {0.0F, 0.27F, 3.0F, 20.0F}) {
    SceneDescription scene;
    scene.light.sun_direction = {0.8F, 0.1F, 0.6F};
    scene.light.sun_color = {1.2F, 1.0F, 0.4F};
    scene.light.sun_radius_deg = radius;
    scene.light.sun_glow = radius == 20.0F ? 0.0F : 0.7F;
    scene.primitives = {primitive(cylinder, {5, 0.55F, 3}, {0.1F, 0.1F, 3}), primitive(plane, {0, 0, 0}, {12, 12, 0})};
    const Vec3 eye(0, 0, 1);
    const std::vector<View> views{
        {eye, eye + Vec3(8, 1, 6)}, {eye, {2, -1, 1.5F}}, {eye, {-2, 1, 0.5F}}, {{0.3F, -2, 4}, {1, 1, 9}}};
    const auto world = std::make_shared<const World>(scene);
    const Compared wide = compared(world, camera_of(false), views, 3);
    EXPECT_GT(wide.sky, 3000U);
    EXPECT_GT(compared(world, camera_of(false, 4.0F), {views[0]}, 1).sky, 3000U);  // the disc's edge, magnified
  }
}

TEST_F(LitPictures, OfWorldsWithAndWithoutASunInTheSky) {
  SceneDescription plain;
  plain.light.sun_direction = {1, 0, 0.2F};
  plain.primitives = {primitive(box, {3, 3, 0}, {1, 1, 1})};
  SceneDescription sunny = plain;
  sunny.light.sun_radius_deg = 10.0F;
  SceneDescription dark = sunny;
  dark.light.sun_color = {0, 0, 0};
  Batch::Worlds worlds;
  for (const SceneDescription& scene : {plain, sunny, dark}) worlds.push_back(std::make_shared<const World>(scene));
  const std::vector<View> views(3, {{0, 0, 0}, {3, 0.5F, 0.5F}});
  const auto batch = pictures(worlds, camera_of(false), views);
  for (std::size_t drone = 0; drone < 3; ++drone) EXPECT_GT(expect_picture(*batch, drone, 0, 3).sky, 1000U);
  const auto& rgb = batch->camera(0).images().rgb;
  const auto size = static_cast<std::ptrdiff_t>(rgb.size() / 3);
  EXPECT_TRUE(std::equal(rgb.begin(), rgb.begin() + size, rgb.begin() + 2 * size)) << "no sun, no disc";
  EXPECT_FALSE(std::equal(rgb.begin(), rgb.begin() + size, rgb.begin() + size));
}

// Primitives of each kind with and without emission. Triangles with and without textures and vertex colours.
std::shared_ptr<const World> lamps() {
  SceneDescription scene;
  scene.light.sun_direction = {-0.5F, 0.4F, 0.7F};
  Texture checks{"checks", 2, 2, {}, {TextureWrap::repeat, TextureWrap::repeat}};
  for (const int byte : {250, 60, 90, 200}) {
    const auto value = static_cast<std::uint8_t>(byte);
    checks.rgba.insert(checks.rgba.end(), {value, static_cast<std::uint8_t>(255 - byte), value, 255});
  }
  scene.textures = {checks};
  scene.materials = {Material{"dull", {0.5F, 0.4F, 0.3F}}, Material{"lamp", {0.2F, 0.3F, 0.1F}, 0, {}, {0.1F, 0.25F, 0.5F}},
                     Material{"screen", {0, 0, 0}, 0, std::uint16_t{0}, {0.9F, 0.8F, 0.7F}},
                     Material{"neon", {0.4F, 0.4F, 0.4F}, 0, {}, {0, 5, 0}}, Material{"wood", {1, 1, 1}, 0, std::uint16_t{0}}};
  const std::array kinds{box, cylinder, sphere, capsule, plane, disc};
  for (std::size_t i = 0; i < 12; ++i) {
    const PrimitiveKind kind = kinds[i % 6];
    Vec3 half(0.4F, 0.4F, kind == capsule ? 0.7F : 0.4F);
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const float turn = i % 4 == 1 || kind == sphere ? 0.0F : 0.7F;  // upright cylinders use a colour ramp
    scene.primitives.push_back(primitive(kind, {4.0F + static_cast<float>(i / 6) * 1.5F, 1.2F * static_cast<float>(i % 6) - 3, 1},
                                         half, Quat(Eigen::AngleAxisf(turn, Vec3(1, 1, 0).normalized()))));
    scene.primitives.back().material = static_cast<std::uint16_t>(i % 5 == 4 ? 3 : (i + i / 6) % 2);
  }
  TriangleMesh& mesh = scene.mesh;
  for (std::uint16_t i = 0; i < 10; ++i) {  // each material, with vertex colours and with white ones
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    const float y = 1.3F * static_cast<float>(i % 5) - 3.2F;
    const float z = i < 5 ? 2.2F : 3.7F;
    for (const Vec3& at : {Vec3(5, y, z), Vec3(5.5F, y + 1.2F, z), Vec3(5.2F, y + 1.1F, z + 1.2F), Vec3(4.8F, y + 0.1F, z + 1)}) {
      mesh.vertices.push_back(at);
      mesh.uv.push_back({2 * at.y(), -2 * at.z()});
    }
    constexpr std::array<std::array<float, 3>, 4> kCorners{{{1, 0.1F, 0.2F}, {0.3F, 1, 0.1F}, {0, 0.2F, 0.9F}, {1, 1, 1}}};
    for (const auto& color : kCorners) mesh.colors.push_back(i < 5 ? color : std::array<float, 3>{1, 1, 1});
    mesh.triangles.insert(mesh.triangles.end(), {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
    mesh.materials.insert(mesh.materials.end(), 2, i % 5);
    mesh.objects.insert(mesh.objects.end(), 2, i);
  }
  mesh.vertices.insert(mesh.vertices.end(), {Vec3(-9, -9, 0), Vec3(20, -9, 0), Vec3(0, 30, 0)});  // ground
  mesh.uv.resize(mesh.vertices.size());
  mesh.colors.insert(mesh.colors.end(), {{0.2F, 0.6F, 0.1F}, {0.7F, 0.5F, 0.2F}, {1, 1, 1}});
  mesh.triangles.push_back({40, 41, 42});
  mesh.materials.push_back(0);
  mesh.objects.push_back(10);
  return std::make_shared<const World>(scene);
}

const std::vector<View> kLampViews{{{0, 0, 2}, {5, 0, 2}}, {{1, -3, 3}, {5, 0, 1}}, {{8, 2, 3.5F}, {4.5F, 0, 2}}};

TEST_F(LitPictures, EmissionAndColoursOfVertices) {
  for (const bool shadows : {false, true}) {
    const Compared all = compared(lamps(), camera_of(shadows), kLampViews, 2);
    EXPECT_GT(all.clear, 6000U);
    for (int element = 0; element < 12 + 21; ++element) EXPECT_TRUE(all.elements.contains(element)) << element;
  }
}

// Neighbouring entries in a backend's arrays must not matter. Covers colours without textures, and emission without either.
TEST_F(LitPictures, OfSeveralWorldsThatGlow) {
  SceneDescription colored;
  colored.mesh.vertices = {Vec3(3, -2, -1), Vec3(3, 2, -1), Vec3(3, 0, 2)};
  colored.mesh.triangles = {{0, 1, 2}};
  SceneDescription glowing = colored;
  colored.mesh.colors = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  glowing.materials[0].emissive = {0.2F, 0, 0.1F};
  const Batch::Worlds worlds{std::make_shared<const World>(glowing), lamps(), closet(), std::make_shared<const World>(colored),
                             std::make_shared<const World>(glowing)};
  const auto batch = pictures(worlds, camera_of(true), std::vector<View>(5, {{0, 0, 1}, {3, 0, 1}}));
  for (std::size_t drone = 0; drone < 5; ++drone) EXPECT_GT(expect_picture(*batch, drone, 0, 5).clear, 1000U);
}

// Returns a world in fog.
std::shared_ptr<const World> foggy(const std::shared_ptr<const World>& world, float visibility_m) {
  Lighting lighting{.light = world->light()};
  lighting.light.fog_visibility_m = visibility_m;
  return std::make_shared<const World>(world, lighting);
}

// Every kind of primitive, a gate, markers and a triangle. The material of the primitives has a texture, which only the
// triangle shows.
std::shared_ptr<const World> exhibition() {
  SceneDescription scene;
  scene.light.sun_direction = {-0.5F, -0.3F, 0.6F};
  scene.light.sun_color = {1.4F, 1.1F, 0.8F};  // brighter than images can show, before the fog
  scene.light.sun_radius_deg = 3.0F;
  scene.light.sun_glow = 0.8F;
  scene.light.horizon_color = {0.7F, 0.5F, 0.4F};
  scene.materials = {{"clay", {0.8F, 0.4F, 0.2F}}, {"tiles", {0.9F, 0.8F, 0.7F}, 0, std::uint16_t{0}}};
  scene.materials[0].emissive = {0.0F, 0.05F, 0.1F};
  scene.textures = {{"tiles", 2, 1, {250, 40, 30, 255, 30, 220, 90, 255}}};
  scene.primitives = {primitive(plane, {0, 0, -2}, {40, 40, 0}),         primitive(box, {5, 2, -1}, {0.6F, 0.8F, 1}),
                      primitive(cylinder, {6, -2, 0}, {0.5F, 0.5F, 2}),  primitive(sphere, {7, 0, 0}, {1, 1, 1}),
                      primitive(capsule, {9, 3, 0}, {0.5F, 0.5F, 1.5F}), primitive(disc, {12, -3, 1}, {1.5F, 1.5F, 0})};
  for (std::size_t i = 1; i < scene.primitives.size(); ++i) {
    scene.primitives[i].material = static_cast<std::uint16_t>(i % 2);
    if (i != 3) scene.primitives[i].rotation = Eigen::AngleAxisf(0.4F, Vec3(1, 0.3F, 0.2F).normalized());
  }
  scene.gates = {{.center = Vec3(16, 2, 1)}};
  scene.mesh.vertices = {Vec3(14, -4, -2), Vec3(14, 0, -2), Vec3(14, -2, 3)};
  scene.mesh.triangles = {{0, 1, 2}};
  scene.mesh.materials = {1};
  scene.mesh.uv = {{0, 0}, {1, 0}, {0, 2}};
  scene.markers.start = Vec3(4, 0, -1.5F);
  scene.markers.goal = Vec3(20, -1, 1);
  return std::make_shared<const World>(scene);
}

TEST_F(LitPictures, Fog) {
  const std::vector<View> views{{{0, 0, 0}, {8, 0, 0}}, {{0, -3, 3}, {9, 0, -1}}, {{3, 0, 1.5F}, {13, -2, 2}}};
  for (const float visibility : {0.5F, 12.0F, 1000.0F}) {
    for (const bool shadows : {false, true}) {
      const Compared all = compared(foggy(exhibition(), visibility), camera_of(shadows), views, 3);
      EXPECT_GT(all.clear, 5000U);
      EXPECT_GT(all.sky, 500U);
      EXPECT_GT(all.elements.size(), 12U);
    }
  }
}

TEST_F(LitPictures, FogBeforeLampsAndColoursOfVertices) {
  const Compared all = compared(foggy(lamps(), 4.0F), camera_of(true), kLampViews, 2);
  EXPECT_GT(all.clear, 6000U);
}

// Worlds without fog show the same bits beside others with fog.
TEST_F(LitPictures, OfWorldsWithAndWithoutFog) {
  const Batch::Worlds worlds{exhibition(), foggy(exhibition(), 6.0F), lamps(), foggy(closet(), 2.0F), exhibition()};
  const View view{{0, 0, 1}, {3, 0, 1}};
  const auto batch = pictures(worlds, camera_of(true), std::vector<View>(5, view));
  for (std::size_t drone = 0; drone < 5; ++drone) EXPECT_GT(expect_picture(*batch, drone, 0, 5).clear, 1000U);
  const auto only = pictures({exhibition()}, camera_of(true), {view});
  const auto& rgb = batch->camera(0).images().rgb;
  EXPECT_TRUE(std::equal(only->camera(0).images().rgb.begin(), only->camera(0).images().rgb.end(), rgb.begin()));
  EXPECT_TRUE(std::equal(only->camera(0).images().rgb.begin(), only->camera(0).images().rgb.end(),
                         rgb.begin() + 4 * static_cast<std::ptrdiff_t>(rgb.size() / 5)));
}

TEST(Light, EverySimdTargetShowsTheSameBits) {
  SceneDescription sky;
  sky.light.sun_radius_deg = 5.0F;
  sky.light.sun_glow = 0.5F;
  sky.light.sun_direction = {1, 0.2F, 0.1F};
  sky.primitives = {primitive(sphere, {3, 0, -1}, {1, 1, 1})};
  for (const auto& world : {lamps(), std::make_shared<const World>(sky), foggy(exhibition(), 9.0F), foggy(lamps(), 3.0F)}) {
    std::vector<std::uint8_t> first;
    on_every_target([&] {
      const auto batch = testing::look(world, camera_of(true), {0, 0, 2});
      const auto& rgb = batch->camera(0).images().rgb;
      if (first.empty()) first.assign(rgb.begin(), rgb.end());
      EXPECT_TRUE(std::equal(first.begin(), first.end(), rgb.begin()));
    });
  }
}

TEST(Light, ColoursOfVerticesAreKeptWhereOneIsNotWhite) {
  SceneDescription scene;
  scene.mesh.vertices = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(5, 5, 5)};  // the last one is unused
  scene.mesh.triangles = {{0, 1, 2}};
  scene.mesh.colors.assign(4, {1, 1, 1});
  scene.mesh.colors[3] = {0, 0, 0};
  const std::uint64_t white = World(scene).content_hash();
  EXPECT_TRUE(World(scene).triangles().colors.empty());
  scene.mesh.colors[1] = {0.25F, 1, 0.1F};
  const World world(scene);
  EXPECT_EQ(world.triangles().colors, (std::vector<std::array<float, 3>>{{1, 1, 1}, {0.25F, 1, 0.1F}, {1, 1, 1}}));
  EXPECT_NE(world.content_hash(), white);
  scene.mesh.colors.clear();
  EXPECT_EQ(World(scene).content_hash(), white);
  scene.materials[0].emissive = {0, 0, 0.5F};
  EXPECT_NE(World(scene).content_hash(), white);
}

TEST(Light, ComesBackEqualFromAFile) {
  const auto world = lamps();
  const auto again = World::from_json(world->to_json());
  EXPECT_EQ(again->content_hash(), world->content_hash());
  EXPECT_EQ(again->to_json(), world->to_json());
  EXPECT_EQ(again->triangles().colors, world->triangles().colors);
  EXPECT_EQ(again->materials()[1].emissive, (std::array{0.1F, 0.25F, 0.5F}));
}

TEST(Light, BadValuesAreRefused) {
  SceneDescription good;
  good.mesh.vertices = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)};
  good.mesh.triangles = {{0, 1, 2}};
  good.mesh.colors.assign(3, {0.5F, 0.5F, 0.5F});
  const auto refusal = [&](const auto& spoil) {
    SceneDescription scene = good;
    spoil(scene);
    return testing::refusal([&] { World world(std::move(scene)); });
  };
  EXPECT_EQ(refusal([](auto&) {}), "accepted");
  EXPECT_TRUE(names(refusal([](auto& s) { s.mesh.colors.pop_back(); }), "mesh.colors: ... (3) ... 2"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.mesh.colors[1][2] = std::nanf(""); }), "mesh.colors[1]: ... [0, 1] ... nan"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.mesh.colors[2][0] = 1.5F; }), "mesh.colors[2]: ... [0, 1] ... 1.500000"));
  EXPECT_TRUE(
      names(refusal([](auto& s) { s.materials[0].emissive[1] = -1.0F; }), "materials[0].emissive: ... [0, 100] ... -1.000000"));
  EXPECT_TRUE(
      names(refusal([](auto& s) { s.light.sun_radius_deg = 0.05F; }), "light.sun_radius_deg: ... 0 ... [0.1, 45] ... 0.05"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.light.fog_visibility_m = 0.05F; }),
                    "light.fog_visibility_m: ... 0 ... [0.1, 1000000] ... 0.05"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.light.fog_visibility_m = -1.0F; }),
                    "light.fog_visibility_m: ... 0 ... [0.1, 1000000] ... -1"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.light.sun_glow = std::nanf(""); }), "light.sun_glow: ... [0, 1] ... nan"));
}

// -- Worlds with the same geometry in different light.

using Shared = std::shared_ptr<const World>;

// Primitives of several kinds, triangles with a partly transparent texture, and triangles without a texture.
SceneDescription scene() {
  SceneDescription scene;
  scene.materials = {{"grey", {0.5F, 0.5F, 0.5F}}, {"red", {0.9F, 0.1F, 0.1F}}, {"pattern", {1, 1, 1}}};
  scene.textures = {{"checks", 2, 2, {250, 200, 90, 255, 40, 60, 80, 0, 90, 90, 200, 255, 255, 255, 255, 255}}};
  scene.materials[2].texture = 0;
  scene.materials[2].alpha_cutoff = 0.5F;
  scene.primitives = {primitive(box, {3, 1, 0.5F}, {0.5F, 0.5F, 0.5F}), primitive(cylinder, {4, -1, 0.5F}, {0.4F, 0.4F, 0.5F}),
                      primitive(sphere, {5, 0.3F, 1}, {0.4F, 0.4F, 0.4F}), primitive(plane, {5, 0, 0}, {6, 6, 0})};
  scene.primitives[1].material = 1;
  scene.mesh.vertices = {{6, -2, 0}, {6, 2, 0}, {6, 2, 3}, {6, -2, 3}, {2, -1, 0.1F}, {3, -1, 0.1F}, {3, 0, 1}};
  scene.mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}};
  scene.mesh.materials = {2, 2, 1};
  scene.mesh.objects = {0, 0, 1};
  scene.mesh.uv = {{0, 0}, {3, 0}, {3, 2}, {0, 2}, {0, 0}, {0, 0}, {0, 0}};
  scene.markers.goal = Vec3(4, 0.5F, 1.5F);
  return scene;
}

Lighting evening() {
  Lighting lighting;
  lighting.light.sun_direction = {-0.9F, 0.4F, 0.3F};
  lighting.light.sun_color = {0.7F, 0.4F, 0.2F};
  lighting.light.sky_ambient = {0.2F, 0.25F, 0.4F};
  lighting.light.horizon_color = {0.9F, 0.5F, 0.3F};
  lighting.light.sun_radius_deg = 2.0F;
  lighting.tint = {{1, 0.8F, 0.6F}, {2, 1, 1}, {0.7F, 0.9F, 1}};
  return lighting;
}

CameraConfig camera() { return {.width_px = 64, .height_px = 48, .outputs = kAllOutputs, .shadows = true}; }

TEST(Lighting, EqualThoseOfAWorldMadeWithThem) {
  SceneDescription made = scene();
  made.light = evening().light;
  made.materials[0].base_color = {0.5F, 0.5F * 0.8F, 0.5F * 0.6F};
  made.materials[1].base_color = {1, 0.1F, 0.1F};  // red is clamped to 1
  made.materials[2].base_color = {0.7F, 0.9F, 1};
  const World expected(made);
  const World world(std::make_shared<const World>(scene()), evening());  // keeps the original world alive
  EXPECT_EQ(world.to_json(), expected.to_json());
  EXPECT_EQ(world.content_hash(), expected.content_hash());
  EXPECT_EQ(world.mesh().vertices.size(), expected.mesh().vertices.size());
  const auto pictures = [](const World& of) { return testing::look(Shared(Shared(), &of), camera(), Vec3(0, 0, 1)); };
  EXPECT_TRUE(same_arrays(pictures(world)->camera(0).images(), pictures(expected)->camera(0).images()));
  const auto before = testing::look(std::make_shared<const World>(scene()), camera(), Vec3(0, 0, 1));
  EXPECT_NE(pictures(world)->camera(0).images().rgb, before->camera(0).images().rgb);
  EXPECT_EQ(pictures(world)->camera(0).images().depth, before->camera(0).images().depth);
}

TEST(Lighting, ShareSceneObstaclesAndTextures) {
  const Shared world = std::make_shared<const World>(scene());
  const World evening_world(world, evening()), again(std::make_shared<const World>(world, evening()), Lighting());
  for (const World* other : {&evening_world, &again}) {
    EXPECT_EQ(&prepared(*other).scene(), &prepared(*world).scene());
    EXPECT_EQ(&prepared(*other).obstacles(), &prepared(*world).obstacles());
    EXPECT_EQ(other->triangles().vertices.data(), world->triangles().vertices.data());
    EXPECT_EQ(other->textures().data(), world->textures().data());
    EXPECT_EQ(other->original(), world.get());
  }
  EXPECT_NE(&prepared(evening_world).shading(), &prepared(*world).shading());
  // A world with other markers has another shape, but keeps the lighting.
  const Shared marked = evening_world.with_markers({});
  EXPECT_EQ(marked->original(), nullptr);
  EXPECT_EQ(marked->light().sun_color, evening().light.sun_color);
  EXPECT_EQ(marked->triangles().vertices, world->triangles().vertices);
}

TEST(Lighting, AreRefusedWithTheNameOfTheField) {
  const Shared world = std::make_shared<const World>(scene());
  Lighting lighting;
  lighting.tint = {{1, 1, 1}, {1, 1, 1}};
  EXPECT_REFUSED((void)World(world, lighting), "tint: ... 3 ... 2");
  lighting.tint = {{1, 1, -1}};
  EXPECT_REFUSED((void)World(world, lighting), "tint[2]: ... [0, 10] ... -1");
  lighting.tint = {{1, 1, 1}, {1, kNan, 1}, {1, 1, 1}};
  EXPECT_REFUSED((void)World(world, lighting), "tint[1][1]");
  lighting.tint = {};
  lighting.light.sun_direction = {0, 0, 0};
  EXPECT_REFUSED((void)World(world, lighting), "light.sun_direction");
}

// Each episode draws its lighting from its env's stream. The drones' behaviour is the same in every lighting.
TEST(Lighting, AreDrawnByEpisodesAndSetByEnv) {
  const Shared world = flockstep::playground({.seed = 3, .pillars = 4});
  const auto made = [&](std::size_t count) {
    NavigationBatch config = navigation_batch(6);
    config.episode.random_world = true;
    config.episode.max_episode_steps = 5;
    config.cameras = {{.width_px = 16, .height_px = 12, .outputs = {.rgb = true, .depth = true}}};
    Batch::Worlds worlds{world};
    for (std::size_t i = 1; i < count; ++i) {
      Lighting lighting;
      lighting.light.ground_ambient = lighting.light.sky_ambient = {0.1F * static_cast<float>(i), 0.3F, 0.2F};
      worlds.push_back(std::make_shared<const World>(world, lighting));
    }
    return config.make(worlds);
  };
  Batch many = made(5), again = made(5), one = made(1);
  for (Batch* batch : {&many, &again, &one}) batch->reset(std::vector<std::uint64_t>{1, 2, 3, 4, 5, 6});
  std::vector<std::int32_t> seen;
  for (int step = 0; step < 30; ++step) {
    const std::vector<std::int64_t> actions(6, step % 4);
    for (Batch* batch : {&many, &again, &one}) batch->step(actions);
    ASSERT_EQ(many.outputs().reward, one.outputs().reward);
    ASSERT_EQ(many.camera(0).images().depth, one.camera(0).images().depth);
    ASSERT_EQ(many.camera(0).images().rgb, again.camera(0).images().rgb);
    seen.insert(seen.end(), many.state().world_index.begin(), many.state().world_index.end());
  }
  std::sort(seen.begin(), seen.end());
  seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
  EXPECT_EQ(seen.size(), 5U);
  EXPECT_NE(many.camera(0).images().rgb, one.camera(0).images().rgb);
  many.set_world(std::vector<std::int32_t>(6, 0));
  many.sense();
  one.sense();
  EXPECT_EQ(many.camera(0).images().rgb, one.camera(0).images().rgb);
}

}  // namespace
}  // namespace flockstep
