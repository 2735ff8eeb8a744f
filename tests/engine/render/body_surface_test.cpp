// Bodies in camera images. A body must look like a solid of the world that stands at its place.

#include <tuple>

#include "allocation_counter.hpp"
#include "base/workers.hpp"
#include "batch_helpers.hpp"
#include "bodies/body_model.hpp"
#include "bundles.hpp"
#include "flockstep/body.hpp"
#include "prepared/prepared_world.hpp"
#include "render/appearance.hpp"
#include "render/camera_optics.hpp"
#include "render/move_line.hpp"
#include "render/renderer.hpp"
#include "trace/tracer.hpp"
#include "world/scene_description.hpp"

namespace flockstep::render {
namespace {

using namespace testing;

constexpr std::uint16_t kSemantic = 500;  // of the first body

// OpenGL is optional: tests of it are skipped where it is not installed, and fail where it is but does not work.
bool lacks_gl(const Renderer& renderer) { return renderer.report().find("not installed") != std::string::npos; }

// Bodies of one env, in arrays as a batch has them.
struct Crowd {
  std::vector<float> position, quat_wxyz, radius;
  std::vector<Primitive> solids;
  mutable std::vector<const Primitive*> pointers;  // to the solids, for the last view
  std::vector<BodySurface> surfaces;
  std::vector<const trace::Scene*> meshes;

  void add(const Primitive& solid, const std::array<float, 3>& color = {0.7F, 0.3F, 0.2F}) {
    for (const float p : solid.center) position.push_back(p);
    for (const float q : {solid.rotation.w(), solid.rotation.x(), solid.rotation.y(), solid.rotation.z()}) quat_wxyz.push_back(q);
    radius.push_back(solid.half_extents.norm());
    surfaces.push_back({color, static_cast<std::uint16_t>(kSemantic + solids.size())});
    solids.push_back(solid);
    solids.back().center = Vec3::Constant(99.0F);  // not read
    meshes.push_back(nullptr);
  }
  void add_mesh(const bodies::BodyModel& model, const Vec3& at, const Quat& rotation) {
    add({.center = at, .rotation = rotation});
    radius.back() = model.radius;
    const std::uint16_t semantic = surfaces.back().semantic;
    surfaces.back() = model.surface;
    surfaces.back().semantic = semantic;
    meshes.back() = model.mesh;
  }
  VisibleBodies view() const {
    pointers.clear();
    for (const Primitive& solid : solids) pointers.push_back(&solid);
    return {{.position = position.data(),
             .quat_wxyz = quat_wxyz.data(),
             .radius = radius.data(),
             .solids = pointers.data(),
             .meshes = meshes.data(),
             .count = radius.size()},
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
  solid.rotation = make_world({solid})->primitives()[0].rotation;  // a world normalises it
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
  CameraOptics optics;
  std::vector<std::uint8_t> rgb, grey;
  std::vector<float> depth, normal;
  std::vector<std::uint16_t> semantic, instance;

  explicit Shot(const CameraConfig& config) : camera(config), optics(make_camera_optics(config)) {
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
            .optics = &optics,
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
  Renderer renderer(CameraBackend::raycast, workers);
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
    renderer_ = std::make_unique<Renderer>(GetParam(), workers_);
    if (GetParam() == CameraBackend::raycast) return;
    if (lacks_gl(*renderer_)) GTEST_SKIP() << renderer_->report();
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
  worlds_.push_back(make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})}));
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
  worlds_.push_back(make_world({primitive(PrimitiveKind::box, {4, 0, 0}, {0.1F, 3, 3})}));
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
  worlds_.push_back(make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})}));
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

class BodyShadows : public BodyImagesOf {};

TEST_P(BodyShadows, OfSolids) {
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

// Differences between two sets of images of the same bodies.
struct Differences {
  std::size_t pixels = 0, same_ids = 0;
  std::size_t inner = 0;  // pixels within a face of a body in both images: those around them show the same face
  std::size_t deep = 0, turned = 0, different = 0;  // inner pixels of another depth, normal, colour

  void add(const Shot& a, const Shot& b) {
    const auto width = static_cast<std::size_t>(a.camera.width_px), height = static_cast<std::size_t>(a.camera.height_px);
    const auto cosine = [](const Shot& x, std::size_t i, const Shot& y, std::size_t j) {
      float sum = 0.0F;
      for (std::size_t c = 0; c < 3; ++c) sum += x.normal[3 * i + c] * y.normal[3 * j + c];
      return sum;
    };
    for (std::size_t pixel = 0; pixel < a.depth.size(); ++pixel) {
      ++pixels;
      same_ids += a.instance[pixel] == b.instance[pixel] && a.semantic[pixel] == b.semantic[pixel] ? 1 : 0;
      const std::size_t row = pixel / width, column = pixel % width;
      if (row == 0 || column == 0 || row + 1 == height || column + 1 == width) continue;
      bool is_inner = true;
      for (const std::size_t other : {pixel - width - 1, pixel - width, pixel - width + 1, pixel - 1, pixel, pixel + 1,
                                      pixel + width - 1, pixel + width, pixel + width + 1}) {
        is_inner &= a.instance[other] == a.instance[pixel] && b.instance[other] == a.instance[pixel];
        is_inner &= cosine(a, pixel, a, other) > 0.9999F && cosine(b, pixel, b, other) > 0.9999F;
      }
      if (!is_inner || !a.shows_body(pixel)) continue;
      ++inner;
      deep += std::abs(a.depth[pixel] / b.depth[pixel] - 1.0F) > 1e-3F ? 1 : 0;
      turned += cosine(a, pixel, b, pixel) < 0.999F ? 1 : 0;
      int apart = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        apart = std::max(apart, std::abs(int{a.rgb[3 * pixel + c]} - int{b.rgb[3 * pixel + c]}));
      }
      different += apart > 1 ? 1 : 0;
    }
  }
};

// Three drones of each env take the same pictures with both backends. Env e is in world e and has the bodies of crowd e, each
// modulo their number.
Differences between_backends(Random& random, Renderer& raycast, Renderer& gl, Workers& workers,
                             const std::vector<std::shared_ptr<const World>>& worlds, const std::vector<Crowd>& crowds,
                             const CameraConfig& camera) {
  std::vector<Shot> ours, theirs;
  std::vector<RenderRequest> of_raycast, of_gl;
  constexpr std::size_t kFrames = 60;
  for (std::size_t i = 0; i < kFrames; ++i) {
    ours.emplace_back(camera);
    theirs.emplace_back(camera);
  }
  for (std::size_t i = 0; i < kFrames; ++i) {
    const std::size_t env = i / 3;
    const World& world = *worlds[env % worlds.size()];
    const Vec3 position = random.point(4.0F);
    const Mat3 rotation = facing({1, 0, 0}, random.point(1.0F) - position).toRotationMatrix();
    // The camera must be one object, so that the frames are drawn together.
    for (auto* const shots : {&ours, &theirs}) {
      RenderRequest request = (*shots)[i].request(world, position, rotation, crowds[env % crowds.size()].view());
      request.camera = &(*shots)[0].camera;
      request.optics = &(*shots)[0].optics;
      (shots == &ours ? of_raycast : of_gl).push_back(request);
    }
  }
  raycast.start(of_raycast);
  raycast.finish(of_raycast, workers);
  gl.start(of_gl);
  gl.finish(of_gl, workers);
  EXPECT_EQ(gl.take_warning(), "");
  Differences differences;
  for (std::size_t i = 0; i < kFrames; ++i) differences.add(ours[i], theirs[i]);
  return differences;
}

// A texture of random colours. holes: a quarter of its texels is transparent.
Texture speckles(Random& random, const char* name, bool holes) {
  Texture texture{.name = name, .width_px = 8, .height_px = 8};
  for (int i = 0; i < 64; ++i) {
    for (int c = 0; c < 3; ++c) texture.rgba.push_back(static_cast<std::uint8_t>(random.within(20.0F, 250.0F)));
    texture.rgba.push_back(holes && i % 4 == 0 ? std::uint8_t{0} : std::uint8_t{255});
  }
  return texture;
}

// Worlds of mesh bodies. Their light and their markers must not matter.
std::vector<SceneDescription> mesh_sceneries(Random& random) {
  std::vector<SceneDescription> scenes(4);
  // A crate whose faces have corners of their own, with a texture on most and a face that emits light.
  SceneDescription& crate = scenes[0];
  crate.textures = {speckles(random, "wood", false)};
  crate.materials = {{"wood", {0.9F, 0.8F, 0.7F}, 3, std::uint16_t{0}}, {"lamp", {0.2F, 0.2F, 0.2F}, 4}};
  crate.materials[1].emissive = {0.1F, 0.4F, 0.2F};
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {-1.0F, 1.0F}) {
      const auto first = static_cast<std::int32_t>(crate.mesh.vertices.size());
      for (const auto& [u, v] : {std::pair{-1.0F, -1.0F}, {1.0F, -1.0F}, {1.0F, 1.0F}, {-1.0F, 1.0F}}) {
        Vec3 corner;
        corner[axis] = 0.7F * side;
        corner[(axis + 1) % 3] = 0.9F * u * side;
        corner[(axis + 2) % 3] = 0.6F * v;
        crate.mesh.vertices.push_back(corner + Vec3(0.3F, 0, 0));
        crate.mesh.uv.push_back({1.5F * u, v});
      }
      crate.mesh.triangles.push_back({first, first + 1, first + 2});
      crate.mesh.triangles.push_back({first, first + 2, first + 3});
      const std::uint16_t material = axis == 2 && side > 0.0F ? 1 : 0;
      crate.mesh.materials.insert(crate.mesh.materials.end(), 2, material);
    }
  }
  // A gem with colours at its corners and no texture.
  SceneDescription& gem = scenes[1];
  gem.materials = {{"ruby", {0.8F, 0.1F, 0.2F}, 0}, {"jade", {0.2F, 0.7F, 0.4F}, 0}};
  gem.mesh.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 0.8F, 0}, {0, -0.8F, 0}, {0, 0, 1.2F}, {0, 0, -1.2F}};
  gem.mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  gem.mesh.materials = {0, 1, 0, 1, 1, 0, 1, 0};
  for (std::size_t i = 0; i < 6; ++i) gem.mesh.colors.push_back({random.within(0, 1), random.within(0, 1), random.within(0, 1)});
  // Crossed fences that are transparent in places.
  SceneDescription& fence = scenes[2];
  fence.textures = {speckles(random, "lattice", true)};
  fence.materials = {{"lattice", {0.9F, 0.9F, 0.6F}, 0, std::uint16_t{0}}};
  fence.materials[0].alpha_cutoff = 0.5F;
  fence.mesh.vertices = {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}, {-1, 0, 1}, {0, -1, -1}, {0, 1, -1}, {0, 1, 1}, {0, -1, 1}};
  fence.mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  fence.mesh.uv = {{0, 2}, {2, 2}, {2, 0}, {0, 0}, {0, 2}, {2, 2}, {2, 0}, {0, 0}};
  // Loose triangles, enough for several chunks, of which some are invisible.
  SceneDescription& heap = scenes[3];
  heap.materials = {{"slate", {0.4F, 0.4F, 0.5F}, 0}, {"lime", {0.6F, 0.9F, 0.1F}, 0}};
  heap.mesh = soup(random, 600);
  for (Vec3& vertex : heap.mesh.vertices) vertex *= 0.3F;
  for (std::size_t i = 0; i < heap.mesh.triangles.size(); ++i) {
    heap.mesh.materials.push_back(i % 2);
    heap.mesh.objects.push_back(static_cast<std::uint16_t>(i % 5));
  }
  heap.mesh.visibility = {Visibility::full, Visibility::solid};
  for (SceneDescription& scene : scenes) {
    scene.light.sun_color = {3.0F, 0.0F, 0.0F};
    scene.light.fog_visibility_m = 2.0F;
    scene.markers.start = Vec3(0, 0, 0);
  }
  return scenes;
}

std::vector<std::unique_ptr<bodies::BodyModel>> mesh_models(Random& random) {
  std::vector<std::unique_ptr<bodies::BodyModel>> models;
  for (const SceneDescription& scene : mesh_sceneries(random)) {
    models.push_back(
        std::make_unique<bodies::BodyModel>(BodyConfig{.shape = BodyShape::mesh, .mesh = std::make_shared<const World>(scene)}));
  }
  return models;
}

// Solids, and every third body a mesh. Several bodies share each mesh.
Crowd crowd_with_meshes(Random& random, const std::vector<std::unique_ptr<bodies::BodyModel>>& models, std::size_t count) {
  Crowd crowd = random_crowd(random, 1, 3.5F);
  for (std::size_t i = 1; i < count; ++i) {
    if (i % 3 == 0) {
      const Crowd one = random_crowd(random, 1, 3.5F);
      Primitive solid = one.solids[0];
      solid.center = {one.position[0], one.position[1], one.position[2]};
      crowd.add(solid);
    } else {
      crowd.add_mesh(*models[i % models.size()], random.point(3.5F), random.rotation());
    }
  }
  return crowd;
}

std::vector<SceneDescription> clear_and_foggy_sceneries(Random& random) {
  std::vector<SceneDescription> scenes = sceneries(random);
  scenes.push_back(scenes[0]);
  scenes.back().light.fog_visibility_m = 20.0F;
  scenes.back().light.gamma = 1.6F;
  scenes.back().light.sky_ambient = {0.2F, 0.3F, 0.9F};
  return scenes;
}

// Adds the visible triangles of a mesh body to a scene.
void add_standing_mesh(SceneDescription& scene, const World& mesh, const Crowd& crowd, std::size_t body) {
  const auto first_material = scene.materials.size(), first_texture = scene.textures.size();
  for (const Texture& texture : mesh.textures()) {
    scene.textures.push_back(texture);
    scene.textures.back().name += std::to_string(body);
  }
  for (Material material : mesh.materials()) {
    material.name += std::to_string(body);
    material.semantic = crowd.surfaces[body].semantic;
    if (material.texture) material.texture = static_cast<std::uint16_t>(first_texture + *material.texture);
    scene.materials.push_back(material);
  }
  const float* const q = crowd.quat_wxyz.data() + 4 * body;
  const Eigen::Quaterniond rotation = Quat(q[0], q[1], q[2], q[3]).cast<double>();
  const Vec3 position(crowd.position[3 * body], crowd.position[3 * body + 1], crowd.position[3 * body + 2]);
  TriangleMesh& to = scene.mesh;
  const TriangleMesh& from = mesh.triangles();
  to.materials.resize(to.triangles.size());
  to.objects.resize(to.triangles.size());
  to.uv.resize(to.vertices.size());
  to.colors.resize(to.vertices.size(), {1.0F, 1.0F, 1.0F});
  const auto first_vertex = static_cast<std::int32_t>(to.vertices.size());
  for (std::size_t i = 0; i < from.vertices.size(); ++i) {
    to.vertices.push_back((position.cast<double>() + rotation * from.vertices[i].cast<double>()).cast<float>());
    to.uv.push_back(from.uv.empty() ? std::array<float, 2>{} : from.uv[i]);
    to.colors.push_back(from.colors.empty() ? std::array<float, 3>{1.0F, 1.0F, 1.0F} : from.colors[i]);
  }
  for (std::size_t i = 0; i < from.triangles.size(); ++i) {
    if (!is_visible(from.visibility_of(i))) continue;
    const auto& [a, b, c] = from.triangles[i];
    to.triangles.push_back({first_vertex + a, first_vertex + b, first_vertex + c});
    to.materials.push_back(static_cast<std::uint16_t>(first_material + from.materials[i]));
    to.objects.push_back(0);
  }
}

// The mesh of a body looks like the same triangles as a part of the world.
TEST_P(BodyShadows, MeshesLookLikeStandingTriangles) {
  Random random(395);
  const auto models = mesh_models(random);
  Differences seen;
  for (const SceneDescription& scene : clear_and_foggy_sceneries(random)) {
    Crowd crowd;
    for (std::size_t i = 0; i < 8; ++i) crowd.add_mesh(*models[i % models.size()], random.point(3.0F), random.rotation());
    SceneDescription with_triangles = scene;
    for (std::size_t i = 0; i < crowd.solids.size(); ++i) add_standing_mesh(with_triangles, **crowd.surfaces[i].mesh, crowd, i);
    const World& world = *worlds_.emplace_back(std::make_shared<const World>(scene));
    const World& standing = *worlds_.emplace_back(std::make_shared<const World>(with_triangles));
    for (const CameraConfig& camera : {camera_with(true, 1), camera_with(true, 4, DepthKind::range)}) {
      for (int i = 0; i < 12; ++i) {
        const Vec3 position = i < 8 ? Vec3(5.0F * random.direction().normalized()) : random.point(1.0F);
        const Mat3 rotation = facing({1, 0, 0}, random.point(1.0F) - position).toRotationMatrix();
        Shot with(camera), beside(camera);
        with.take(*renderer_, workers_, with.request(world, position, rotation, crowd.view()));
        beside.take(*renderer_, workers_, beside.request(standing, position, rotation));
        for (std::size_t pixel = 0; pixel < with.instance.size(); ++pixel) {
          const int body = beside.semantic[pixel] - kSemantic;
          if (body >= 0 && body < 100) beside.instance[pixel] = static_cast<std::uint16_t>(kFirstBodyInstance + body);
          if (body < 0 || body >= 100) beside.instance[pixel] = with.shows_body(pixel) ? 0 : with.instance[pixel];
        }
        seen.add(with, beside);
      }
    }
  }
  EXPECT_EQ(renderer_->take_warning(), "");
  EXPECT_GT(seen.inner, 20'000U);
  EXPECT_GE(static_cast<double>(seen.same_ids), 0.998 * static_cast<double>(seen.pixels));
  EXPECT_LE(static_cast<double>(seen.deep), 0.001 * static_cast<double>(seen.inner));
  EXPECT_LE(static_cast<double>(seen.turned), 0.001 * static_cast<double>(seen.inner));
  EXPECT_LE(static_cast<double>(seen.different), 0.002 * static_cast<double>(seen.inner));  // at edges of shadows
}

// The sun shines through the holes of a mesh and past its edge.
TEST_P(BodyShadows, OfMeshes) {
  SceneDescription floor;
  floor.materials = {{"chalk", {0.7F, 0.7F, 0.6F}, 0}};
  floor.primitives = {primitive(PrimitiveKind::plane, {3, 0, -1}, {4, 4, 0})};
  floor.light.sun_direction = {0.0F, 0.0F, 1.0F};
  const World& world = *worlds_.emplace_back(std::make_shared<const World>(floor));
  // A panel of 2 m x 2 m whose left half, with y > 0 in its frame, has a texture that is transparent.
  SceneDescription panel;
  panel.textures = {{.name = "nothing", .width_px = 1, .height_px = 1, .rgba = {255, 255, 255, 0}}};
  panel.materials = {{"clear", {1, 1, 1}, 0, std::uint16_t{0}}, {"chalk", {0.7F, 0.7F, 0.6F}, 0}};
  panel.materials[0].alpha_cutoff = 0.5F;
  panel.mesh.vertices = {{-1, -1, 0}, {1, -1, 0}, {1, 0, 0}, {-1, 0, 0}, {1, 1, 0}, {-1, 1, 0}};
  panel.mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {3, 2, 4}, {3, 4, 5}};
  panel.mesh.materials = {1, 1, 0, 0};
  panel.mesh.uv.resize(6);
  const bodies::BodyModel model({.shape = BodyShape::mesh, .mesh = std::make_shared<const World>(panel)});
  const auto look_down = [&](const Crowd& crowd) {
    Shot shot(camera_with(true, 1));
    const Mat3 down = facing({1, 0, 0}, Vec3(3, 0, -1)).toRotationMatrix();
    shot.take(*renderer_, workers_, shot.request(world, Vec3::Zero(), down, crowd.view()));
    return std::pair(int{shot.grey[shot.middle()]}, int{shot.instance[shot.middle()]});
  };
  const auto lit = look_down({});
  EXPECT_EQ(lit.second, 1);
  const Quat half_turn(0, 0, 0, 1);  // about z
  const Quat edge_on = facing({0, 0, 1}, {1, 0, 0});
  for (const auto& [position, rotation, shaded] : {std::tuple{Vec3(3, 0.5F, 6), Quat::Identity(), true},  // the opaque half
                                                   {Vec3(3, -0.5F, 6), Quat::Identity(), false},          // the clear half
                                                   {Vec3(3, -0.5F, 6), half_turn, true},
                                                   {Vec3(3, 0.5F, 6), half_turn, false},
                                                   {Vec3(3, 1.5F, 6), Quat::Identity(), false},  // beside it
                                                   {Vec3(3, 0.5F, 6), edge_on, false},
                                                   {Vec3(3, 0.5F, -1.5F), Quat::Identity(), false}}) {  // under the floor
    Crowd crowd;
    crowd.add_mesh(model, position, rotation);
    const auto seen = look_down(crowd);
    EXPECT_EQ(seen.second, 1) << position.transpose();
    if (shaded) {
      EXPECT_LT(seen.first, lit.first - 20) << position.transpose();
    } else {
      EXPECT_EQ(seen.first, lit.first) << position.transpose();
    }
  }
  // A panel in the sun, in the shadow of a solid, and in that of a second panel; both lie on the floor or above it.
  Crowd lying;
  lying.add_mesh(model, {3, 0.5F, -0.9F}, Quat::Identity());
  const auto sunny = look_down(lying);
  EXPECT_EQ(sunny.second, kFirstBodyInstance);
  EXPECT_EQ(sunny.first, lit.first);  // of the same colour as the floor
  Crowd under_ball = lying, under_panel = lying;
  under_ball.add(primitive(PrimitiveKind::sphere, {3, 0, 6}, {1, 1, 1}));
  under_panel.add_mesh(model, {3, 0.5F, 6}, Quat::Identity());
  EXPECT_LT(look_down(under_ball).first, sunny.first - 20);
  EXPECT_LT(look_down(under_panel).first, sunny.first - 20);
}

INSTANTIATE_TEST_SUITE_P(Backends, BodyImagesOf, ::testing::Values(CameraBackend::raycast, CameraBackend::gl));
INSTANTIATE_TEST_SUITE_P(Raycast, BodyShadows, ::testing::Values(CameraBackend::raycast));

// Envs with different bodies of all shapes, an env without any, and several drones in each env.
TEST(BodyImages, GlShowsWhatRaycastShows) {
  Random random(394);
  Workers workers(2);
  std::vector<std::shared_ptr<const World>> worlds;
  for (const auto& scene : sceneries(random)) worlds.push_back(std::make_shared<const World>(scene));
  Renderer raycast(CameraBackend::raycast, workers), gl(CameraBackend::gl, workers);
  if (lacks_gl(gl)) GTEST_SKIP() << gl.report();
  ASSERT_EQ(gl.report().substr(0, 3), "gl:") << gl.report();
  const auto models = mesh_models(random);
  std::vector<Crowd> crowds;
  for (const std::size_t count : {12U, 0U, 30U, 3U}) crowds.push_back(crowd_with_meshes(random, models, count));
  crowds[2].radius[4] = -1.0F;  // not visible
  // The first two worlds have no triangles and masks. They are also drawn without the others, by simpler shaders.
  for (const std::size_t count : {std::size_t{2}, worlds.size()}) {
    const std::vector<std::shared_ptr<const World>> chosen(worlds.begin(), worlds.begin() + static_cast<std::ptrdiff_t>(count));
    for (const int samples : {1, 4}) {
      const Differences seen = between_backends(random, raycast, gl, workers, chosen, crowds, camera_with(false, samples));
      EXPECT_GT(seen.inner, 5'000U);
      EXPECT_GE(static_cast<double>(seen.same_ids), 0.995 * static_cast<double>(seen.pixels));
      EXPECT_LE(static_cast<double>(seen.deep), 0.001 * static_cast<double>(seen.inner));
      EXPECT_LE(static_cast<double>(seen.turned), 0.001 * static_cast<double>(seen.inner));
      EXPECT_LE(static_cast<double>(seen.different), 0.01 * static_cast<double>(seen.inner));
    }
  }
}

TEST(BodyImages, ASecondFrameAllocatesNothing) {
  Random random(393);
  Workers workers(1);
  Renderer renderer(CameraBackend::raycast, workers);
  const World world(sceneries(random)[0]);
  Crowd crowd = random_crowd(random, 40, 3.0F);
  Shot shot(camera_with(true, 1));
  shot.take(renderer, workers, shot.request(world, Vec3::Zero(), Mat3::Identity(), crowd.view()));
  for (int i = 0; i < 20; ++i) {
    for (float& value : crowd.position) value += random.within(-0.2F, 0.2F);
    const RenderRequest request = shot.request(world, Vec3::Zero(), random.rotation().toRotationMatrix(), crowd.view());
    const std::uint64_t before = allocations();
    shot.take(renderer, workers, request);
    EXPECT_EQ(allocations() - before, 0U);
  }
}

TEST(LinePainter, BodiesHideLines) {
  Workers workers(1);
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8})});
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
