#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "faulty_driver.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"
#include "render/gl/renderer.hpp"
#include "render/renderer.hpp"
#include "standard.hpp"

#if !defined(_WIN32)
#include <sys/wait.h>
#include <unistd.h>
#endif

namespace flockstep::render {
namespace {

using flockstep::testing::FaultyDriver;
using flockstep::testing::make_world;
using flockstep::testing::message_of;
using flockstep::testing::playground;
using flockstep::testing::primitive;
using flockstep::testing::Random;
using enum PrimitiveKind;

// Sets FLOCKSTEP_EGL during its lifetime.
class EglVariable {
 public:
  explicit EglVariable(const char* value) { setenv("FLOCKSTEP_EGL", value, 1); }
  ~EglVariable() { unsetenv("FLOCKSTEP_EGL"); }
};

// Returns a renderer, or null and the reason.
std::unique_ptr<GlRenderer> try_renderer(std::string& why) {
  try {
    return std::make_unique<GlRenderer>();
  } catch (const GlUnavailable& error) {
    why = error.what();
    return nullptr;
  }
}

// Skips the test if OpenGL is not installed. If Mesa or a driver is installed, the renderer must work.
#define NEEDS_RENDERER(name)                                                     \
  std::string no_renderer;                                                       \
  const std::unique_ptr<GlRenderer> name##_owner = try_renderer(no_renderer);    \
  if (!name##_owner && no_renderer.find("not installed") != std::string::npos) { \
    GTEST_SKIP() << no_renderer;                                                 \
  }                                                                              \
  ASSERT_TRUE(name##_owner) << no_renderer;                                      \
  [[maybe_unused]] GlRenderer& name = *name##_owner

CameraConfig camera_of(int width, int height, float hfov_deg = 90.0F) {
  CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.hfov_deg = hfov_deg;
  camera.outputs = {.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true};
  return camera;
}

struct Pose {
  Vec3 position = Vec3::Zero();
  Mat3 rotation = Mat3::Identity();
};

Pose looking(const Vec3& from, const Vec3& to) {
  const Vec3 forward = (to - from).normalized();
  const Vec3 left = Vec3::UnitZ().cross(forward).normalized();
  Pose pose{from, {}};
  pose.rotation << forward, left, forward.cross(left);
  return pose;
}

// Requests and their rendered images.
struct Album {
  CameraConfig camera;
  CameraOptics optics;
  std::vector<RenderRequest> requests;
  CameraImages images;
  Workers workers{2};

  explicit Album(const CameraConfig& config) : camera(config), optics(make_camera_optics(config)) {}
  Album(const Album&) = delete;
  Album& operator=(const Album&) = delete;

  void add(const World& world, const Pose& pose = {}) {
    requests.push_back(
        {&world, &prepared(world).scene(), &prepared(world).shading(), &camera, &optics, pose.position, pose.rotation, {}});
  }
  std::size_t pixels() const { return static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px); }

  // Allocates the images, fills them with values that no image has, and sets the targets of the requests.
  void prepare() {
    const auto room = [&](auto& images, bool wanted, std::size_t channels, auto value) {
      images.assign(wanted ? requests.size() * pixels() * channels : 0, value);
    };
    const CameraOutputs& outputs = camera.outputs;
    room(images.rgb, outputs.rgb, 3, std::uint8_t{77});
    room(images.depth, outputs.depth, 1, -1.0F);
    room(images.semantic, outputs.semantic, 1, std::uint16_t{777});
    room(images.instance, outputs.instance, 1, std::uint16_t{777});
    room(images.normal, outputs.normal, 3, -7.0F);
    room(images.grey, outputs.grey, 1, std::uint8_t{77});
    for (std::size_t i = 0; i < requests.size(); ++i) {
      const auto at = [&](auto& images, std::size_t channels) {
        return images.empty() ? nullptr : images.data() + i * pixels() * channels;
      };
      requests[i].frame = {at(images.rgb, 3),      at(images.depth, 1),  at(images.semantic, 1),
                           at(images.instance, 1), at(images.normal, 3), at(images.grey, 1)};
    }
  }

  void take(GlRenderer& renderer) {
    prepare();
    renderer.start(requests);
    renderer.finish(workers);
  }
  void take_by_raycast() {
    prepare();
    Renderer renderer(CameraBackend::raycast, workers);
    renderer.start(requests);
    renderer.finish(requests, workers);
  }

  std::array<std::uint8_t, 3> rgb(std::size_t request, int u, int v) const {
    const std::size_t at = request * pixels() + static_cast<std::size_t>(v * camera.width_px + u);
    return {images.rgb[3 * at], images.rgb[3 * at + 1], images.rgb[3 * at + 2]};
  }
  Vec3 normal(std::size_t pixel) const { return Vec3(images.normal.data() + 3 * pixel); }
};

// A world whose primitives cycle through three materials with the same light.
std::shared_ptr<const World> colorful(std::vector<Primitive> primitives, Markers markers = {}, TriangleMesh mesh = {}) {
  SceneDescription description;
  description.materials = {{"red", {0.8F, 0.2F, 0.1F}, 0}, {"green", {0.2F, 0.7F, 0.3F}, 40}, {"blue", {0.1F, 0.3F, 0.9F}, 7}};
  for (std::size_t i = 0; i < primitives.size(); ++i) primitives[i].material = static_cast<std::uint16_t>(i % 3);
  description.primitives = std::move(primitives);
  description.markers = std::move(markers);
  description.mesh = std::move(mesh);
  if (!description.mesh.triangles.empty() && description.mesh.objects.empty()) {
    for (std::size_t i = 0; i < description.mesh.triangles.size(); ++i) {
      description.mesh.materials.push_back(static_cast<std::uint16_t>(i % 3));
      description.mesh.objects.push_back(static_cast<std::uint16_t>(i % 5));
    }
  }
  return std::make_shared<const World>(std::move(description));
}

// Takes the album with both backends and compares what lies at least a pixel from an edge: there, the pixels around have the
// same instance, and normals that turn little.
void expect_true(Album& album, GlRenderer& renderer, double least_share) {
  album.take_by_raycast();
  const CameraImages traced = album.images;
  std::vector<Vec3> normals;
  for (std::size_t i = 0; i < traced.depth.size(); ++i) normals.push_back(album.normal(i));
  album.take(renderer);
  std::size_t inner = 0, bad = 0;
  const auto width = static_cast<std::size_t>(album.camera.width_px);
  for (std::size_t i = 0; i < traced.depth.size(); ++i) {
    const std::size_t column = i % width, row = i % album.pixels() / width;
    if (column == 0 || row == 0 || column + 1 == width || row + 1 == album.pixels() / width) continue;
    const auto is_like = [&](std::size_t other) {
      return traced.instance[other] == traced.instance[i] && (normals[other] - normals[i]).norm() < 0.4F;
    };
    bool is_inner = true;
    for (const std::size_t first : {i - width - 1, i - 1, i + width - 1}) {
      is_inner &= is_like(first) && is_like(first + 1) && is_like(first + 2);
    }
    if (!is_inner) continue;
    ++inner;
    const float depth = album.images.depth[i], expected = traced.depth[i];
    bool good = std::isinf(expected) ? std::isinf(depth) : std::abs(depth - expected) <= 1e-3F + 1e-3F * expected;
    good &= album.images.instance[i] == traced.instance[i] && album.images.semantic[i] == traced.semantic[i];
    good &= (album.normal(i) - normals[i]).norm() < 0.1F;  // round shapes have facets
    for (std::size_t k = 0; k < 3; ++k) good &= std::abs(album.images.rgb[3 * i + k] - traced.rgb[3 * i + k]) <= 8;
    if (good || ++bad > 5) continue;
    ADD_FAILURE() << "request " << i / album.pixels() << " at (" << column << ", " << row << "): depth " << depth << " for "
                  << expected << ", instance " << album.images.instance[i] << " for " << traced.instance[i] << ", normal "
                  << album.normal(i).transpose() << " for " << normals[i].transpose() << ", red " << int{album.images.rgb[3 * i]}
                  << " for " << int{traced.rgb[3 * i]};
  }
  EXPECT_EQ(bad, 0U) << "of " << inner;
  EXPECT_GE(static_cast<double>(inner), least_share * static_cast<double>(traced.depth.size()));
}

TEST(GlRenderer, ReportsItsDevice) {
  NEEDS_RENDERER(renderer);
  EXPECT_NE(renderer.description().find("OpenGL 4."), std::string::npos) << renderer.description();
}

// Primitives of all kinds with random rotations, some of them around a camera, in a room or under the sky, with markers and
// triangles.
std::shared_ptr<const World> jumble(Random& random, bool with_room, bool with_mesh) {
  std::vector<Primitive> primitives;
  if (with_room) primitives.push_back(primitive(room, random.point(0.5F), {7.0F, 6.5F, 4.0F}));
  for (int i = 0; i < 18; ++i) {
    const auto size = [&] { return random.within(0.1F, 1.2F); };
    const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere, plane, disc}[static_cast<std::size_t>(i) % 6];
    Vec3 half(size(), size(), size());
    if (kind != box && kind != plane) half.y() = half.x();
    if (kind == sphere) half.z() = half.x();
    if (kind == capsule) half.z() += half.x();
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const bool aligned = kind == sphere || random.within(0.0F, 1.0F) < 0.5F;
    primitives.push_back(primitive(kind, random.point(4.0F), half, aligned ? Quat::Identity() : random.rotation()));
  }
  TriangleMesh mesh;
  for (int i = 0; with_mesh && i < 12; ++i) {
    const Vec3 middle = random.point(4.0F);
    for (int k = 0; k < 3; ++k) mesh.vertices.emplace_back(middle + random.point(1.0F));
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    if (i > 0) mesh.triangles.push_back({3 * i - 1, 3 * i, 3 * i + 1});  // shares corners
  }
  Markers markers;
  markers.start = random.point(3.0F);
  markers.goal = random.point(3.0F);
  markers.waypoints = {random.point(3.0F), random.point(3.0F)};
  return colorful(std::move(primitives), std::move(markers), std::move(mesh));
}

TEST(GlRenderer, EveryKindFromOutsideAndInside) {
  NEEDS_RENDERER(renderer);
  Random random(5);
  std::vector<std::shared_ptr<const World>> worlds;
  for (int i = 0; i < 8; ++i) worlds.push_back(jumble(random, i % 2 == 0, i % 4 < 2));
  for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
    CameraConfig camera = camera_of(160, 120, kind == DepthKind::planar ? 90.0F : 60.0F);
    camera.depth_kind = kind;
    camera.near_m = kind == DepthKind::planar ? 0.05F : 1.0F;
    camera.far_m = kind == DepthKind::planar ? 100.0F : 6.0F;
    Album album(camera);
    for (std::size_t i = 0; i < 24; ++i) {
      const World& world = *worlds[i % worlds.size()];
      // Some cameras are inside a primitive or a marker.
      Vec3 position = random.point(4.0F);
      if (i % 3 == 0) position = world.primitives()[1 + i / 3].center;
      if (i % 12 == 1) position = *world.markers().start;
      album.add(world, {position, random.rotation().toRotationMatrix()});
    }
    expect_true(album, renderer, 0.8);
  }
}

// Worlds in other lights and tints share the geometry on the device, also after the first of them has gone.
TEST(GlRenderer, LightsAndTintsOfOneWorld) {
  NEEDS_RENDERER(renderer);
  Random random(6);
  const auto world = jumble(random, true, true);
  Light evening = world->light();
  evening.sun_direction = {0, 0.6F, 0.8F};
  evening.sun_color = {2.0F, 0.5F, 0.1F};
  evening.sun_radius_deg = 20.0F;
  evening.sun_glow = 0.5F;
  for (int i = 0; i < 2; ++i) {
    const World relit(world, {.light = evening, .tint = {}}),
        tinted(world, {.light = world->light(), .tint = {{0.3F, 0.6F, 1.0F}, {1.0F, 0.5F, 0.2F}, {0.4F, 0.9F, 0.6F}}});
    Album album(camera_of(60, 40));
    for (const World* const shown : {static_cast<const World*>(&relit), world.get(), static_cast<const World*>(&tinted)}) {
      album.add(*shown, looking({-3, 0, 0}, {0, 0, 0.5F}));
    }
    expect_true(album, renderer, 0.5);
    const auto image = [&](std::size_t i) {
      return std::span(album.images.rgb).subspan(3 * i * album.pixels(), 3 * album.pixels());
    };
    EXPECT_FALSE(std::ranges::equal(image(0), image(1)));
    EXPECT_FALSE(std::ranges::equal(image(2), image(1)));
  }
}

TEST(GlRenderer, AnOpenWorldShowsTheSunInTheSky) {
  NEEDS_RENDERER(renderer);
  SceneDescription scene;
  scene.primitives = {primitive(plane, {0, 0, -1}, {50, 50, 0})};
  scene.light.sun_direction = {0.8F, 0, 0.6F};
  scene.light.sun_radius_deg = 10.0F;
  const World world(scene);
  Album album(camera_of(80, 60));
  album.add(world, looking({0, 0, 0}, {1, 0, 0.5F}));
  expect_true(album, renderer, 0.8);
}

// Outputs that a camera does not write must not affect the others.
TEST(GlRenderer, EachOutputAlone) {
  NEEDS_RENDERER(renderer);
  Random random(9);
  const auto world = jumble(random, false, true);
  CameraConfig camera = camera_of(31, 20);
  Album all(camera);
  all.add(*world);
  all.take(renderer);
  for (bool CameraOutputs::* output : {&CameraOutputs::rgb, &CameraOutputs::depth, &CameraOutputs::semantic,
                                       &CameraOutputs::instance, &CameraOutputs::normal, &CameraOutputs::grey}) {
    camera.outputs = {.rgb = false};
    camera.outputs.*output = true;
    Album one(camera);
    one.add(*world);
    one.take(renderer);
    const auto same_if_there = [](const auto& a, const auto& b) { return a.empty() || a == b; };
    EXPECT_TRUE(same_if_there(one.images.rgb, all.images.rgb));
    EXPECT_TRUE(same_if_there(one.images.depth, all.images.depth));
    EXPECT_TRUE(same_if_there(one.images.semantic, all.images.semantic));
    EXPECT_TRUE(same_if_there(one.images.instance, all.images.instance));
    EXPECT_TRUE(same_if_there(one.images.normal, all.images.normal));
    EXPECT_TRUE(same_if_there(one.images.grey, all.images.grey));
  }
}

TEST(GlRenderer, SamplesAreAveragedAsWritten) {
  NEEDS_RENDERER(renderer);
  Random random(10);
  const auto world = jumble(random, true, true);
  const Pose pose = looking({-3, 0, 0}, {0, 0, 0});
  for (const int side : {2, 3}) {
    CameraConfig camera = camera_of(70, 44);
    camera.samples_per_pixel = side * side;
    Album smooth(camera);
    Album plain(camera_of(70, 44));
    Album fine(camera_of(70 * side, 44 * side));  // its pixels are the samples of `smooth`, of the same triangles
    for (Album* album : {&smooth, &plain, &fine}) {
      album->add(*world, pose);
      album->take(renderer);
    }
    EXPECT_EQ(smooth.images.depth, plain.images.depth);
    EXPECT_EQ(smooth.images.instance, plain.images.instance);
    EXPECT_EQ(smooth.images.normal, plain.images.normal);
    for (int v = 0; v < 44; ++v) {
      for (int u = 0; u < 70; ++u) {
        for (std::size_t k = 0; k < 3; ++k) {
          int sum = 0;
          for (int i = 0; i < side * side; ++i) sum += fine.rgb(0, u * side + i % side, v * side + i / side)[k];
          ASSERT_EQ(smooth.rgb(0, u, v)[k], (2 * sum + side * side) / (2 * side * side)) << side << ": " << u << ' ' << v;
        }
      }
    }
  }
}

TEST(GlRenderer, ManyWorldsAndManyTilesAreEachTheirOwnPicture) {
  NEEDS_RENDERER(renderer);
  Random random(11);
  std::vector<std::shared_ptr<const World>> worlds;
  for (int i = 0; i < 5; ++i) worlds.push_back(jumble(random, i % 2 == 0, i % 3 == 0));
  // More rows than fit in any texture.
  Album album(camera_of(16, 32));
  for (std::size_t i = 0; i < 600; ++i) {
    album.add(*worlds[i * i % worlds.size()], {random.point(3.0F), random.rotation().toRotationMatrix()});
  }
  album.take(renderer);
  for (std::size_t i = 0; i < album.requests.size(); i += i < 4 || i > 590 ? 1 : 97) {
    Album alone(album.camera);
    const RenderRequest& request = album.requests[i];
    alone.add(*request.world, {request.position, request.rotation});
    alone.take(renderer);
    std::size_t same = 0;
    for (std::size_t k = 0; k < alone.pixels(); ++k) {
      const std::size_t at = i * alone.pixels() + k;
      same += alone.images.instance[k] == album.images.instance[at] &&
                      (std::isinf(alone.images.depth[k]) ||
                       std::abs(alone.images.depth[k] - album.images.depth[at]) <= 2e-5F * alone.images.depth[k])
                  ? 1
                  : 0;
    }
    // The tile's position in the atlas affects the rounding of corners, so edge pixels may differ.
    EXPECT_GE(same, alone.pixels() - 5) << i;
  }
}

TEST(GlRenderer, CamerasOfSeveralSizesAtOnce) {
  NEEDS_RENDERER(renderer);
  Random random(12);
  const auto world = jumble(random, true, false);
  Album wide(camera_of(50, 10));
  Album high(camera_of(10, 50));
  high.camera.outputs = {.rgb = false, .depth = true};
  for (int i = 0; i < 6; ++i) {
    wide.add(*world, {random.point(3.0F), random.rotation().toRotationMatrix()});
    high.add(*world, {random.point(3.0F), random.rotation().toRotationMatrix()});
  }
  wide.prepare();
  high.prepare();
  std::vector<RenderRequest> both;
  for (std::size_t i = 0; i < 6; ++i) {
    both.push_back(wide.requests[i]);
    both.push_back(high.requests[i]);
  }
  renderer.start(both);
  renderer.finish(wide.workers);
  const CameraImages together_wide = wide.images;
  const CameraImages together_high = high.images;
  wide.take(renderer);
  high.take(renderer);
  EXPECT_EQ(wide.images.rgb, together_wide.rgb);
  EXPECT_EQ(wide.images.depth, together_wide.depth);
  EXPECT_EQ(high.images.depth, together_high.depth);
}

// With several samples the image is larger than any texture, so it is drawn in parts.
TEST(GlRenderer, PictureLargerThanATexture) {
  NEEDS_RENDERER(renderer);
  Random random(13);
  const auto world = jumble(random, true, true);
  CameraConfig camera = camera_of(8192, 3);
  camera.outputs = {.rgb = true, .depth = true, .instance = true};
  Album plain(camera);
  camera.samples_per_pixel = 16;
  Album smooth(camera);
  for (Album* album : {&plain, &smooth}) {
    album->add(*world);
    album->take(renderer);
  }
  std::size_t close = 0;
  std::size_t same = 0;
  for (std::size_t i = 0; i < plain.pixels(); ++i) {
    const bool is_close = std::abs(int{plain.images.rgb[3 * i]} - int{smooth.images.rgb[3 * i]}) <= 2;
    close += is_close ? 1 : 0;
    same += plain.images.instance[i] == smooth.images.instance[i] ? 1 : 0;
  }
  EXPECT_GE(close, plain.pixels() * 98 / 100);
  EXPECT_GE(same, plain.pixels() * 999 / 1000);
}

TEST(GlRenderer, BigMeshIsCulledAndNothingIsLost) {
  NEEDS_RENDERER(renderer);
  // Terrain of 2 x 40 x 40 triangles, which takes several chunks.
  constexpr int kSide = 40;
  TriangleMesh mesh;
  Random random(14);
  for (int i = 0; i <= kSide; ++i) {
    for (int k = 0; k <= kSide; ++k) {
      mesh.vertices.emplace_back(static_cast<float>(i - kSide / 2), static_cast<float>(k - kSide / 2),
                                 random.within(-0.3F, 0.3F));
    }
  }
  for (int i = 0; i < kSide; ++i) {
    for (int k = 0; k < kSide; ++k) {
      const int a = i * (kSide + 1) + k;
      mesh.triangles.push_back({a, a + kSide + 1, a + 1});
      mesh.triangles.push_back({a + 1, a + kSide + 1, a + kSide + 2});
    }
  }
  const auto world = colorful({primitive(room, {0, 0, 0}, {30, 30, 30})}, {}, std::move(mesh));
  Album album(camera_of(160, 120));
  for (int i = 0; i < 3; ++i) {
    album.add(*world, {random.point(5.0F) + Vec3(0, 0, 6), random.rotation().toRotationMatrix()});
  }
  expect_true(album, renderer, 0.5);
}

TEST(GlRenderer, SameRequestsAgainAllocateNothing) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(64, 48));
  Random random(15);
  for (int i = 0; i < 40; ++i) album.add(*world, {Vec3(7, 7, 2) + random.point(1.5F), random.rotation().toRotationMatrix()});
  album.prepare();
  const auto take = [&] {
    renderer.start(album.requests);
    renderer.finish(album.workers);
  };
  for (int i = 0; i < 3; ++i) take();
  const std::uint64_t before = flockstep::testing::allocations_of_this_thread();
  for (int i = 0; i < 5; ++i) take();
  EXPECT_EQ(flockstep::testing::allocations_of_this_thread() - before, 0U);
}

TEST(GlRenderer, NothingToDo) {
  NEEDS_RENDERER(renderer);
  Workers workers(1);
  renderer.start({});
  renderer.finish(workers);
}

TEST(GlRenderer, StartedAndNeverFinished) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(16, 32));
  for (int i = 0; i < 800; ++i) album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  album.prepare();
  renderer.start(album.requests);  // more rounds than are read back ahead
  Album another(camera_of(24, 24));
  another.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  another.take(renderer);
  EXPECT_NE(another.images.instance[0], 0);
  renderer.start(album.requests);
}

TEST(GlRenderer, ManyMadeAndDestroyedAndTwoAtOnce) {
  NEEDS_RENDERER(first);
  Random random(16);
  const auto world = jumble(random, true, true);
  Album expected(camera_of(24, 24));
  expected.add(*world);
  expected.take(first);
  for (int i = 0; i < 12; ++i) {
    GlRenderer another;
    Album album(expected.camera);
    Album again(expected.camera);
    album.add(*world);
    again.add(*world);
    album.prepare();
    again.prepare();
    another.start(album.requests);
    first.start(again.requests);
    another.finish(album.workers);
    first.finish(again.workers);
    EXPECT_EQ(album.images.depth, expected.images.depth);
    EXPECT_EQ(again.images.rgb, expected.images.rgb);
  }
}

TEST(GlRenderer, ABatchRefusesWhatItDoesNotDraw) {
  const std::string fog = "fog_visibility_m: expected 0 with camera_backend=\"gl\", which draws no fog, got 5";
  const auto world = playground("camera-train-1");
  Light foggy = world->light();
  foggy.fog_visibility_m = 5.0F;
  BatchConfig config;
  config.camera_backend = CameraBackend::gl;
  config.cameras = {camera_of(8, 6)};
  config.cameras[0].shadows = true;
  EXPECT_REFUSED(Batch(config, {world}), "shadows: expected False with camera_backend=\"gl\", got True");
  config.cameras[0].shadows = false;
  EXPECT_REFUSED(Batch(config, {world, std::make_shared<const World>(world, Lighting{.light = foggy, .tint = {}})}), fog);
  config.lights = {world->light(), foggy};
  EXPECT_REFUSED(Batch(config, {world}), fog);
  config.lights.clear();
  Batch batch(config, {world});
  batch.sense();
  const std::string before = batch.snapshot();
  EXPECT_REFUSED(batch.set_light(0, {.light = foggy, .tint = {}}), fog);
  EXPECT_REFUSED(batch.set_light(foggy), fog);
  BatchConfig by_raycast = config;
  by_raycast.camera_backend = CameraBackend::raycast;
  Batch in_fog(by_raycast, {world});
  in_fog.set_light(foggy);
  EXPECT_REFUSED(batch.restore(in_fog.snapshot()), fog);
  EXPECT_EQ(batch.snapshot(), before);
  config.cameras.clear();
  Batch blind(config, {world});
  blind.set_light(foggy);  // no camera shows it
}

TEST(GlRenderer, WithoutEglItReportsWhy) {
  const EglVariable variable("none");
  EXPECT_THROW(GlRenderer(), GlUnavailable);
  EXPECT_NE(message_of([] { GlRenderer renderer; }).find("FLOCKSTEP_EGL=none"), std::string::npos);
}

TEST(GlRenderer, UnknownDevicesAreRefused) {
  const EglVariable variable("please");
  EXPECT_NE(message_of([] { GlRenderer renderer; }).find("FLOCKSTEP_EGL"), std::string::npos);
}

TEST(GlRenderer, FailingAndHangingOnTheWay) {
  NEEDS_RENDERER(good);
  const auto world = playground("camera-train-1");
  const auto why_not = [&](GlRenderer& renderer) {
    Album album(camera_of(16, 16));
    album.add(*world);
    return message_of([&] { album.take(renderer); });
  };
  for (const auto& [fault, why] : {std::pair{FaultyDriver::Fault::error, "OpenGL failed with error 1285"},
                                   {FaultyDriver::Fault::hang, "the OpenGL driver did not answer within 200 ms"}}) {
    const FaultyDriver driver(fault);
    GlRenderer renderer(fault == FaultyDriver::Fault::hang ? std::chrono::milliseconds(200) : GlRenderer::kPatience);
    EXPECT_EQ(why_not(renderer), why);
    EXPECT_EQ(why_not(renderer), why);  // it stays unusable
  }
  {
    // The device fails in the second round while the caller writes the first. The images being read must stay valid.
    const FaultyDriver driver(FaultyDriver::Fault::error, 1);
    GlRenderer renderer;
    Album many(camera_of(16, 32));
    for (int i = 0; i < 1200; ++i) many.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
    EXPECT_THROW(many.take(renderer), GlUnavailable);
    EXPECT_NE(many.images.instance[0], 0);
    EXPECT_THROW(many.take(renderer), GlUnavailable);
  }
  Album album(camera_of(16, 16));
  album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  album.take(good);  // other renderers still work
  EXPECT_NE(album.images.instance[0], 0);
}

#if !defined(_WIN32)
TEST(GlRenderer, AForkedChildDoesNotUseIt) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(16, 16));
  album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  auto shared = std::make_unique<GlRenderer>();
  album.take(*shared);
  const pid_t child = fork();
  if (child == 0) {
    bool refused = false;
    try {
      shared->start(album.requests);
    } catch (const GlUnavailable&) {
      refused = true;
    }
    shared.reset();
    _exit(refused ? 7 : 8);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 7);
  album.take(*shared);
  EXPECT_NE(album.images.instance[0], 0);
}
#endif

}  // namespace
}  // namespace flockstep::render
