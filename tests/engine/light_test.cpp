// What the sun does in pictures, of both backends against the oracle.

#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "picture_oracle.hpp"

namespace flockstep {
namespace {

using testing::camera_batch;
using testing::Compared;
using testing::expect_picture;
using testing::kAllOutputs;
using testing::primitive;
using enum PrimitiveKind;

CameraConfig camera_of(bool shadows, float hfov_deg = 90.0F) {
  CameraConfig camera;
  camera.width_px = 96;
  camera.height_px = 72;
  camera.hfov_deg = hfov_deg;
  camera.outputs = kAllOutputs;
  camera.shadows = shadows;
  return camera;
}

struct View {
  Vec3 from, towards;
};

class LitPictures : public ::testing::TestWithParam<CameraBackend> {
 protected:
  // A batch that has looked from each of the views; null where OpenGL is not installed.
  static std::unique_ptr<Batch> pictures(const Batch::Worlds& worlds, const CameraConfig& camera,
                                         const std::vector<View>& views) {
    BatchConfig config = camera_batch(camera, static_cast<int>(views.size()));
    config.camera_backend = GetParam();
    std::unique_ptr<Batch> batch;
    try {
      batch = std::make_unique<Batch>(config, worlds);
    } catch (const std::exception& error) {
      if (std::string(error.what()).find("not installed") == std::string::npos) throw;
      return nullptr;
    }
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
    for (std::size_t drone = 0; batch && drone < views.size(); ++drone) all += expect_picture(*batch, drone, 0, stride);
    return all;
  }
};

#define PICTURES_OR_SKIP(name, ...) \
  const auto name = __VA_ARGS__;    \
  if (name.pixels == 0) GTEST_SKIP() << "OpenGL is not installed"

// On a ground outside stands a room, open to the sun, which comes in and lights the floor but where a pillar stands; behind the
// room lies its shadow.
TEST_P(LitPictures, ARoomLetsTheSunInAndShadesWhatLiesBehindIt) {
  SceneDescription scene;
  scene.light.sun_direction = {-0.6F, 0.3F, 0.7F};
  scene.primitives = {primitive(room, {0, 0, 1.5F}, {2, 1.5F, 1.4F}), primitive(cylinder, {0.5F, 0, 1.5F}, {0.3F, 0.3F, 1.4F}),
                      primitive(plane, {0, 0, 0}, {12, 12, 0}), primitive(sphere, {4, -0.5F, 0.5F}, {0.5F, 0.5F, 0.5F})};
  scene.markers.goal = Vec3(3.5F, 1, 0.4F);
  const auto world = std::make_shared<const World>(scene);
  const std::vector<View> outside{{{9, -5, 5}, {3, -1, 0}}, {{7, 6, 2}, {3, 0, 0}}};
  PICTURES_OR_SKIP(out, compared(world, camera_of(true), outside, 3));
  EXPECT_GT(out.shaded, 250U);
  EXPECT_GT(out.lit, 500U);
  const std::vector<View> inside{{{-1.8F, -1.3F, 2.7F}, {0.5F, 0.3F, 0}}};
  const auto in = compared(world, camera_of(true), inside, 3);
  EXPECT_GT(in.shaded, 50U);
  EXPECT_GT(in.lit, 500U);
}

// A mast before the sun, and a world without one beside it.
TEST_P(LitPictures, TheSunStandsInTheSky) {
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
    PICTURES_OR_SKIP(wide, compared(world, camera_of(false), views, 3));
    EXPECT_GT(wide.sky, 3000U);
    EXPECT_GT(compared(world, camera_of(false, 4.0F), {views[0]}, 1).sky, 3000U);  // the disc's border, magnified
  }
}

TEST_P(LitPictures, OfWorldsWithAndWithoutASunInTheSky) {
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
  if (!batch) GTEST_SKIP() << "OpenGL is not installed";
  for (std::size_t drone = 0; drone < 3; ++drone) EXPECT_GT(expect_picture(*batch, drone, 0, 3).sky, 1000U);
  const auto& rgb = batch->images(0).rgb;
  const auto size = static_cast<std::ptrdiff_t>(rgb.size() / 3);
  EXPECT_TRUE(std::equal(rgb.begin(), rgb.begin() + size, rgb.begin() + 2 * size)) << "no sun, no disc";
  EXPECT_FALSE(std::equal(rgb.begin(), rgb.begin() + size, rgb.begin() + size));
}

INSTANTIATE_TEST_SUITE_P(Backends, LitPictures, ::testing::Values(CameraBackend::raycast, CameraBackend::gl),
                         [](const auto& info) { return std::string(info.param == CameraBackend::gl ? "Gl" : "Raycast"); });

}  // namespace
}  // namespace flockstep
