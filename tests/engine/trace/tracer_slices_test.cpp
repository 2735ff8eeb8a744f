// LiDARs whose fans are traced as slices, in batches: compared with closed forms and all triangles in double precision, and with
// Embree. Which patterns have fans.

#include "base/platform.hpp"
#include "on_target.hpp"
#include "prepared/prepared_world.hpp"
#include "sensors/beams.hpp"
#include "trace/calibrated.hpp"
#include "trace/hills.hpp"
#include "trace/mesh_slices.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr int kFanDrones = 6;

LidarConfig fan_of(const char* name, int beams, float hfov_deg, float range_m, int channels = 1, float vfov_deg = 0.0F) {
  LidarConfig config{
      .name = name, .channels = channels, .beams = beams, .hfov_deg = hfov_deg, .vfov_deg = vfov_deg, .max_range_m = range_m};
  config.offset_m = {0.1F, -0.05F, 0.02F};
  return config;
}

// A fan whose neighbouring beams are `between_m` apart at its range.
LidarConfig spaced_fan(const char* name, int beams, float between_m) {
  constexpr float kRangeM = 10.0F, kDegPerRad = 180.0F / std::numbers::pi_v<float>;
  return fan_of(name, beams, kDegPerRad * between_m / kRangeM * static_cast<float>(beams - 1), kRangeM);
}

// One LiDAR of each kind whose beams all lie in fans.
std::vector<LidarConfig> fans() {
  std::vector<LidarConfig> all{fan_of("default", 35, 270.0F, 3.0F),
                               fan_of("around", 72, 360.0F, 10.0F),
                               fan_of("mounted", 20, 180.0F, 5.0F),
                               fan_of("many", 600, 360.0F, 20.0F),
                               fan_of("vertical", 1, 1.0F, 12.0F, 48, 150.0F),
                               fan_of("uneven", 35, 270.0F, 15.0F),
                               fan_of("leaning", 35, 270.0F, 8.0F)};
  all[2].quat_wxyz = {0.6F, 0.48F, -0.64F, 0.0F};
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    all[5].azimuth_deg.push_back(random.within(-180, 180));
    all[5].elevation_deg.push_back(0.0F);
    all[6].azimuth_deg.push_back(i < 25 ? 30.0F : -150.0F);  // in the plane of the vertical and one azimuth
    all[6].elevation_deg.push_back(random.within(-90, 90));
  }
  return all;
}

std::unique_ptr<Batch> sense_by(const std::shared_ptr<const World>& world, TracerKind tracer, std::vector<LidarConfig> lidars,
                                int threads = 1, int block_size = 64, unsigned seed = 7) {
  BatchConfig config;
  config.num_envs = kFanDrones;
  config.num_threads = threads;
  config.block_size = block_size;
  config.lidars = std::move(lidars);
  config.tracer = tracer;
  auto batch = std::make_unique<Batch>(config, Batch::Worlds{world});
  const Poses poses = poses_over_hills(kFanDrones, seed);
  batch->set_pose(poses.position, poses.quat_wxyz);
  batch->sense();
  return batch;
}

void expect_same_ranges(const Batch& a, const Batch& b) {
  for (std::size_t lidar = 0; lidar < fans().size(); ++lidar) {
    EXPECT_TRUE(same_bits(a.lidar(lidar).readings().ranges, b.lidar(lidar).readings().ranges)) << fans()[lidar].name;
  }
}

// In the drones' way.
const Markers kMarkers{.radius = 3.0F, .start = Vec3(0, 0, 3), .waypoints = {{5, -5, 3}, {-5, 5, 3}}, .goal = Vec3(8, 8, 3)};

// Returns true if both are misses, or hits at the same distance up to rounding.
bool is_close(float a, float b) { return std::isinf(a) == std::isinf(b) && (a == b || std::abs(a - b) <= 1e-4F * (1.0F + b)); }

class TracerSlices : public ::testing::TestWithParam<int> {};  // number of spheres

TEST_P(TracerSlices, AgreeWithAnOracleAndEmbree) {
  const auto world = hills_under(GetParam(), kMarkers);
  const auto slices = sense_by(world, TracerKind::slices, fans()), embree = sense_by(world, TracerKind::embree, fans());
  ScanTally tally;
  tally.compare(*world, {slices.get(), embree.get()}, 5);
  EXPECT_GT(tally.compared, 3 * tally.rays / 4);
  EXPECT_GT(tally.hits, tally.compared / 4);
  for (std::size_t lidar = 0; lidar < fans().size(); ++lidar) {
    const auto &a = slices->lidar(lidar).readings().ranges, &b = embree->lidar(lidar).readings().ranges;
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i) differ += !is_close(a[i], b[i]);
    EXPECT_LE(differ, a.size() / 500) << fans()[lidar].name;  // at edges and at grazing angles
  }
}

TEST_P(TracerSlices, DoNotSeeMarkers) {
  const auto seen = sense_by(hills_under(GetParam(), kMarkers), TracerKind::slices, fans());
  expect_same_ranges(*seen, *sense_by(hills_under(GetParam()), TracerKind::slices, fans()));
}

TEST_P(TracerSlices, SameBitsInAnyBatch) {
  const auto world = hills_under(GetParam(), kMarkers);
  const auto batch = sense_by(world, TracerKind::slices, fans());
  for (const auto& [threads, block_size] : {std::pair{2, 1}, std::pair{1, 3}}) {
    expect_same_ranges(*batch, *sense_by(world, TracerKind::slices, fans(), threads, block_size));
  }
  BatchConfig config = batch->config();
  config.num_envs = 1;
  const Poses poses = poses_over_hills(kFanDrones);
  for (std::size_t lidar = 0; lidar < fans().size(); ++lidar) {
    config.lidars = {fans()[lidar]};
    Batch alone(config, {world});
    const auto& ranges = batch->lidar(lidar).readings().ranges;
    for (std::size_t drone = 0; drone < kFanDrones; ++drone) {
      alone.set_pose(testing::row(poses.position, drone, 3), testing::row(poses.quat_wxyz, drone, 4));
      alone.sense();
      EXPECT_TRUE(same_bits(alone.lidar().readings().ranges, testing::row(ranges, drone, ranges.size() / kFanDrones)))
          << fans()[lidar].name << ", drone " << drone;
    }
  }
}

TEST_P(TracerSlices, NoRayGoesThroughEmbreeForTriangles) {
  const auto world = hills_under(GetParam(), kMarkers);
  EXPECT_EQ(sense_by(world, TracerKind::slices, fans())->embree().rays, 0);
  EXPECT_GT(sense_by(world, TracerKind::embree, fans())->embree().rays, 0);
}

// The largest fan that has too few beams for a slice, the smallest that has enough, and one whose beams are too far apart.
constexpr int kTooFew = static_cast<int>(trace::kMinRaysInSlice) - 1, kEnough = kTooFew + 1;
LidarConfig few_beams() { return spaced_fan("few", kTooFew, 0.9F * trace::kWidestInSlice); }
LidarConfig enough_beams() { return spaced_fan("enough", kEnough, 0.9F * trace::kWidestInSlice); }
LidarConfig sparse_beams() { return spaced_fan("sparse", kEnough, 1.1F * trace::kWidestInSlice); }

TEST_P(TracerSlices, AutoUsesThemForEnoughBeams) {
  const auto world = hills_under(GetParam(), kMarkers);
  const std::vector few{few_beams()}, enough{enough_beams()}, sparse{sparse_beams()};
  EXPECT_GT(sense_by(world, TracerKind::automatic, few)->embree().rays, 0);
  EXPECT_GT(sense_by(world, TracerKind::automatic, sparse)->embree().rays, 0);
  EXPECT_EQ(sense_by(world, TracerKind::slices, few)->embree().rays, 0);
  EXPECT_GT(sense_by(world, TracerKind::tiles, enough)->embree().rays, 0);
  const auto by_itself = sense_by(world, TracerKind::automatic, enough), slices = sense_by(world, TracerKind::slices, enough);
  EXPECT_EQ(by_itself->embree().rays, 0);
  EXPECT_TRUE(same_bits(by_itself->lidar().readings().ranges, slices->lidar().readings().ranges));
}

INSTANTIATE_TEST_SUITE_P(FewAndMany, TracerSlices, ::testing::Values(0, 5, 700));

TEST(SlicesAgreement, InWorldsOfPrimitivesAndTriangles) {
  const long wanted = times_tried(4000);
  ScanTally tally;
  for (unsigned seed = part_tried() << 24U; static_cast<long>(tally.rays) < wanted; ++seed) {
    SCOPED_TRACE(seed);
    const auto world = hills_or_shapes(seed);
    tally.compare(*world,
                  {sense_by(world, TracerKind::slices, fans(), 1, 64, seed).get(),
                   sense_by(world, TracerKind::embree, fans(), 1, 64, seed).get()},
                  3);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(tally.compared, tally.rays / 2);
  EXPECT_GT(tally.hits, tally.compared / 4);
  testing::tried("slices", static_cast<long>(tally.compared));
}

// -- The walk that a tracer remembers from its last slice.

// A hilly ball of radius 3 m, far too many triangles for the leaves of a slice to be listed, with a small cube in it.
TriangleMesh dense_ball(Random& random) {
  TriangleMesh mesh = testing::ball(120, 240, 0.1F, random);
  add_box(mesh, Vec3(1, 0, 0), Vec3::Constant(0.3F));
  return mesh;
}

// Returns the distances of a scan by a tracer.
std::vector<float> measured_by(trace::Tracer& tracer, const trace::Scene& scene, const sensors::BeamPattern& pattern,
                               const trace::Viewpoint& viewpoint) {
  std::vector<float> ranges(pattern.columns, -1.0F);
  tracer.set_viewpoint(scene, viewpoint);
  for (const sensors::BeamTile& tile : pattern.tiles) {
    tracer.enqueue({.x = pattern.x.data() + tile.first,
                    .y = pattern.y.data() + tile.first,
                    .z = pattern.z.data() + tile.first,
                    .rows = tile.rows,
                    .width = tile.width,
                    .frustum = &tile.frustum,
                    .fan = &pattern.fans[static_cast<std::size_t>(tile.fan)]},
                   ranges.data() + tile.beam, pattern.columns);
  }
  tracer.finish();
  return ranges;
}

// Writes the distances of a scan, each fan by one walk of the tree. Returns true if the last fan suggests the ordered one.
bool walk_by(trace::SliceWalk walk, const trace::MeshTree& tree, const sensors::BeamPattern& pattern,
             const trace::Viewpoint& viewpoint, std::vector<float>& ranges) {
  bool is_full = false;
  ranges.clear();
  for (const trace::Fan& fan : pattern.fans) {
    trace::RayBundle rays{};
    rays.origin = viewpoint.origin;
    rays.rotation = viewpoint.rotation;
    rays.range = viewpoint.range;
    rays.count = fan.count;
    std::fill_n(rays.t_hit, rays.count, std::numeric_limits<float>::infinity());
    std::fill_n(rays.element, rays.count, -1);
    is_full = trace::trace_mesh_slice(tree, 0, fan, rays, walk);
    ranges.insert(ranges.end(), rays.t_hit, rays.t_hit + rays.count);
  }
  return is_full;
}

// Drones take turns: in the ball with the whole of it in range, with little in range, in the cube, and with nothing in range.
TEST(TracerSlicesOf, TheWalkOfTheLastScanDoesNotMatter) {
  const FlushDenormals flush;
  Random random(13);
  const auto world = make_world({}, {}, dense_ball(random));
  const trace::Scene& scene = prepared(*world).scene();
  scene.prepare_tiles(world->triangles());
  const trace::TracePolicy policy{.min_rays_in_slice = 1};
  std::vector<sensors::BeamPattern> patterns;
  for (const LidarConfig& lidar : {fan_of("around", 256, 360.0F, 50.0F), fan_of("sector", 35, 200.0F, 50.0F),
                                   fan_of("in parts", 600, 360.0F, 50.0F), fan_of("narrow", 9, 30.0F, 50.0F)}) {
    patterns.push_back(sensors::make_pattern(lidar, policy));
  }
  const auto tracer = std::make_unique<trace::Tracer>();
  // Each kind of scan, by whether the one before it suggests the ordered walk: full ones, others that hit, and misses.
  std::array<std::array<int, 3>, 2> scans{};
  bool was_full = false;
  for (int i = 0; i < 300; ++i) {
    const auto kind = random.generator()() % 4;
    const Vec3 place = kind == 2 ? Vec3(Vec3(1, 0, 0) + random.point(0.2F)) : kind == 3 ? Vec3(9, 9, 9) : random.point(1.0F);
    const trace::Viewpoint viewpoint{.origin = place,
                                     .rotation = random.rotation().toRotationMatrix(),
                                     .range = kind == 0 || kind == 2 ? 50.0F : 2.5F,
                                     .policy = policy};
    const sensors::BeamPattern& pattern = patterns[random.generator()() % patterns.size()];
    const std::vector<float> ranges = measured_by(*tracer, scene, pattern, viewpoint);
    ASSERT_TRUE(same_bits(ranges, measured_by(*std::make_unique<trace::Tracer>(), scene, pattern, viewpoint))) << "scan " << i;
    std::vector<float> by_walk;
    bool is_full = was_full;
    for (const trace::SliceWalk walk : {trace::SliceWalk::listed, trace::SliceWalk::ordered, trace::SliceWalk::automatic}) {
      const bool suggests_ordered = walk_by(walk, *scene.tiles(), pattern, viewpoint, by_walk);
      if (walk == (was_full ? trace::SliceWalk::ordered : trace::SliceWalk::automatic)) is_full = suggests_ordered;
      ASSERT_TRUE(same_bits(ranges, by_walk)) << "scan " << i;
    }
    const bool hits = std::ranges::any_of(ranges, [](float t) { return std::isfinite(t); });
    ++scans[was_full ? 1 : 0][is_full ? 0 : hits ? 1 : 2];
    was_full = is_full;
  }
  EXPECT_EQ(tracer->embree_use().rays, 0);
  for (const auto& after : scans) {
    for (const int count : after) EXPECT_GT(count, 10);
  }
}

// Only one of three channels lies in a plane; Embree traces the others.
TEST(TracerSlicesOf, OneChannelOfThreeAgreeWithAnOracle) {
  const auto world = hills_under(5);
  const std::vector three{fan_of("three", 60, 270.0F, 20.0F, 3, 40.0F)};
  const auto slices = sense_by(world, TracerKind::slices, three), tiles = sense_by(world, TracerKind::tiles, three);
  ScanTally tally;
  tally.compare(*world, {slices.get(), tiles.get()}, 1);
  EXPECT_GT(tally.hits, tally.rays / 4);
  EXPECT_GT(slices->embree().rays, 0);
  EXPECT_LT(slices->embree().rays, tiles->embree().rays);
  const auto &a = slices->lidar().readings().ranges, &b = tiles->lidar().readings().ranges;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (i / 60 % 3 == 1) continue;
    ASSERT_TRUE(same_bits(std::span(&a[i], 1), std::span(&b[i], 1))) << "ray " << i;
  }
}

TEST(TracerSlicesOf, HaveTheSameBitsOnEverySimdTarget) {
  const auto world = hills_under(5);
  const auto first = sense_by(world, TracerKind::slices, fans());
  ASSERT_GT(hwy::SupportedAndGeneratedTargets().size(), 1U);
  on_every_target([&] { expect_same_ranges(*first, *sense_by(world, TracerKind::slices, fans())); });
}

TEST(TracerSlicesOf, WorldsWithoutTrianglesDoNotUseThem) {
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 3}, {12, 12, 4}),
                                 primitive(PrimitiveKind::sphere, {3, 1, 2}, Vec3::Constant(0.5F))});
  const auto slices = sense_by(world, TracerKind::slices, fans());
  expect_same_ranges(*slices, *sense_by(world, TracerKind::tiles, fans()));
  EXPECT_EQ(prepared(*world).scene().tiles(), nullptr);
}

// A changed LiDAR measures the same as one made with these settings.
TEST(TracerSlicesOf, ChangedLidarsEqualThoseMadeThatWay) {
  const auto world = hills_under(5);
  const std::vector before{fan_of("lidar", 35, 270.0F, 8.0F)};
  const auto expect = [&](const LidarChange& change, const LidarConfig& after) {
    const auto changed = sense_by(world, TracerKind::slices, before), made = sense_by(world, TracerKind::slices, {after});
    changed->lidar().set(change);
    changed->sense();
    EXPECT_TRUE(same_bits(changed->lidar().readings().ranges, made->lidar().readings().ranges));
  };
  LidarConfig after = before[0];
  after.hfov_deg = 360.0F;
  expect({.hfov_deg = 360.0F}, after);
  after.beams = 300;
  expect({.hfov_deg = 360.0F, .beams = 300}, after);
  after = before[0];
  after.quat_wxyz = {0.6F, 0, 0.8F, 0};
  expect({.quat_wxyz = after.quat_wxyz}, after);
  after = before[0];
  after.channels = 3;
  after.vfov_deg = 30.0F;
  expect({.vfov_deg = 30.0F, .channels = 3}, after);
}

// -- Patterns.

struct FansOfPattern {
  std::vector<std::size_t> beams;  // of each fan
  std::size_t others = 0;          // beams in no fan
};

FansOfPattern fans_in(const LidarConfig& config, TracerKind tracer = TracerKind::slices) {
  const std::size_t rays = static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns());
  const sensors::BeamPattern pattern = sensors::make_pattern(config, trace::trace_policy_of(tracer, rays));
  FansOfPattern found;
  for (const sensors::BeamTile& tile : pattern.tiles) {
    if (tile.fan < 0) {
      found.others += tile.rows * tile.width;
      continue;
    }
    const trace::Fan& fan = pattern.fans[static_cast<std::size_t>(tile.fan)];
    EXPECT_EQ(fan.count, tile.rows * tile.width);
    found.beams.push_back(fan.count);
    // Each ray of the fan points where its beam does.
    for (std::size_t i = 0; i < fan.count; ++i) {
      const std::size_t beam = tile.first + static_cast<std::size_t>(fan.ray[i]);
      const Vec3 seen = fan.to_sensor * Vec3(fan.x[i], fan.y[i], 0.0F);
      EXPECT_LT((seen - Vec3(pattern.x[beam], pattern.y[beam], pattern.z[beam])).norm(), 3e-7F) << "beam " << beam;
    }
  }
  EXPECT_EQ(found.beams.size(), pattern.fans.size());
  EXPECT_EQ(std::accumulate(found.beams.begin(), found.beams.end(), found.others), rays);
  EXPECT_EQ(sensors::has_fans(config, tracer), !found.beams.empty());
  return found;
}

TEST(TracerSlicesOf, PatternsInAPlaneHaveFans) {
  using Beams = std::vector<std::size_t>;
  for (const LidarConfig& config : fans()) {
    SCOPED_TRACE(config.name);
    const FansOfPattern found = fans_in(config);
    EXPECT_EQ(found.others, 0U);
    EXPECT_EQ(found.beams.size(), config.columns() > 256 ? 3U : 1U);
  }
  EXPECT_EQ(fans_in(fan_of("one", 1, 270.0F, 3.0F)).beams, Beams{1});
  EXPECT_EQ(fans_in(fan_of("full", 256, 360.0F, 3.0F)).beams, Beams{256});
  EXPECT_EQ(fans_in(fan_of("in parts", 257, 360.0F, 3.0F)).beams, (Beams{128, 129}));
  EXPECT_EQ(fans_in(fan_of("in parts", 600, 360.0F, 3.0F)).beams, (Beams{200, 200, 200}));

  EXPECT_EQ(fans_in(fan_of("vertical", 1, 1.0F, 3.0F, 300, 170.0F)).beams, (Beams{150, 150}));

  LidarConfig three = fan_of("three", 60, 270.0F, 3.0F, 3, 30.0F);
  EXPECT_EQ(fans_in(three).beams, Beams{60});
  EXPECT_EQ(fans_in(three).others, 120U);
  three.vfov_deg = 0.0F;
  EXPECT_EQ(fans_in(three).beams, (Beams{60, 60, 60}));
}

TEST(TracerSlicesOf, ConesAndGridsHaveNoFans) {
  LidarConfig cones = fan_of("cones", 60, 270.0F, 3.0F, 2, 20.0F);
  EXPECT_TRUE(fans_in(cones).beams.empty());
  cones.channels = 5;  // one of them is level
  EXPECT_TRUE(fans_in(cones).beams.empty());

  LidarConfig cone = fan_of("cone", 35, 270.0F, 3.0F);
  for (int i = 0; i < 40; ++i) {
    cone.azimuth_deg.push_back(5.0F * static_cast<float>(i));
    cone.elevation_deg.push_back(10.0F);
  }
  EXPECT_TRUE(fans_in(cone).beams.empty());
  cone.elevation_deg.assign(40, 0.0F);
  EXPECT_EQ(fans_in(cone).beams.size(), 1U);
  cone.elevation_deg[17] = 0.01F;
  EXPECT_TRUE(fans_in(cone).beams.empty());
}

TEST(TracerSlicesOf, TracersDecideWhichFansAreMade) {
  const LidarConfig few = few_beams(), enough = enough_beams(), sparse = sparse_beams();
  EXPECT_TRUE(fans_in(few, TracerKind::automatic).beams.empty());
  EXPECT_EQ(fans_in(enough, TracerKind::automatic).beams.size(), 1U);
  EXPECT_EQ(fans_in(few, TracerKind::slices).beams.size(), 1U);
  for (const TracerKind tracer : {TracerKind::tiles, TracerKind::embree}) {
    EXPECT_TRUE(fans_in(enough, tracer).beams.empty());
  }
  EXPECT_TRUE(fans_in(sparse, TracerKind::automatic).beams.empty());
  EXPECT_EQ(fans_in(sparse, TracerKind::slices).beams.size(), 1U);
}

}  // namespace
}  // namespace flockstep
