#include "trace/masks.hpp"

#include "batch_helpers.hpp"
#include "flockstep/raycast.hpp"
#include "meshes.hpp"
#include "on_target.hpp"
#include "picture_oracle.hpp"

namespace flockstep {
namespace {

using namespace testing;
using enum PrimitiveKind;

// A white checkerboard. Every second texel is transparent, the first one is opaque.
Texture checkers(int size) {
  Texture texture{"checkers", size, size, {}};
  for (int row = 0; row < size; ++row) {
    for (int column = 0; column < size; ++column) {
      texture.rgba.insert(texture.rgba.end(), {255, 255, 255, static_cast<std::uint8_t>((row + column) % 2 == 0 ? 255 : 0)});
    }
  }
  return texture;
}

// A grid at x = 2 and a red wall at x = 4. The grid fills a 90-degree view along x with 16 x 16 texels and extends beyond it.
SceneDescription grid_before_a_wall() {
  SceneDescription scene;
  scene.textures = {checkers(16)};
  scene.materials = {Material{"wall", {1, 0, 0}, 7}, Material{"grid", {0, 1, 0}, 9, std::uint16_t{0}, {}, 0.5F}};
  scene.primitives = {primitive(box, {4.5F, 0, 0}, {0.5F, 9, 9})};
  add_quad(scene, {2, 4, 4}, {0, -8, 0}, {0, 0, -8}, 1, {{{-0.5F, -0.5F}, {1.5F, -0.5F}, {1.5F, 1.5F}, {-0.5F, 1.5F}}});
  return scene;
}

// A texel covers 4 x 4 pixels, whose centres are at least an eighth of a texel from its border. At that distance an opaque
// texel has an alpha of 0.625^2 + 0.375^2 = 0.53, and a transparent one 0.47.
TEST(MaskedPictures, ShowTheBackgroundExactlyWhereTheMaskIsOpen) {
  const auto world = std::make_shared<const World>(grid_before_a_wall());
  std::vector<CameraOutputs> all{kAllOutputs};
  for (int i = 0; i < 5; ++i) {
    all.push_back({.rgb = i == 0, .depth = i == 1, .semantic = i == 2, .instance = i == 3, .normal = i == 4});
  }
  for (std::size_t i = 0; i < 2 * all.size(); ++i) {
    const CameraOutputs& outputs = all[i / 2];
    CameraConfig camera;
    camera.width_px = camera.height_px = 64;
    camera.hfov_deg = 90.0F;
    camera.outputs = outputs;
    BatchConfig config = camera_batch(camera);
    config.camera_backend = i % 2 == 0 ? CameraBackend::raycast : CameraBackend::gl;
    Batch batch(config, {world});
    batch.set_pose(std::vector<float>{0, 0, 0}, {});
    batch.sense();
    std::size_t wrong = 0;
    for (std::size_t row = 0; row < 64; ++row) {
      for (std::size_t column = 0; column < 64; ++column) {
        const bool opaque = (row / 4 + column / 4) % 2 == 0;
        const Pixel is = testing::pixel(batch, row, column);
        wrong += outputs.depth && std::abs(is.depth - (opaque ? 2.0F : 4.0F)) > 1e-4F;
        wrong += outputs.semantic && is.semantic != (opaque ? 9 : 7);
        wrong += outputs.instance && is.instance != (opaque ? 2 : 1);
        wrong += outputs.normal && (is.normal - Vec3(-1, 0, 0)).norm() > 1e-5F;
        wrong += outputs.rgb && ((is.rgb[0] == 0) != opaque || (is.rgb[1] == 0) == opaque);
      }
    }
    EXPECT_EQ(wrong, 0U);
  }
}

// The sun is overhead, above a grid at 2 m height. Below are a floor and a disc, which a drone views from 1 m. Each texel of
// the grid lights or shades a quarter metre of the floor, which is 2 x 2 pixels.
TEST(MaskedPictures, TheSunShinesThrough) {
  SceneDescription scene = grid_before_a_wall();
  scene.primitives = {primitive(box, {0, 0, -0.5F}, {9, 9, 0.5F}), primitive(disc, {0, 0, 0.001F}, {0.875F, 0.875F, 0})};
  scene.mesh = {};
  add_quad(scene, {2, 2, 2}, {0, -4, 0}, {-4, 0, 0}, 1, {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}});
  scene.light.sun_direction = {0, 0, 1};
  const auto world = std::make_shared<const World>(std::move(scene));
  CameraConfig camera;
  camera.width_px = camera.height_px = 16;
  camera.hfov_deg = 90.0F;
  camera.shadows = true;
  camera.outputs = kAllOutputs;
  Batch batch(camera_batch(camera), {world});
  const Quat down(Eigen::AngleAxisf(std::numbers::pi_v<float> / 2, Vec3::UnitY()));
  batch.set_pose(std::vector<float>{0, 0, 1}, std::vector<float>{down.w(), down.x(), down.y(), down.z()});
  batch.sense();
  const int lit = testing::pixel(batch, 6, 5).rgb[0];
  const int shaded = testing::pixel(batch, 4, 5).rgb[0];
  EXPECT_GT(lit, shaded + 20);
  std::size_t wrong = 0;
  for (std::size_t row = 0; row < 16; ++row) {
    for (std::size_t column = 0; column < 16; ++column) {
      // Texels 4 to 11 of the grid are above the image.
      const bool opaque = (row / 2 + column / 2) % 2 == 0;
      const Pixel is = testing::pixel(batch, row, column);
      wrong += std::abs(is.rgb[0] - (opaque ? shaded : lit)) > 1;
      EXPECT_LT(is.depth, 1.01F);
    }
  }
  EXPECT_EQ(wrong, 0U);
}

// Masks behind masks, with all wrap modes, some oblique, and surfaces without a mask next to them.
std::shared_ptr<const World> thicket() {
  SceneDescription scene;
  scene.textures = {patches(32, 32, 4, 1, {TextureWrap::repeat, TextureWrap::repeat}, true),
                    patches(24, 10, 3, 2, {TextureWrap::mirror, TextureWrap::clamp}, true),
                    patches(1, 1, 1, 3, {TextureWrap::repeat, TextureWrap::mirror}, true)};
  scene.textures[2].rgba[3] = 0;
  const auto leaves = [](const char* name, std::uint16_t texture, float cutoff) {
    return Material{name, {0.9F, 0.8F, 0.7F}, 0, texture, {}, cutoff};
  };
  scene.materials = {Material{"plain", {0.3F, 0.5F, 0.7F}},
                     leaves("floor", 0, 0.5F),
                     leaves("wall", 1, 0.4F),
                     leaves("whole", 0, 0.0F),
                     leaves("none", 2, 0.1F),
                     leaves("twin", 0, 0.7F)};
  scene.materials[2].emissive = {0, 0.1F, 0};
  add_quad(scene, {-10, -10, 0}, {20, 0, 0}, {0, 20, 0}, 1, {{{0, 0}, {7.5F, 0}, {7.5F, 7.5F}, {0, 7.5F}}});
  add_quad(scene, {8, -6, 0}, {0, 9, 0}, {0, 0, 5}, 2, {{{-1.3F, 1.4F}, {2.2F, 1.4F}, {2.2F, -0.5F}, {-1.3F, -0.5F}}});
  add_quad(scene, {2, 2, 0.3F}, {2, 1, 1}, {-1, 2, 1}, 5, {{{0.1F, 0.2F}, {1.3F, 0.7F}, {0.9F, 1.9F}, {-0.3F, 1.4F}}});
  add_quad(scene, {2, -5, 0.5F}, {1, 1, 0}, {0, 0, 2}, 0, {});
  add_quad(scene, {3, -2, 0.5F}, {1, 1, 0}, {0, 0, 1}, 3, {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}});
  add_quad(scene, {0.5F, -9, 0.1F}, {0, 18, 0}, {0, 0, 4}, 4, {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}});
  add_quad(scene, {5, -4, 0.2F}, {1, 7, 0.3F}, {0.5F, 0, 3}, 2, {{{0, 1}, {1, 1}, {1, 0}, {0, 0}}});
  scene.primitives = {primitive(box, {4, -1, 0.5F}, {0.4F, 0.4F, 0.5F}), primitive(box, {0, 0, -1}, {20, 20, 0.5F}),
                      primitive(sphere, {6, 2, 1}, {0.5F, 0.5F, 0.5F})};
  scene.primitives[0].material = 2;  // solids have no texture and therefore no mask
  return std::make_shared<const World>(std::move(scene));
}

TEST(MaskedPictures, AgreeWithTheOracle) {
  const auto world = thicket();
  Compared all;
  for (const bool shadows : {false, true}) {
    CameraConfig camera{.width_px = 160, .height_px = 120, .outputs = kAllOutputs, .shadows = shadows};
    Batch batch(camera_batch(camera, 3), {world});
    const Quat down(Eigen::AngleAxisf(0.5F, Vec3::UnitY()));
    const Quat aside(Eigen::AngleAxisf(-0.6F, Vec3::UnitZ()));
    std::vector<float> turns;
    for (const Quat& q : {Quat::Identity(), down, Quat(aside * down)}) turns.insert(turns.end(), {q.w(), q.x(), q.y(), q.z()});
    batch.set_pose(std::vector<float>{-4, 0, 1.5F, -1, 1, 3, 0, 0, 0.4F}, turns);
    batch.sense();
    for (std::size_t drone = 0; drone < 3; ++drone) all += expect_picture(batch, drone, 0, 7);
  }
  EXPECT_GT(all.clear, 10000U);
  EXPECT_GT(all.shaded, 500U);
  EXPECT_GT(all.lit, 2000U);
  for (int element = 0; element < 17; ++element) {
    const bool never = element == 13 || element == 14;  // "none" is fully transparent
    EXPECT_NE(all.elements.contains(element), never) << element;
  }
}

// Neighbouring entries in a backend's arrays must not matter.
TEST(MaskedPictures, OfSeveralWorlds) {
  SceneDescription other = grid_before_a_wall();
  other.textures.insert(other.textures.begin(), patches(5, 9, 1, 4, {TextureWrap::clamp, TextureWrap::mirror}, true));
  other.materials[1].texture = 1;
  SceneDescription plain;
  add_quad(plain, {3, -4, -2}, {0, 8, 1}, {0, -1, 6}, 0, {});
  CameraConfig camera{.width_px = 80, .height_px = 60, .outputs = kAllOutputs, .shadows = true};
  Batch batch(camera_batch(camera, 4),
              {std::make_shared<const World>(plain), thicket(), closet(), std::make_shared<const World>(std::move(other))});
  batch.set_pose(std::vector<float>{0, 0, 1, -4, 0, 1, 1, 1, 1, 0.3F, 0.1F, 0.2F}, {});
  batch.sense();
  for (std::size_t drone = 0; drone < 4; ++drone) EXPECT_GT(expect_picture(batch, drone, 0, 3).clear, 800U) << drone;
}

TEST(Masks, LidarsAndRaysIgnoreThem) {
  const World world(grid_before_a_wall());
  std::vector<float> origins, directions;
  for (int i = 0; i < 100; ++i) {
    origins.insert(origins.end(), {0, 0, 0});
    directions.insert(directions.end(), {2, 0.02F * static_cast<float>(i) - 1, 0.013F * static_cast<float>(i) - 0.6F});
  }
  const RayHits hits = raycast(world, origins, directions, 100.0F);
  for (std::size_t i = 0; i < 100; ++i) EXPECT_GE(hits.primitive[i], 1) << i;
  for (const TracerKind tracer : {TracerKind::embree, TracerKind::tiles}) {
    LidarConfig lidar{.channels = 16, .vfov_deg = 60.0F, .max_range_m = 10.0F};
    BatchConfig config = lidar_batch(1, lidar);
    config.tracer = tracer;
    Batch batch(config, {std::make_shared<const World>(grid_before_a_wall())});
    batch.set_pose(std::vector<float>{0, 0, 0}, {});
    batch.sense();
    const std::vector<float>& ranges = batch.lidar().readings().ranges;
    std::vector<float> beams(3 * ranges.size());
    batch.lidar().directions(beams);
    std::size_t met = 0;
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      if (beams[3 * i] <= 0.7F) continue;
      EXPECT_NEAR(ranges[i] * beams[3 * i], 2.0F, 1e-3F) << i;
      ++met;
    }
    EXPECT_GT(met, 100U);
  }
}

TEST(Masks, EverySimdTargetThreadAndNeighbourGivesTheSameBits) {
  const auto world = thicket();
  CameraConfig camera{.width_px = 70, .height_px = 50, .outputs = kAllOutputs, .samples_per_pixel = 4, .shadows = true};
  const auto pictures = [&](int drones, int threads) {
    BatchConfig config = camera_batch(camera, drones);
    config.num_threads = threads;
    Batch batch(config, {world});
    std::vector<float> places;
    for (int i = 0; i < drones; ++i)
      places.insert(places.end(), {-4.0F + static_cast<float>(i), 0.1F * static_cast<float>(i), 1.5F});
    batch.set_pose(places, {});
    batch.sense();
    std::vector<std::uint8_t> bytes;
    const CameraImages& images = batch.camera(0).images();
    const auto add = [&](const auto& array) {
      const auto part = std::as_bytes(std::span(array)).first(sizeof(array[0]) * array.size() / static_cast<std::size_t>(drones));
      for (const std::byte byte : part) bytes.push_back(static_cast<std::uint8_t>(byte));
    };
    add(images.rgb);
    add(images.depth);
    add(images.instance);
    add(images.normal);
    return bytes;
  };
  const auto first = pictures(1, 1);
  EXPECT_EQ(pictures(5, 1), first);
  EXPECT_EQ(pictures(7, 3), first);
  on_every_target([&] { EXPECT_EQ(pictures(1, 1), first); });
}

TEST(Masks, AreMadeOnlyForTransparentTriangles) {
  const auto masks = [](const auto& change) {
    SceneDescription scene = grid_before_a_wall();
    change(scene);
    return trace::Masks(World(std::move(scene)));
  };
  const trace::Masks some = masks([](auto&) {});
  EXPECT_FALSE(some.empty());
  EXPECT_NE(some.find(1), nullptr);
  EXPECT_TRUE(masks([](auto& s) { s.materials[1].alpha_cutoff = 0; }).empty());
  EXPECT_TRUE(masks([](auto& s) { s.materials[1].texture.reset(); }).empty());
  EXPECT_TRUE(masks([](auto& s) { s.mesh.materials = {0, 0}; }).empty());
  EXPECT_TRUE(masks([](auto& s) {
                for (std::size_t i = 3; i < s.textures[0].rgba.size(); i += 4) s.textures[0].rgba[i] = 255;
                s.materials[1].alpha_cutoff = 1;
              }).empty());
  const auto barely = [](float cutoff) {
    return [cutoff](auto& s) {
      for (std::size_t i = 3; i < s.textures[0].rgba.size(); i += 4) s.textures[0].rgba[i] = 254;
      s.materials[1].alpha_cutoff = cutoff;
    };
  };
  EXPECT_TRUE(masks(barely(0.996F)).empty());
  EXPECT_TRUE(masks(barely(0.997F)).lets_through(0, 0.2F, 0.3F));
}

TEST(Masks, BadCutoffsAreRefused) {
  const auto refusal = [](float cutoff) {
    SceneDescription scene = grid_before_a_wall();
    scene.materials[1].alpha_cutoff = cutoff;
    return testing::refusal([&] { World world(std::move(scene)); });
  };
  EXPECT_EQ(refusal(0.0F), "accepted");
  EXPECT_EQ(refusal(1.0F), "accepted");
  EXPECT_TRUE(names(refusal(-0.1F), "materials[1].alpha_cutoff: ... [0, 1] ... -0.100000"));
  EXPECT_TRUE(names(refusal(1.01F), "materials[1].alpha_cutoff: ... [0, 1] ... 1.010000"));
  EXPECT_TRUE(names(refusal(std::nanf("")), "materials[1].alpha_cutoff: ... [0, 1] ... nan"));
  EXPECT_TRUE(names(refusal(kInfinity), "materials[1].alpha_cutoff: ... [0, 1] ... inf"));
}

TEST(Masks, SceneFilesKeepThem) {
  SceneDescription scene = grid_before_a_wall();
  scene.materials[1].alpha_cutoff = 0.3F;
  const World world(std::move(scene));
  const auto again = World::from_json(world.to_json());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->materials()[1].alpha_cutoff, 0.3F);
  EXPECT_EQ(again->textures()[0].rgba, world.textures()[0].rgba);
  EXPECT_EQ(again->to_json().find("alpha_cutoff"), again->to_json().rfind("alpha_cutoff"));  // only one material has it
}

}  // namespace
}  // namespace flockstep
