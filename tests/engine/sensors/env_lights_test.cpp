#include "sensors/env_lights.hpp"

#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using sensors::EnvLights;
using namespace testing;

Light sunlight(float red) { return {.sun_direction = {0, 0, 1}, .sun_color = {red, 0.3F, 0.2F}}; }

Batch::Worlds two_worlds() { return {playground("train-1"), playground("validation-1")}; }

Batch camera_batch(const Batch::Worlds& worlds, int num_envs, CameraBackend backend = CameraBackend::raycast) {
  BatchConfig config{.num_envs = num_envs, .cameras = {{.width_px = 16, .height_px = 12}}, .camera_backend = backend};
  return Batch(config, worlds);
}

TEST(EnvLights, CopiesAreSharedAndFreed) {
  const Batch::Worlds worlds = two_worlds();
  EnvLights lights(worlds, 4, false);
  EXPECT_TRUE(lights.empty());
  EXPECT_EQ(lights.world(EnvIndex(1), 1), worlds[1]);
  lights.set(EnvIndex(0), sunlight(0.5F));
  lights.set(EnvIndex(2), sunlight(0.5F));
  lights.set(EnvIndex(3), sunlight(0.7F));
  EXPECT_FALSE(lights.empty());
  EXPECT_EQ(lights.world(EnvIndex(1), 0), worlds[0]);
  const std::weak_ptr<const World> first = lights.world(EnvIndex(0), 0), third = lights.world(EnvIndex(3), 0);
  EXPECT_EQ(first.lock()->original(), worlds[0].get());
  EXPECT_EQ(first.lock()->light().sun_color, sunlight(0.5F).sun_color);
  EXPECT_EQ(lights.world(EnvIndex(2), 0), first.lock());
  EXPECT_NE(lights.world(EnvIndex(2), 1), first.lock());
  lights.set(EnvIndex(0), sunlight(0.9F));
  lights.clear(EnvIndex(3));
  EXPECT_FALSE(first.expired());
  lights.free_unused();
  EXPECT_TRUE(first.expired());
  EXPECT_TRUE(third.expired());
  EXPECT_EQ(lights.world(EnvIndex(2), 0)->original(), worlds[0].get());
  EXPECT_EQ(lights.world(EnvIndex(3), 1), worlds[1]);
}

TEST(EnvLights, AnUnusedCopyIsUsedAgain) {
  const Batch::Worlds worlds = two_worlds();
  EnvLights lights(worlds, 2, true);
  lights.set(EnvIndex(0), sunlight(0.5F));
  const std::shared_ptr<const World> day = lights.world(EnvIndex(0), 0);
  lights.set(EnvIndex(0), sunlight(0.1F));
  static_cast<void>(lights.world(EnvIndex(0), 0));
  lights.set(EnvIndex(1), sunlight(0.5F));
  EXPECT_EQ(lights.world(EnvIndex(1), 0), day);
}

// A light for every step leaves few copies behind, with both backends.
TEST(EnvLights, ManyLightsDoNotGrowABatch) {
  for (const CameraBackend backend : {CameraBackend::raycast, CameraBackend::gl}) {
    Batch batch = camera_batch(two_worlds(), 3, backend);
    std::vector<std::weak_ptr<const World>> made;
    std::ptrdiff_t most = 0;
    for (int step = 0; step < 100; ++step) {
      const auto env = static_cast<std::size_t>(step % 3);
      std::vector<std::uint8_t> mask(3, 0);
      mask[env] = 1;
      batch.set_light(sunlight(0.01F * static_cast<float>(step)), mask);
      batch.sense();
      made.push_back(batch.world_of(EnvIndex(env)));
      most = std::max(most, std::ranges::count_if(made, [](const auto& world) { return !world.expired(); }));
    }
    EXPECT_EQ(most, 3);
  }
}

// The same for the light of a world.
TEST(EnvLights, ManyLightsOfAWorldDoNotGrowABatch) {
  for (const CameraBackend backend : {CameraBackend::raycast, CameraBackend::gl}) {
    Batch batch = camera_batch({playground("train-1")}, 2, backend);
    Batch made = camera_batch({playground("train-1")}, 2, backend);
    std::vector<std::weak_ptr<const World>> replaced;
    std::ptrdiff_t most = 0;
    for (int step = 0; step < 40; ++step) {
      replaced.push_back(batch.worlds()[0]);
      batch.set_light(0, {.light = sunlight(0.01F * static_cast<float>(step)), .tint = {}});
      batch.sense();
      most = std::max(most, std::ranges::count_if(replaced, [](const auto& world) { return !world.expired(); }));
    }
    EXPECT_LE(most, 1);
    made.set_light(batch.worlds()[0]->light());
    made.sense();
    EXPECT_EQ(batch.camera(0).images().rgb, made.camera(0).images().rgb);
  }
}

TEST(EnvLights, OneLightForEachEnv) {
  Batch batch = camera_batch(two_worlds(), 3);
  const std::vector<Light> lights{sunlight(0.1F), sunlight(0.2F), sunlight(0.3F)};
  batch.set_light(lights, std::vector<std::uint8_t>{1, 0, 1});
  EXPECT_EQ(batch.world_of(EnvIndex(0))->light().sun_color[0], 0.1F);
  EXPECT_EQ(batch.world_of(EnvIndex(1)), batch.worlds()[1]);
  EXPECT_EQ(batch.world_of(EnvIndex(2))->light().sun_color[0], 0.3F);
  EXPECT_REFUSED(batch.set_light(std::vector<Light>(2)), "lights: ... 3 ... 2");
  EXPECT_REFUSED(batch.set_light(Light(), std::vector<std::uint8_t>(2)), "mask: ... 3 ... 2");
  std::vector<Light> bad = lights;
  bad[1].sun_color[0] = kNan;
  EXPECT_REFUSED(batch.set_light(bad), "light.sun_color");
  EXPECT_EQ(batch.world_of(EnvIndex(1)), batch.worlds()[1]);
}

// Snapshots whose checksum is correct, but whose lights are not.
TEST(EnvLights, DamagedSnapshotsAreRefused) {
  Batch batch = camera_batch(two_worlds(), 3);
  batch.set_light(sunlight(0.625F), std::vector<std::uint8_t>{0, 1, 1});
  batch.sense();
  const std::string blob = batch.snapshot();
  const auto light_of = [](float red) {
    const Light light = sunlight(red);
    return std::string(reinterpret_cast<const char*>(&light), sizeof(light));
  };
  const std::size_t first = blob.find(light_of(0.625F));
  ASSERT_NE(first, std::string::npos);
  const auto edited = [&](std::size_t at, const auto& value) {
    std::string bytes = blob;
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    return mended(bytes);
  };
  const std::size_t env = first - sizeof(std::int32_t), sun = first + sizeof(Light::sun_direction);
  const std::size_t length = env - sizeof(std::uint64_t);
  for (const std::string& bad :
       {edited(env, std::int32_t{3}), edited(env, std::int32_t{-1}), edited(env, std::int32_t{2}), edited(sun, kNan),
        edited(sun, -1.0F), edited(first, std::array<float, 3>{}), edited(length, std::uint64_t{100})}) {
    EXPECT_REFUSED(batch.restore(bad), "snapshot");
    EXPECT_TRUE(batch.snapshot() == blob);
  }
  batch.restore(blob);
  EXPECT_TRUE(batch.snapshot() == blob);
}

}  // namespace
}  // namespace flockstep
