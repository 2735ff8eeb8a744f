// Bodies in camera images. A body must look like a solid of the world that stands at its place.
#include "render/body_surface.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "base/workers.hpp"
#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "flockstep/body.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"
#include "render/move_line.hpp"
#include "render/pinhole_camera.hpp"
#include "render/renderer.hpp"
#include "trace/tracer.hpp"
#include "world/scene_description.hpp"

namespace flockstep::render {
namespace {

using testing::facing;
using testing::primitive;
using testing::Random;
using testing::soup;

constexpr std::uint16_t kSemantic = 500;  // of the first body

// Bodies of one env, in arrays as a batch has them.
struct Crowd {
  std::vector<float> position, quat_wxyz, radius;
  std::vector<Primitive> solids;
  mutable std::vector<const Primitive*> pointers;  // to the solids, for the last view
  std::vector<BodySurface> surfaces;

  void add(const Primitive& solid, const std::array<float, 3>& color = {0.7F, 0.3F, 0.2F}) {
    for (const float p : solid.center) position.push_back(p);
    for (const float q : {solid.rotation.w(), solid.rotation.x(), solid.rotation.y(), solid.rotation.z()}) quat_wxyz.push_back(q);
    radius.push_back(solid.half_extents.norm());
    surfaces.push_back({color, static_cast<std::uint16_t>(kSemantic + solids.size())});
    solids.push_back(solid);
    solids.back().center = Vec3::Constant(99.0F);  // not read
  }
  VisibleBodies view() const {
    pointers.clear();
    for (const Primitive& solid : solids) pointers.push_back(&solid);
    return {{.position = position.data(),
             .quat_wxyz = quat_wxyz.data(),
             .radius = radius.data(),
             .solids = pointers.data(),
             .count = radius.size(),
             .readable = radius.size()},
            surfaces.data()};
  }
};

// One third stands upright, one third is turned about z, and one third is tilted.
Primitive random_solid_of(Random& random, PrimitiveKind kind, float reach) {
  Vec3 half(random.within(0.1F, 0.7F), random.within(0.1F, 0.7F), random.within(0.1F, 0.7F));
  if (kind != PrimitiveKind::box) half.y() = half.x();
  if (kind == PrimitiveKind::sphere) half.z() = half.x();
  if (kind == PrimitiveKind::capsule) half.z() += half.x();
  Primitive solid = primitive(kind, random.point(reach), half);
  const auto turn = random.generator()() % 3;
  const float angle = random.within(-3.0F, 3.0F);
  if (kind == PrimitiveKind::sphere || turn == 0) return solid;
  solid.rotation = turn == 1 ? Quat(std::cos(angle), 0.0F, 0.0F, std::sin(angle)) : random.rotation();
  solid.rotation = testing::make_world({solid})->primitives()[0].rotation;  // a world normalises it
  return solid;
}

Crowd random_crowd(Random& random, std::size_t count, float reach) {
  constexpr std::array kKinds{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
  Crowd crowd;
  for (std::size_t i = 0; i < count; ++i) {
    crowd.add(random_solid_of(random, kKinds[i % kKinds.size()], reach),
              {random.within(0.0F, 1.0F), random.within(0.0F, 1.0F), random.within(0.0F, 1.0F)});
  }
  return crowd;
}

// Adds the visible bodies to a scene as primitives with materials.
SceneDescription with_standing(SceneDescription scene, const Crowd& crowd) {
  for (std::size_t i = 0; i < crowd.solids.size(); ++i) {
    if (crowd.radius[i] < 0.0F) continue;
    Primitive solid = crowd.solids[i];
    solid.center = {crowd.position[3 * i], crowd.position[3 * i + 1], crowd.position[3 * i + 2]};
    solid.material = static_cast<std::uint16_t>(scene.materials.size());
    scene.materials.push_back({"body " + std::to_string(i), crowd.surfaces[i].color, crowd.surfaces[i].semantic});
    scene.primitives.push_back(solid);
  }
  return scene;
}

std::vector<SceneDescription> sceneries(Random& random) {
  std::vector<SceneDescription> scenes(4);
  for (SceneDescription& scene : scenes) scene.materials = {{"chalk", {0.7F, 0.7F, 0.6F}, 0}, {"moss", {0.2F, 0.5F, 0.2F}, 0}};
  scenes[0].primitives = {primitive(PrimitiveKind::room, {0, 0, 0}, {6, 6, 6})};
  scenes[0].markers = {.start = Vec3(1, 1, 1), .goal = Vec3(-2, 0, 1)};
  scenes[1].primitives = {primitive(PrimitiveKind::plane, {0, 0, -3}, {9, 9, 0}),
                          primitive(PrimitiveKind::box, {2, 1, -2}, {1, 1, 1}),
                          primitive(PrimitiveKind::cylinder, {-2, 2, 0}, {0.4F, 0.4F, 3})};
  // A sun in the sky, lights and shades that exceed the range of colours, and too few levels for ramps.
  scenes[1].light.sun_color = {4.0F, 3.0F, 1.0F};
  scenes[1].light.sky_ambient = scenes[1].light.ground_ambient = {0.0F, 0.02F, 0.1F};
  scenes[1].light.sun_direction = {0.0F, 0.6F, 0.8F};
  scenes[1].light.sun_radius_deg = 3.0F;
  scenes[2].primitives = {primitive(PrimitiveKind::plane, {0, 0, -3}, {9, 9, 0})};
  scenes[2].mesh = soup(random, 60);
  // A fence that is transparent in places.
  Texture bars{.name = "bars", .width_px = 8, .height_px = 8};
  for (int i = 0; i < 64; ++i) {
    for (const int byte : {40 * (i % 7), 255, 3 * i, i % 4 == 0 ? 0 : 255}) bars.rgba.push_back(static_cast<std::uint8_t>(byte));
  }
  scenes[3].textures = {bars};
  scenes[3].materials[0].texture = std::uint16_t{0};
  scenes[3].materials[0].alpha_cutoff = 0.5F;
  scenes[3].primitives = {primitive(PrimitiveKind::plane, {0, 0, -3}, {9, 9, 0})};
  scenes[3].primitives[0].material = 1;
  scenes[3].mesh.vertices = {{-4, 0, -3}, {4, 0, -3}, {4, 0, 3}, {-4, 0, 3}};
  scenes[3].mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  scenes[3].mesh.uv = {{0, 3}, {4, 3}, {4, 0}, {0, 0}};
  return scenes;
}

struct Shot {
  CameraConfig camera;
  PinholeCamera pinhole;
  std::vector<std::uint8_t> rgb, grey;
  std::vector<float> depth, normal;
  std::vector<std::uint16_t> semantic, instance;

  explicit Shot(const CameraConfig& config) : camera(config), pinhole(make_pinhole_camera(config)) {
    const std::size_t pixels = static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px);
    rgb.resize(3 * pixels);
    grey.resize(pixels);
    depth.resize(pixels);
    normal.resize(3 * pixels);
    semantic.resize(pixels);
    instance.resize(pixels);
  }

  RenderRequest request(const World& world, const Vec3& position, const Mat3& rotation, const VisibleBodies& bodies = {}) {
    return {.world = &world,
            .scene = &prepared(world).scene(),
            .shading = &prepared(world).shading(camera.shadows),
            .camera = &camera,
            .pinhole = &pinhole,
            .position = position,
            .rotation = rotation,
            .frame = {rgb.data(), depth.data(), semantic.data(), instance.data(), normal.data(), grey.data()},
            .bodies = bodies};
  }
  void take(Renderer& renderer, Workers& workers, const RenderRequest& request) {
    renderer.start(std::span(&request, 1));
    renderer.finish(std::span(&request, 1), workers);
  }
  std::size_t middle() const { return static_cast<std::size_t>((camera.height_px / 2) * camera.width_px + camera.width_px / 2); }
  bool shows_body(std::size_t pixel) const { return instance[pixel] >= kFirstBodyInstance; }
};

CameraConfig camera_with(bool shadows, int samples, DepthKind depth_kind = DepthKind::planar) {
  CameraConfig camera;
  camera.width_px = 48;
  camera.height_px = 36;
  camera.far_m = 9.0F;
  camera.near_m = 0.2F;
  camera.outputs = {.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true};
  camera.shadows = shadows;
  camera.samples_per_pixel = samples;
  camera.depth_kind = depth_kind;
  return camera;
}

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST(BodyImages, RaycastShowsBodiesAsStandingSolids) {
  Random random(391);
  Workers workers(1);
  Renderer renderer(CameraBackend::raycast, {}, workers);
  std::size_t shown = 0, shadowed = 0, whole = 0;
  for (const SceneDescription& scene : sceneries(random)) {
    for (const std::size_t count : {1U, 6U, 40U}) {
      Crowd crowd = random_crowd(random, count, 3.5F);
      const auto world = std::make_shared<const World>(scene);
      const auto standing = std::make_shared<const World>(with_standing(scene, crowd));
      for (const auto& camera :
           {camera_with(false, 1), camera_with(true, 1, DepthKind::range), camera_with(true, 4), camera_with(false, 9)}) {
        for (int i = 0; i < 12; ++i) {
          // From outside the crowd, between its bodies, and from within a body.
          const Vec3 middle(crowd.position[0], crowd.position[1], crowd.position[2]);
          const Vec3 position = i < 8 ? Vec3(5.0F * random.direction().normalized()) : i < 10 ? random.point(1.0F) : middle;
          const Mat3 rotation = facing({1, 0, 0}, random.point(1.0F) - position).toRotationMatrix();
          Shot with(camera), beside(camera), without(camera);
          with.take(renderer, workers, with.request(*world, position, rotation, crowd.view()));
          beside.take(renderer, workers, beside.request(*standing, position, rotation));
          without.take(renderer, workers, without.request(*world, position, rotation));
          ASSERT_TRUE(same_bytes(with.depth, beside.depth)) << count << ' ' << i;
          ASSERT_TRUE(same_bytes(with.normal, beside.normal)) << count << ' ' << i;
          ASSERT_TRUE(same_bytes(with.rgb, beside.rgb)) << count << ' ' << i;
          ASSERT_TRUE(same_bytes(with.grey, beside.grey)) << count << ' ' << i;
          ASSERT_TRUE(same_bytes(with.semantic, beside.semantic)) << count << ' ' << i;
          std::size_t bodies = 0;
          for (std::size_t pixel = 0; pixel < with.instance.size(); ++pixel) {
            const int body = with.semantic[pixel] - kSemantic;
            ASSERT_EQ(with.instance[pixel], body >= 0 && body < 100 ? kFirstBodyInstance + body : int{without.instance[pixel]});
            bodies += with.shows_body(pixel) ? 1 : 0;
            const bool same_thing = with.instance[pixel] == without.instance[pixel] && with.depth[pixel] == without.depth[pixel];
            shadowed += same_thing && with.grey[pixel] + 5 < without.grey[pixel] && camera.samples_per_pixel == 1 ? 1 : 0;
          }
          shown += bodies;
          whole += bodies == with.instance.size() ? 1 : 0;
        }
      }
    }
  }
  EXPECT_GT(shown, 100'000U);
  EXPECT_GT(shadowed, 2'000U);
  EXPECT_GT(whole, 10U);  // images from within a body
}

class BodyImagesOf : public ::testing::TestWithParam<CameraBackend> {
 protected:
  void SetUp() override {
    renderer_ = std::make_unique<Renderer>(GetParam(), std::span<const RenderRequest>(), workers_);
    if (GetParam() == CameraBackend::raycast) return;
    if (renderer_->report().find("not installed") != std::string::npos) GTEST_SKIP() << renderer_->report();
    ASSERT_EQ(renderer_->report().substr(0, 3), "gl:") << renderer_->report();
  }
  // Looks along x from the origin.
  void look(Shot& shot, const World& world, const Crowd& crowd) {
    shot.take(*renderer_, workers_, shot.request(world, Vec3::Zero(), Mat3::Identity(), crowd.view()));
  }

  std::vector<std::shared_ptr<const World>> worlds_;  // they must outlive the renderer
  Workers workers_{1};
  std::unique_ptr<Renderer> renderer_;
};

TEST_P(BodyImagesOf, EachShapeHasItsDepthAndItsIds) {
  worlds_.push_back(testing::make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})}));
  const Quat turned = facing({0, 0, 1}, {1, 0, 0});
  const std::vector<std::pair<Primitive, float>> cases{
      {primitive(PrimitiveKind::box, {4, 0, 0}, {0.5F, 1, 2}), 3.5F},
      {primitive(PrimitiveKind::box, {4, 0, 0}, {1, 1, 0.75F}, turned), 3.25F},
      {primitive(PrimitiveKind::cylinder, {4, 0, 0}, {0.5F, 0.5F, 2}), 3.5F},
      {primitive(PrimitiveKind::cylinder, {4, 0, 0}, {0.5F, 0.5F, 2}, turned), 2.0F},
      {primitive(PrimitiveKind::sphere, {4, 0, 0}, {1, 1, 1}), 3.0F},
      {primitive(PrimitiveKind::capsule, {4, 0, 0}, {0.5F, 0.5F, 2}), 3.5F},
      {primitive(PrimitiveKind::capsule, {4, 0, 0}, {0.5F, 0.5F, 2}, turned), 2.0F}};
  for (const auto& [solid, depth] : cases) {
    Crowd crowd;
    crowd.add(primitive(PrimitiveKind::sphere, {-4, 0, 0}, {1, 1, 1}));  // behind the camera
    crowd.add(solid);
    Shot shot(camera_with(false, 1));
    look(shot, *worlds_[0], crowd);
    EXPECT_NEAR(shot.depth[shot.middle()], depth, 0.01);
    EXPECT_NEAR(shot.normal[3 * shot.middle()], -1.0F, 0.02);
    EXPECT_EQ(shot.semantic[shot.middle()], kSemantic + 1);
    EXPECT_EQ(shot.instance[shot.middle()], kFirstBodyInstance + 1);
    EXPECT_EQ(shot.instance[0], 1);
  }
}

TEST_P(BodyImagesOf, TheNearestSurfaceHidesTheOthers) {
  worlds_.push_back(testing::make_world({primitive(PrimitiveKind::box, {4, 0, 0}, {0.1F, 3, 3})}));
  Crowd crowd;
  crowd.add(primitive(PrimitiveKind::sphere, {6, 0, 0}, {1, 1, 1}));  // behind the wall
  Shot shot(camera_with(false, 1));
  look(shot, *worlds_[0], crowd);
  EXPECT_EQ(shot.instance[shot.middle()], 1);
  EXPECT_NEAR(shot.depth[shot.middle()], 3.9F, 0.001);
  crowd.add(primitive(PrimitiveKind::box, {3, 0, 0}, {0.25F, 1, 1}));
  crowd.add(primitive(PrimitiveKind::capsule, {2, 0, 0}, {0.5F, 0.5F, 1}));
  look(shot, *worlds_[0], crowd);
  EXPECT_EQ(shot.instance[shot.middle()], kFirstBodyInstance + 2);
  EXPECT_NEAR(shot.depth[shot.middle()], 1.5F, 0.01);
  crowd.radius[2] = -1.0F;  // not visible any more
  look(shot, *worlds_[0], crowd);
  EXPECT_EQ(shot.instance[shot.middle()], kFirstBodyInstance + 1);
  EXPECT_NEAR(shot.depth[shot.middle()], 2.75F, 0.01);
  crowd.radius = {-1.0F, -1.0F, -1.0F};
  look(shot, *worlds_[0], crowd);
  EXPECT_EQ(shot.instance[shot.middle()], 1);
}

TEST_P(BodyImagesOf, ABodyThatReachesThroughTheNearPlaneShowsItsInside) {
  worlds_.push_back(testing::make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})}));
  for (const PrimitiveKind kind : {PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule}) {
    Crowd crowd;
    crowd.add(primitive(kind, {0, 0, 0}, {1.5F, 1.5F, kind == PrimitiveKind::capsule ? 3.0F : 1.5F}));
    Shot shot(camera_with(false, 1));
    look(shot, *worlds_[0], crowd);
    EXPECT_NEAR(shot.depth[shot.middle()], 1.5F, 0.01) << static_cast<int>(kind);
    EXPECT_NEAR(shot.normal[3 * shot.middle()], -1.0F, 0.02) << static_cast<int>(kind);
    EXPECT_TRUE(std::all_of(shot.instance.begin(), shot.instance.end(), [](auto id) { return id == kFirstBodyInstance; }));
    // Within the near plane entirely.
    Crowd small;
    small.add(primitive(kind, {0.1F, 0, 0}, {0.05F, 0.05F, 0.05F}));
    look(shot, *worlds_[0], small);
    EXPECT_TRUE(std::all_of(shot.instance.begin(), shot.instance.end(), [](auto id) { return id == 1; }));
  }
}

TEST_P(BodyImagesOf, BodiesCastShadowsAndReceiveThem) {
  SceneDescription scene;
  scene.materials = {{"chalk", {0.7F, 0.7F, 0.6F}, 0}};
  scene.primitives = {primitive(PrimitiveKind::plane, {4, 0, -1}, {4, 4, 0})};
  scene.light.sun_direction = {0.0F, 0.0F, 1.0F};
  worlds_.push_back(std::make_shared<const World>(scene));
  scene.primitives.push_back(primitive(PrimitiveKind::box, {3, 0, 9}, {1, 1, 1}));
  worlds_.push_back(std::make_shared<const World>(scene));
  // Looks down on the plane, 4 m ahead, and returns the colour there.
  const auto color_at = [&](const World& world, const Crowd& crowd, bool shadows) {
    Shot shot(camera_with(shadows, 1));
    const Mat3 down = facing({1, 0, 0}, Vec3(3, 0, -1)).toRotationMatrix();
    shot.take(*renderer_, workers_, shot.request(world, Vec3::Zero(), down, crowd.view()));
    return std::pair(int{shot.grey[shot.middle()]}, int{shot.instance[shot.middle()]});
  };
  const Crowd nobody;
  const auto lit = color_at(*worlds_[0], nobody, true);
  EXPECT_EQ(lit.second, 1);
  for (const PrimitiveKind kind : {PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule}) {
    Crowd above, aside, under;
    above.add(primitive(kind, {3, 0, 6}, {0.5F, 0.5F, 0.5F}));  // out of view
    aside.add(primitive(kind, {3, 0.6F, 6}, {0.5F, 0.5F, 0.5F}));
    under.add(primitive(kind, {3, 0, -1.6F}, {0.5F, 0.5F, 0.5F}));
    EXPECT_EQ(color_at(*worlds_[0], above, false), lit);
    EXPECT_LT(color_at(*worlds_[0], above, true).first, lit.first - 20) << static_cast<int>(kind);
    EXPECT_EQ(color_at(*worlds_[0], aside, true), lit);
    EXPECT_EQ(color_at(*worlds_[0], under, true), lit);
    // A body in the sun, in the shadow of another body, and in that of the world.
    Crowd seen;
    seen.add(primitive(PrimitiveKind::box, {3, 0, -1}, {0.4F, 0.4F, 0.05F}));
    const auto sunny = color_at(*worlds_[0], seen, true);
    EXPECT_EQ(sunny.second, kFirstBodyInstance);
    EXPECT_LT(color_at(*worlds_[1], seen, true).first, sunny.first - 20);
    seen.add(primitive(kind, {3, 0, 6}, {1, 1, 1}));
    EXPECT_LT(color_at(*worlds_[0], seen, true).first, sunny.first - 20) << static_cast<int>(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Backends, BodyImagesOf, ::testing::Values(CameraBackend::raycast, CameraBackend::gl));

// Envs with different bodies, an env without any, several drones in each env, and all shapes.
TEST(BodyImages, GlShowsWhatRaycastShows) {
  Random random(392);
  Workers workers(2);
  std::vector<std::shared_ptr<const World>> worlds;
  for (const SceneDescription& scene : sceneries(random)) worlds.push_back(std::make_shared<const World>(scene));
  Renderer raycast(CameraBackend::raycast, {}, workers), gl(CameraBackend::gl, {}, workers);
  if (gl.report().find("not installed") != std::string::npos) GTEST_SKIP() << gl.report();
  ASSERT_EQ(gl.report().substr(0, 3), "gl:") << gl.report();
  std::vector<Crowd> crowds;
  for (const std::size_t count : {20U, 0U, 40U, 3U}) crowds.push_back(random_crowd(random, count, 3.5F));
  for (const bool shadows : {false, true}) {
    for (const int samples : {1, 4}) {
      const CameraConfig camera = camera_with(shadows, samples);
      std::vector<Shot> ours, theirs;
      std::vector<RenderRequest> of_raycast, of_gl;
      constexpr std::size_t kFrames = 60;
      for (std::size_t i = 0; i < kFrames; ++i) {
        ours.emplace_back(camera);
        theirs.emplace_back(camera);
      }
      for (std::size_t i = 0; i < kFrames; ++i) {
        const std::size_t env = i / 3;  // of three drones each
        const World& world = *worlds[env % worlds.size()];
        const Vec3 position = random.point(4.0F);
        const Mat3 rotation = facing({1, 0, 0}, random.point(1.0F) - position).toRotationMatrix();
        // The camera must be one object, so that the frames are drawn together.
        for (auto* const shots : {&ours, &theirs}) {
          RenderRequest request = (*shots)[i].request(world, position, rotation, crowds[env % crowds.size()].view());
          request.camera = &(*shots)[0].camera;
          request.pinhole = &(*shots)[0].pinhole;
          (shots == &ours ? of_raycast : of_gl).push_back(request);
        }
      }
      raycast.start(of_raycast);
      raycast.finish(of_raycast, workers);
      gl.start(of_gl);
      gl.finish(of_gl, workers);
      ASSERT_EQ(gl.take_warning(), "");
      std::size_t pixels = 0, same_ids = 0, inner = 0, turned = 0, different = 0;
      for (std::size_t k = 0; k < kFrames; ++k) {
        const Shot &a = ours[k], &b = theirs[k];
        const auto width = static_cast<std::size_t>(camera.width_px);
        for (std::size_t pixel = 0; pixel < a.depth.size(); ++pixel) {
          ++pixels;
          same_ids += a.instance[pixel] == b.instance[pixel] && a.semantic[pixel] == b.semantic[pixel] ? 1 : 0;
          const std::size_t row = pixel / width, column = pixel % width;
          if (row == 0 || column == 0 || row + 1 == static_cast<std::size_t>(camera.height_px) || column + 1 == width) continue;
          bool is_inner = true;
          for (const std::size_t other : {pixel - width - 1, pixel - width, pixel - width + 1, pixel - 1, pixel, pixel + 1,
                                          pixel + width - 1, pixel + width, pixel + width + 1}) {
            is_inner &= a.instance[other] == a.instance[pixel] && b.instance[other] == a.instance[pixel];
          }
          if (!is_inner || !a.shows_body(pixel)) continue;
          ++inner;
          ASSERT_NEAR(a.depth[pixel] / b.depth[pixel], 1.0F, 1e-3F) << k << ' ' << pixel;
          float cosine = 0.0F;
          int apart = 0;
          for (std::size_t c = 0; c < 3; ++c) {
            cosine += a.normal[3 * pixel + c] * b.normal[3 * pixel + c];
            apart = std::max(apart, std::abs(int{a.rgb[3 * pixel + c]} - int{b.rgb[3 * pixel + c]}));
          }
          turned += cosine < 0.999F ? 1 : 0;
          different += apart > 1 ? 1 : 0;
        }
      }
      EXPECT_GT(inner, 5'000U);
      EXPECT_GE(static_cast<double>(same_ids), 0.995 * static_cast<double>(pixels));
      EXPECT_LE(static_cast<double>(turned), 0.01 * static_cast<double>(inner));     // at edges of boxes and cylinders
      EXPECT_LE(static_cast<double>(different), 0.01 * static_cast<double>(inner));  // there, and at edges of shadows
    }
  }
}

TEST(BodyImages, ASecondFrameAllocatesNothing) {
  Random random(393);
  Workers workers(1);
  Renderer renderer(CameraBackend::raycast, {}, workers);
  const World world(sceneries(random)[0]);
  Crowd crowd = random_crowd(random, 40, 3.0F);
  Shot shot(camera_with(true, 1));
  shot.take(renderer, workers, shot.request(world, Vec3::Zero(), Mat3::Identity(), crowd.view()));
  for (int i = 0; i < 20; ++i) {
    for (float& value : crowd.position) value += random.within(-0.2F, 0.2F);
    const RenderRequest request = shot.request(world, Vec3::Zero(), random.rotation().toRotationMatrix(), crowd.view());
    const std::uint64_t before = testing::allocations();
    shot.take(renderer, workers, request);
    EXPECT_EQ(testing::allocations() - before, 0U);
  }
}

TEST(LinePainter, BodiesHideLines) {
  Workers workers(1);
  const auto world = testing::make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})});
  Crowd crowd;
  crowd.add(primitive(PrimitiveKind::sphere, {3, 0, 0}, {0.5F, 0.5F, 0.5F}));
  Shot shot(camera_with(false, 1));
  const auto tracer = std::make_unique<trace::Tracer>();
  const auto green_at = [&](float depth, const VisibleBodies& bodies) {
    const RenderRequest request = shot.request(*world, Vec3::Zero(), Mat3::Identity(), bodies);
    std::fill(shot.rgb.begin(), shot.rgb.end(), std::uint8_t{0});
    LinePainter painter(request, shot.camera.width_px, shot.camera.height_px, *tracer);
    painter.add(std::array{Vec3(depth, -2, 0), Vec3(depth, 2, 0)});
    painter.draw(shot.rgb);
    return std::pair(int{shot.rgb[3 * shot.middle() + 1]}, int{shot.rgb[3 * (shot.middle() + 8) + 1]});
  };
  EXPECT_GT(green_at(4.0F, {}).first, 50);
  EXPECT_EQ(green_at(4.0F, crowd.view()).first, 0);
  EXPECT_GT(green_at(4.0F, crowd.view()).second, 50);  // beside the body
  EXPECT_GT(green_at(2.0F, crowd.view()).first, 50);
}

}  // namespace
}  // namespace flockstep::render
