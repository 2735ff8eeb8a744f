// Many objects and meshes, through every tracing path, and the same bits everywhere.
#include "base/platform.hpp"
#include "embree_mesh.hpp"
#include "on_target.hpp"
#include "render/camera_optics.hpp"
#include "sensors/camera_scenes.hpp"
#include "trace/packets.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using namespace scenes;

// Primitives of every kind in a ball around the origin, except close to the origin.
std::vector<Primitive> crowd(Random& random, int count, float reach, float size) {
  std::vector<Primitive> primitives{primitive(room, {0, 0, 0}, Vec3::Constant(1.5F * reach))};
  while (static_cast<int>(primitives.size()) <= count) {
    const std::size_t i = primitives.size();
    const PrimitiveKind kind = std::array{box, cylinder, sphere, capsule, plane, disc}[i % 6];
    const float r = random.within(0.3F, 1.0F) * size;
    Vec3 half(r, r, random.within(0.5F, 1.0F) * size);
    if (kind == capsule) half.z() += r;
    if (kind == sphere) half.z() = r;
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const Vec3 center = random.point(reach);
    if (center.norm() < 0.2F * reach) continue;
    primitives.push_back(primitive(kind, center, half, kind == sphere || i % 2 == 0 ? Quat::Identity() : random.rotation()));
    primitives.back().material = static_cast<std::uint16_t>(i % 4);
  }
  return primitives;
}

std::shared_ptr<const World> crowded(unsigned seed, int primitives, float reach, int triangles) {
  Random random(seed);
  SceneDescription description;
  description.materials = {
      {"a", {0.9F, 0.2F, 0.1F}}, {"b", {0.1F, 0.8F, 0.3F}}, {"c", {0.2F, 0.3F, 0.9F}}, {"d", {0.8F, 0.8F, 0.8F}}};
  if (primitives > 0) description.primitives = crowd(random, primitives, reach, 0.06F * reach);
  for (int i = 0; i < triangles; ++i) {
    const Vec3 corner = reach * random.direction().normalized() * random.within(0.3F, 1.0F);
    for (int k = 0; k < 3; ++k) description.mesh.vertices.push_back(corner + random.point(0.15F * reach));
    description.mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    description.mesh.materials.push_back(static_cast<std::uint16_t>(i % 4));
    description.mesh.objects.push_back(static_cast<std::uint16_t>(i % 3));
  }
  description.markers = {.start = Vec3(0, 0, 0), .waypoints = {{0.5F * reach, 0, 0}}, .goal = Vec3(0, 0.5F * reach, 0)};
  return std::make_shared<const World>(description);
}

struct CrowdCase {
  const char* what;
  std::shared_ptr<const World> world;
};

const std::vector<CrowdCase>& crowds() {
  static const std::vector<CrowdCase> all{
      {"a few primitives", crowded(51, 8, 5, 0)},
      {"more than are traced without a common origin", crowded(52, 60, 5, 0)},
      {"more than 384 within reach, some of them in view", crowded(53, 450, 5, 0)},
      {"more than 512 within reach", crowded(54, 700, 5, 0)},
      {"a mesh", crowded(55, 0, 5, 150)},
      {"a few primitives and a mesh", crowded(56, 10, 5, 100)},
      {"a crowd and a mesh", crowded(57, 600, 5, 100)},
  };
  return all;
}

TEST(CameraCrowds, AgreeWithTheOracle) {
  for (const CrowdCase& one : crowds()) {
    SCOPED_TRACE(one.what);
    Random random(55);
    const std::size_t elements = one.world->primitives().size() + one.world->triangles().triangles.size();
    Compared compared;
    for (const auto& [width, height, fov] : {std::tuple{1, 1, 90.0F}, {17, 3, 90.0F}, {33, 47, 90.0F}, {64, 48, 160.0F}}) {
      for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
        CameraConfig camera = camera_of(width, height, fov);
        camera.depth_kind = kind;
        camera.near_m = 0.1F;
        const auto batch = look(one.world, camera, random.point(1.0F), random.rotation());
        compared += expect_picture(*batch, 0, 0, width * height < 60 ? 1 : 1 + elements / 20);
      }
    }
    EXPECT_GT(compared.clear, compared.pixels / 2);
    EXPECT_GT(compared.elements.size(), 4U);
  }
}

// All 450 primitives are in view, so even a tile one pixel wide has too many to test one by one.
TEST(CameraCrowds, MoreInViewOfATileThanAreTracedDirectly) {
  Random random(58);
  SceneDescription description;
  for (int i = 0; i < 450; ++i) {
    const Vec3 center(random.within(8, 12), random.within(-1.2F, 1.2F), random.within(-1.2F, 1.2F));
    description.primitives.push_back(
        primitive(i % 2 == 0 ? sphere : box, center, Vec3::Constant(0.05F), i % 2 == 0 ? Quat::Identity() : random.rotation()));
  }
  const auto world = std::make_shared<const World>(description);
  const auto batch = look(world, camera_of(16, 16, 16.0F), {0, 0, 0});
  const Compared compared = expect_picture(*batch);
  EXPECT_GT(compared.clear, 100U);
  EXPECT_GT(compared.elements.size(), 30U);
  EXPECT_GT(compared.sky, 10U);
}

TEST(CameraCrowds, PacketsOfEitherShapeHitTheSame) {
  const auto world = crowded(59, 0, 5, 400);
  const EmbreeDevice device;
  const TriangleMesh& mesh = world->triangles();
  const EmbreeScene scene = device.scene(mesh);
  const auto trace = [&](const render::CameraOptics& optics, const render::PixelTile& tile, const Mat3& rotation, bool wide,
                         trace::RayBundle& rays, trace::HitDetails& details) {
    static const std::vector<float> ones(trace::kMaxRays + trace::kRayPadding, 1.0F);
    rays.origin = Vec3(0.1F, 0.2F, 0.3F);
    rays.rotation = rotation;
    rays.near = 0.05F;
    rays.range = 20.0F;
    rays.count = tile.height * render::PixelTile::kSide;
    rays.x = ones.data();
    rays.y = optics.grids[0].left.data() + tile.column * render::PixelTile::kSide;
    rays.z = optics.grids[0].up.data() + tile.row * render::PixelTile::kSide;
    std::fill_n(rays.t_hit, trace::kMaxRays, kInfinity);
    std::fill_n(rays.element, trace::kMaxRays, -1);
    const FlushDenormals flush;
    trace::trace_tile(scene.get(), 0, wide, trace::Through::nothing, rays, details);
  };
  Random random(60);
  const auto four = std::make_unique<trace::RayBundle>();
  const auto two = std::make_unique<trace::RayBundle>();
  trace::HitDetails of_four, of_two;
  std::size_t hits = 0;
  for (const auto& [width, height] : {std::pair{48, 48}, {17, 3}, {16, 7}, {5, 1}}) {
    const render::CameraOptics optics = render::make_camera_optics(camera_of(width, height));
    for (int i = 0; i < 5; ++i) {
      const Mat3 rotation = random.rotation().toRotationMatrix();
      for (const render::PixelTile& tile : optics.tiles) {
        trace(optics, tile, rotation, true, *four, of_four);
        trace(optics, tile, rotation, false, *two, of_two);
        for (std::size_t ray = 0; ray < four->count; ++ray) {
          ASSERT_EQ(four->element[ray], two->element[ray]);
          if (four->element[ray] < 0) continue;
          ++hits;
          ASSERT_NEAR(four->t_hit[ray], two->t_hit[ray], 1e-6F * four->t_hit[ray]);
          const Vec3 a(of_four.normal_x[ray], of_four.normal_y[ray], of_four.normal_z[ray]);
          const Vec3 b(of_two.normal_x[ray], of_two.normal_y[ray], of_two.normal_z[ray]);
          ASSERT_LT((a - b).norm(), 1e-5F * a.norm());
          const auto& [first, second, third] = mesh.triangles[static_cast<std::size_t>(four->element[ray])];
          const auto corner = [&mesh](std::int32_t index) { return mesh.vertices[static_cast<std::size_t>(index)]; };
          const Vec3 point = four->origin + four->t_hit[ray] * four->direction(ray);
          for (const trace::HitDetails* of : {&of_four, &of_two}) {
            const float u = of->u[ray], v = of->v[ray];
            const Vec3 on_triangle = (1.0F - u - v) * corner(first) + u * corner(second) + v * corner(third);
            ASSERT_LT((on_triangle - point).norm(), 1e-3F);
          }
        }
      }
    }
  }
  EXPECT_GT(hits, 1000U);
}

// -- The same bits everywhere.

TEST(CameraBits, AreTheSameOnEverySimdTarget) {
  const auto shoot = [](std::int64_t target) {
    const OnTarget on(target);
    Random random(61);
    std::vector<CameraImages> pictures;
    // Scenes are rebuilt, because Embree's callback is chosen when a scene is made.
    for (const auto& world : {crowded(52, 60, 5, 0), crowded(54, 700, 5, 0), crowded(56, 10, 5, 100), ring().world, yard(true)}) {
      for (const int samples : {1, 4, 9}) {
        CameraConfig camera = camera_of(49, 37);
        camera.samples_per_pixel = samples;
        camera.adaptive_samples = samples == 9;
        camera.shadows = samples == 4;
        camera.depth_kind = samples == 4 ? DepthKind::range : DepthKind::planar;
        pictures.push_back(look(world, camera, random.point(0.5F) + Vec3(0, 0, 0.6F), random.rotation())->camera(0).images());
      }
    }
    return pictures;
  };
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_FALSE(targets.empty());
  const std::vector<CameraImages> best = shoot(targets.front());
  for (const std::int64_t target : targets) {
    SCOPED_TRACE(hwy::TargetName(target));
    const std::vector<CameraImages> same = shoot(target);
    for (std::size_t i = 0; i < best.size(); ++i) EXPECT_TRUE(same_arrays(same[i], best[i])) << "picture " << i;
  }
}

// A bumpy grid of triangles that share edges. On it Embree's last bits depend on neighbouring rays.
std::shared_ptr<const World> hills() {
  TriangleMesh mesh;
  constexpr int kSide = 40;
  for (int i = 0; i <= kSide; ++i) {
    for (int k = 0; k <= kSide; ++k) {
      const float x = 0.2F * static_cast<float>(i) - 4.0F;
      const float y = 0.2F * static_cast<float>(k) - 4.0F;
      mesh.vertices.emplace_back(x, y, 0.4F * std::sin(2.0F * x) * std::cos(3.0F * y) - 1.5F);
    }
  }
  for (int i = 0; i < kSide; ++i) {
    for (int k = 0; k < kSide; ++k) {
      const int a = (kSide + 1) * i + k;
      mesh.triangles.push_back({a, a + kSide + 1, a + kSide + 2});
      mesh.triangles.push_back({a, a + kSide + 2, a + 1});
    }
  }
  return make_world({}, {}, mesh);
}

// The last rows of a tile are padded to whole packets. Rays traced there before must not matter.
TEST(CameraBits, OfAPictureDoNotDependOnTheOneBefore) {
  const auto world = hills();
  Random random(63);
  for (const auto& [width, height] : {std::pair{48, 1}, {48, 2}, {48, 3}, {16, 5}, {48, 19}}) {
    const Poses poses = random_poses(random, 15, Vec3::Constant(0.9F));
    CameraConfig small = camera_of(width, height);
    BatchConfig config = camera_batch(camera_of(64, 64));
    small.name = "small";
    config.cameras.push_back(small);
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::size_t different = 0;
    for (std::size_t drone = 0; drone < 15; ++drone) {
      Batch after(config, {world});  // captures the large image first
      Batch alone(camera_batch(small), {world});
      for (Batch* batch : {&after, &alone}) {
        batch->set_pose(testing::row(poses.position, drone, 3), testing::row(poses.quat_wxyz, drone, 4));
        batch->sense();
      }
      ASSERT_EQ(alone.camera(0).images().depth.size(), pixels);
      different += !same_arrays(after.camera(1).images(), alone.camera(0).images());
    }
    EXPECT_EQ(different, 0U) << "of 15 pictures of " << width << " x " << height;
  }
}

TEST(CameraBits, AreTheSameForAnyBlocksThreadsAndNeighbours) {
  // Images with padded last rows of tiles, in worlds in which padding could matter, and images with more tiles than are
  // rendered at once.
  const Batch::Worlds worlds{crowds()[1].world, crowds()[5].world, crowds()[6].world, hills()};
  for (const auto& [width, height, drones] : {std::tuple{35, 33, 12}, {170, 97, 4}}) {
    SCOPED_TRACE(width);
    CameraConfig camera = camera_of(width, height);
    camera.shadows = width == 35;
    Random random(62);
    const Poses poses = random_poses(random, drones, Vec3::Constant(0.9F));
    const auto shoot = [&, drone_count = drones](int block_size, int num_threads) {
      BatchConfig config = camera_batch(camera, drone_count);
      config.block_size = block_size;
      config.num_threads = num_threads;
      Batch batch(config, worlds);
      batch.set_pose(poses.position, poses.quat_wxyz);
      batch.sense();
      return batch.camera(0).images();
    };
    const CameraImages images = shoot(64, 1);
    EXPECT_TRUE(same_arrays(images, shoot(1, 1)));
    EXPECT_TRUE(same_arrays(images, shoot(5, 2)));
    EXPECT_TRUE(same_arrays(images, shoot(1, 7)));
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    for (std::size_t drone = 0; drone < static_cast<std::size_t>(drones); ++drone) {
      Batch alone(camera_batch(camera), {worlds[drone % 4]});
      alone.set_pose(testing::row(poses.position, drone, 3), testing::row(poses.quat_wxyz, drone, 4));
      alone.sense();
      const CameraImages& expected = alone.camera(0).images();
      EXPECT_TRUE(same_bits(testing::row(images.rgb, drone, 3 * pixels), expected.rgb)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.depth, drone, pixels), expected.depth)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.semantic, drone, pixels), expected.semantic)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.instance, drone, pixels), expected.instance)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.normal, drone, 3 * pixels), expected.normal)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.grey, drone, pixels), expected.grey)) << drone;
    }
  }
}

}  // namespace
}  // namespace flockstep
