// The choice of tracer in a batch: cameras and LiDARs traced by tiles, compared with closed forms in double precision and with
// Embree.

#include "on_target.hpp"
#include "prepared/prepared_world.hpp"
#include "sensors/beams.hpp"
#include "trace/hills.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr int kDrones = 8;

CameraConfig camera() {
  CameraConfig config;
  config.width_px = 72;  // the last tiles are narrower and lower
  config.height_px = 42;
  config.far_m = 30.0F;
  config.outputs = {.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true};
  return config;
}

LidarConfig grid(int channels = 14, int beams = 200) {
  LidarConfig config;
  config.channels = channels;
  config.beams = beams;
  config.hfov_deg = 360.0F;
  config.vfov_deg = 40.0F;
  config.max_range_m = 20.0F;
  config.offset_m = {0.1F, -0.05F, 0.02F};
  return config;
}

std::unique_ptr<Batch> make_batch(const std::shared_ptr<const World>& world, TracerKind tracer, int threads = 1,
                                  int block_size = 64) {
  BatchConfig config;
  config.num_envs = kDrones;
  config.num_threads = threads;
  config.block_size = block_size;
  config.cameras = {camera()};
  config.lidars = {grid()};
  config.tracer = tracer;
  auto batch = std::make_unique<Batch>(config, Batch::Worlds{world});
  const Poses poses = poses_over_hills(kDrones);
  batch->set_pose(poses.position, poses.quat_wxyz);
  batch->sense();
  batch->camera(0).capture();
  return batch;
}

#if defined(NDEBUG)
constexpr std::size_t kEvery = 3;  // one in kEvery rays is compared with the oracle
#else                              // sanitizers and debug builds are slow
constexpr std::size_t kEvery = 41;
#endif

class TracerTiles : public ::testing::TestWithParam<int> {};  // number of spheres

TEST_P(TracerTiles, LidarsAgreeWithAnOracle) {
  const auto world = hills_under(GetParam());
  ScanTally tally;
  tally.compare(*world, {make_batch(world, TracerKind::tiles).get()}, kEvery, 2e-6);
  EXPECT_GT(tally.compared, 3 * tally.rays / 4);
  EXPECT_GT(tally.hits, tally.compared / 4);
}

TEST(TracerAgreement, OfTilesPacketsAndClosedForms) {
  const long wanted = times_tried(20'000 / static_cast<long>(kEvery));
  ScanTally tally;
  for (unsigned seed = part_tried() << 24U; static_cast<long>(tally.rays) < wanted; ++seed) {
    SCOPED_TRACE(seed);
    const auto world = hills_or_shapes(seed);
    const auto tiles = make_batch(world, TracerKind::tiles), embree = make_batch(world, TracerKind::embree);
    const Poses poses = poses_over_hills(kDrones, seed);
    for (Batch* const batch : {tiles.get(), embree.get()}) {
      batch->set_pose(poses.position, poses.quat_wxyz);
      batch->sense();
    }
    tally.compare(*world, {tiles.get(), embree.get()}, kEvery, 2e-6);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(tally.compared, tally.rays / 2);
  EXPECT_GT(tally.hits, tally.compared / 4);
  testing::tried("agreement", static_cast<long>(tally.compared));
}

TEST_P(TracerTiles, CamerasAgreeWithEmbree) {
  const auto world = hills_under(GetParam());
  const auto tiles = make_batch(world, TracerKind::tiles), embree = make_batch(world, TracerKind::embree);
  const CameraImages &a = tiles->camera(0).images(), &b = embree->camera(0).images();
  const std::size_t pixels = a.depth.size();
  std::size_t hits = 0, other_depth = 0, other_ids = 0, other_color = 0, other_normal = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    hits += std::isfinite(a.depth[i]);
    if (std::isfinite(a.depth[i]) != std::isfinite(b.depth[i])) {
      ++other_depth;
      continue;
    }
    if (std::isfinite(a.depth[i])) other_depth += std::abs(a.depth[i] - b.depth[i]) > 1e-4F * (1.0F + b.depth[i]);
    other_ids += a.semantic[i] != b.semantic[i] || a.instance[i] != b.instance[i];
    for (std::size_t k = 3 * i; k < 3 * i + 3; ++k) {
      other_color += std::abs(a.rgb[k] - b.rgb[k]) > 1;
      other_normal += std::abs(a.normal[k] - b.normal[k]) > 1e-3F;
    }
  }
  EXPECT_GT(hits, pixels / 3);
  // At edges, different rounding can select the neighbouring triangle.
  const std::size_t few = pixels / 1000;
  EXPECT_LE(other_depth, few);
  EXPECT_LE(other_ids, few);
  EXPECT_LE(other_color, 3 * few);
  EXPECT_LE(other_normal, 3 * few);
}

TEST_P(TracerTiles, SameBitsBesideAnyRays) {
  const auto world = hills_under(GetParam());
  const auto batch = make_batch(world, TracerKind::tiles);
  for (const auto& [threads, block_size] : {std::pair{2, 1}, std::pair{1, 3}}) {
    const auto other = make_batch(world, TracerKind::tiles, threads, block_size);
    EXPECT_TRUE(same_bits(batch->lidar().readings().ranges, other->lidar().readings().ranges));
    EXPECT_TRUE(same_arrays(batch->camera(0).images(), other->camera(0).images()));
  }
  BatchConfig config = batch->config();
  config.num_envs = 1;
  Batch alone(config, {world});
  const Poses poses = poses_over_hills(kDrones);
  const std::size_t rays = batch->lidar().readings().ranges.size() / kDrones,
                    pixels = batch->camera(0).images().depth.size() / kDrones;
  for (std::size_t drone = 0; drone < kDrones; ++drone) {
    alone.set_pose(std::span(poses.position).subspan(3 * drone, 3), std::span(poses.quat_wxyz).subspan(4 * drone, 4));
    alone.sense();
    alone.camera(0).capture();
    EXPECT_TRUE(same_bits(alone.lidar().readings().ranges, testing::row(batch->lidar().readings().ranges, drone, rays)));
    EXPECT_TRUE(same_bits(alone.camera(0).images().depth, testing::row(batch->camera(0).images().depth, drone, pixels)));
  }
}

TEST_P(TracerTiles, NoTriangleGoesThroughEmbree) {
  const auto world = hills_under(GetParam());
  EXPECT_EQ(make_batch(world, TracerKind::tiles)->embree().rays, 0);
  EXPECT_GT(make_batch(world, TracerKind::embree)->embree().rays, 0);
}

TEST_P(TracerTiles, AutoUsesThemIfTheyAreFaster) {
  const auto world = hills_under(GetParam());
  const auto tiles = make_batch(world, TracerKind::tiles), by_itself = make_batch(world, TracerKind::automatic);
  EXPECT_TRUE(same_bits(tiles->lidar().readings().ranges, by_itself->lidar().readings().ranges));
  EXPECT_TRUE(same_arrays(tiles->camera(0).images(), by_itself->camera(0).images()));
}

INSTANTIATE_TEST_SUITE_P(FewAndMany, TracerTiles, ::testing::Values(0, 5, 700));

// A few rays go through Embree, even if other batches of the world have prepared tiles.
TEST(TracerTilesOf, SmallCamerasDoNotUseThem) {
  const auto world = hills_under(5);
  BatchConfig config{.num_threads = 1, .cameras = {camera()}};
  config.cameras[0].width_px = config.cameras[0].height_px = 15;
  const auto rays_through_embree = [&](TracerKind tracer) {
    config.tracer = tracer;
    Batch batch(config, {world});
    batch.camera(0).capture();
    return batch.embree().rays;
  };
  EXPECT_EQ(rays_through_embree(TracerKind::tiles), 0);
  EXPECT_GT(rays_through_embree(TracerKind::automatic), 0);
  config.cameras[0].width_px = config.cameras[0].height_px = 16;
  EXPECT_EQ(rays_through_embree(TracerKind::automatic), 0);
}

// With TracerKind::embree, primitives also go through Embree, even if they are few enough for direct tracing.
TEST(TracerTilesOf, EmbreeAgreesOnPrimitives) {
  for (const int spheres : {5, 700}) {
    const auto world = hills_under(spheres);
    const auto direct = make_batch(world, TracerKind::tiles), embree = make_batch(world, TracerKind::embree);
    const auto &a = direct->camera(0).images().depth, &b = embree->camera(0).images().depth;
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i) differ += !(a[i] == b[i] || std::abs(a[i] - b[i]) < 1e-4F * a[i]);
    EXPECT_LT(differ, a.size() / 1000);
  }
  const auto only_spheres = make_world({primitive(PrimitiveKind::sphere, {3, 1, 2}, Vec3::Constant(0.5F)),
                                        primitive(PrimitiveKind::box, {-3, 1, 2}, Vec3::Constant(0.5F))});
  const auto before = make_batch(only_spheres, TracerKind::automatic);
  const auto embree = make_batch(only_spheres, TracerKind::embree);
  const auto after = make_batch(only_spheres, TracerKind::automatic);
  EXPECT_TRUE(same_bits(before->lidar().readings().ranges, after->lidar().readings().ranges));
  const auto ranges = before->lidar().readings().ranges, by_embree = embree->lidar().readings().ranges;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    if (std::isinf(ranges[i]) != std::isinf(by_embree[i])) continue;  // at an outline
    if (!std::isinf(ranges[i])) {
      EXPECT_NEAR(ranges[i], by_embree[i], 1e-4F * ranges[i]);
    }
  }
}

TEST(TracerTilesOf, WorldsWithoutTrianglesDoNotUseThem) {
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 3}, {12, 12, 4}),
                                 primitive(PrimitiveKind::sphere, {3, 1, 2}, Vec3::Constant(0.5F))});
  const auto tiles = make_batch(world, TracerKind::tiles), by_itself = make_batch(world, TracerKind::automatic);
  EXPECT_EQ(prepared(*world).scene().tiles(), nullptr);
  EXPECT_TRUE(same_bits(tiles->lidar().readings().ranges, by_itself->lidar().readings().ranges));
  EXPECT_TRUE(same_bits(tiles->camera(0).images().rgb, by_itself->camera(0).images().rgb));
}

TEST(TracerTilesOf, HaveTheSameBitsOnEverySimdTarget) {
  const auto world = hills_under(5);
  const auto first = make_batch(world, TracerKind::tiles);
  ASSERT_GT(hwy::SupportedAndGeneratedTargets().size(), 1U);
  on_every_target([&] {
    // A separate world, because the shading data of its triangles is computed once per world.
    const auto same = make_batch(hills_under(5), TracerKind::tiles);
    EXPECT_TRUE(same_bits(first->lidar().readings().ranges, same->lidar().readings().ranges));
    EXPECT_TRUE(same_arrays(first->camera(0).images(), same->camera(0).images()));
  });
}

TEST(TracerTilesOf, SeveralBatchesShareATree) {
  const auto world = hills_under(5);
  const auto first = make_batch(world, TracerKind::tiles);
  const auto* const tree = prepared(*world).scene().tiles();
  ASSERT_NE(tree, nullptr);
  const auto second = make_batch(world, TracerKind::tiles);
  EXPECT_EQ(prepared(*world).scene().tiles(), tree);
}

// Counts the tiles of a pattern that have a view: all tiles of dense patterns, none of sparse ones.
TEST(TracerTilesOf, PatternsThatAreDenseHaveViews) {
  const auto views = [](int channels, int beams, float hfov_deg) {
    LidarConfig config = grid(channels, beams);
    config.hfov_deg = hfov_deg;
    const sensors::BeamPattern pattern = sensors::make_pattern(config, trace::trace_policy_of(TracerKind::tiles, 0));
    std::size_t with_view = 0;
    for (const sensors::BeamTile& tile : pattern.tiles) with_view += tile.view >= 0;
    EXPECT_EQ(with_view, pattern.views.size());
    return std::pair{pattern.views.size(), pattern.tiles.size()};
  };
  EXPECT_EQ(views(16, 360, 360.0F), std::pair(std::size_t{23}, std::size_t{23}));
  EXPECT_EQ(views(64, 1024, 360.0F), std::pair(std::size_t{256}, std::size_t{256}));
  EXPECT_EQ(views(1, 35, 270.0F).first, 0U);   // fan
  EXPECT_EQ(views(3, 360, 360.0F).first, 0U);  // too few rows
  EXPECT_EQ(views(8, 60, 360.0F).first, 0U);   // sixteen beams span 90 degrees
}

// Each beam of a view matches the pattern's beam.
TEST(TracerTilesOf, ViewsPointWhereBeamsDo) {
  LidarConfig config = grid(6, 200);
  config.quat_wxyz = {0.5F, -0.5F, 0.5F, 0.5F};
  const sensors::BeamPattern pattern = sensors::make_pattern(config, trace::trace_policy_of(TracerKind::tiles, 0));
  ASSERT_FALSE(pattern.views.empty());
  for (const sensors::BeamTile& tile : pattern.tiles) {
    if (tile.view < 0) continue;
    const trace::TileView& view = pattern.views[static_cast<std::size_t>(tile.view)];
    for (std::size_t i = 0; i < tile.rows * tile.width; ++i) {
      const std::size_t row = i / tile.width, column = i % tile.width, at = trace::TileAxis::place(row, column);
      const Vec3 along(1.0F, view.u.of_ray[at], view.v.of_ray[at]);
      const Vec3 seen = view.ahead[16 * row + column] * (view.to_sensor * along);
      const Vec3 beam(pattern.x[tile.first + i], pattern.y[tile.first + i], pattern.z[tile.first + i]);
      EXPECT_LT((seen - beam).norm(), 2e-7F);
    }
  }
}

}  // namespace
}  // namespace flockstep
