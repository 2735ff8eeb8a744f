#include "formats/packed_world.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

#include "any_world.hpp"
#include "flockstep/generators.hpp"
#include "refusal.hpp"

namespace flockstep {
namespace {

void expect_equal(const World& world) {
  const auto again = World::from_bytes(world.to_bytes());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->name(), world.name());
  EXPECT_EQ(again->to_bytes(), world.to_bytes());
}

TEST(PackedWorld, AnyWorldComesBackEqual) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    SCOPED_TRACE(seed);
    expect_equal(testing::AnyWorld(seed).make());
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
  const std::string bytes = testing::AnyWorld(1).make().to_bytes();
  ASSERT_GT(World::from_bytes(bytes)->textures().size(), 0U);
  const std::string expected = "world: expected the bytes of a packed world of this version, got others";
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const std::string message = testing::refusal([&] { World::from_bytes(std::string_view(bytes).substr(0, size)); });
    ASSERT_NE(message, "accepted") << size;
  }
  std::string other = bytes;
  other[8 + std::string_view("flockstep packed world ").size()] = '0';
  EXPECT_EQ(testing::refusal([&] { World::from_bytes(other); }), expected);
  for (std::size_t i = 0; i < bytes.size(); ++i) {  // accepted or refused, without a crash
    std::string spoilt = bytes;
    spoilt[i] = static_cast<char>(~spoilt[i]);
    testing::refusal([&] { World::from_bytes(spoilt); });
  }
}

}  // namespace
}  // namespace flockstep
