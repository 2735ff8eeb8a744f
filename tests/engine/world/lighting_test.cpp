// Worlds with the same geometry in different light.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/generators.hpp"
#include "picture_oracle.hpp"
#include "prepared/prepared_world.hpp"
#include "render/raycast/shading.hpp"

namespace flockstep {
namespace {

using Shared = std::shared_ptr<const World>;
using testing::primitive;
using enum PrimitiveKind;

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

CameraConfig camera() {
  CameraConfig camera;
  camera.width_px = 64;
  camera.height_px = 48;
  camera.outputs = testing::kAllOutputs;
  camera.shadows = true;
  return camera;
}

void expect_same_pictures(const Batch& a, const Batch& b) {
  const CameraImages &x = a.images(0), &y = b.images(0);
  EXPECT_EQ(x.rgb, y.rgb);
  EXPECT_EQ(x.depth, y.depth);
  EXPECT_EQ(x.semantic, y.semantic);
  EXPECT_EQ(x.normal, y.normal);
}

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
  expect_same_pictures(*pictures(world), *pictures(expected));
  const auto before = testing::look(std::make_shared<const World>(scene()), camera(), Vec3(0, 0, 1));
  EXPECT_NE(pictures(world)->images(0).rgb, before->images(0).rgb);
  EXPECT_EQ(pictures(world)->images(0).depth, before->images(0).depth);
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
  const auto refusal = [&](const Lighting& lighting) -> std::string {
    try {
      static_cast<void>(World(world, lighting));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "taken";
  };
  Lighting lighting;
  lighting.tint = {{1, 1, 1}};
  EXPECT_NE(refusal(lighting).find("tint: expected 3 colours"), std::string::npos) << refusal(lighting);
  lighting.tint = {{1, 1, 1}, {1, std::numeric_limits<float>::quiet_NaN(), 1}, {1, 1, 1}};
  EXPECT_NE(refusal(lighting).find("tint[1]"), std::string::npos) << refusal(lighting);
  lighting.tint = {};
  lighting.light.sun_direction = {0, 0, 0};
  EXPECT_NE(refusal(lighting).find("light.sun_direction"), std::string::npos) << refusal(lighting);
}

// Each episode draws its lighting from its env's stream. The drones' behaviour is the same in every lighting.
TEST(Lighting, AreDrawnByEpisodesAndSetByEnv) {
  const Shared world = playground({.seed = 3, .pillars = 4});
  const auto made = [&](std::size_t count) {
    testing::NavigationBatch config = testing::navigation_batch(6);
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
    ASSERT_EQ(many.images(0).depth, one.images(0).depth);
    ASSERT_EQ(many.images(0).rgb, again.images(0).rgb);
    seen.insert(seen.end(), many.state().world_index.begin(), many.state().world_index.end());
  }
  std::sort(seen.begin(), seen.end());
  seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
  EXPECT_EQ(seen.size(), 5U);
  EXPECT_NE(many.images(0).rgb, one.images(0).rgb);
  many.set_world(std::vector<std::int32_t>(6, 0));
  many.sense();
  one.sense();
  EXPECT_EQ(many.images(0).rgb, one.images(0).rgb);
}

}  // namespace
}  // namespace flockstep
