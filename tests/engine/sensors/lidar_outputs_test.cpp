#include <set>

#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "flockstep/raycast.hpp"
#include "flockstep/sensors/lidar.hpp"
#include "on_target.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Batch::Lidar::scan() reads what sense() has read, errors by surfaces included.
TEST(LidarScan, IsTheReadingOfItsDrone) {
  LidarConfig lidar{
      .channels = 8, .beams = 50, .hfov_deg = 360.0F, .vfov_deg = 40.0F, .waves = 3.0F, .turn_deg = 100.0F, .max_range_m = 8.0F};
  lidar.errors = {
      .divergence_mrad = 50.0F, .noise_std_m = 0.01F, .dropout = 0.1F, .max_incidence_deg = 60.0F, .min_intensity = 0.02F};
  Random random(10);
  const Poses poses = random_poses(random, 5, {4.5F, 3.5F, 2.5F});
  Batch batch(lidar_batch(5, lidar), {playground("train-1")});
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense();
  batch.sense();
  std::vector<float> ranges(400);
  for (std::size_t drone = 0; drone < 5; ++drone) {
    batch.lidar().scan(DroneIndex(drone), ranges);
    EXPECT_TRUE(same_bits(ranges, row(batch.lidar().readings().ranges, drone, 400))) << drone;
    EXPECT_GT(std::ranges::count(ranges, kInfinity), 100) << drone;
  }
}

// The beams of a scan between steps are turned like those of the reading that is shown, so that directions() has them.
TEST(LidarScan, HasTheDirectionsOfALateReading) {
  LidarConfig lidar{.channels = 4, .beams = 50, .hfov_deg = 360.0F, .vfov_deg = 40.0F, .waves = 3.0F, .turn_deg = 100.0F};
  lidar.max_range_m = 20.0F;
  lidar.latency_s = 0.15F;
  const auto world = playground("train-1");
  Batch batch = navigation_batch(1, lidar).make({world});
  batch.reset(seeds_from(1, 1));
  std::set<float> turns;
  std::vector<float> ranges(200), directions(600);
  const std::int64_t forward = 5;
  for (int step = 0; step < 4; ++step) {
    batch.step(std::span(&forward, 1));
    batch.lidar().scan(DroneIndex(0), ranges);
    batch.lidar().directions(directions);
    turns.insert(batch.lidar().readings().turn_deg[0]);
    const Pose pose = pose_of(batch.state(), DroneIndex(0));
    std::vector<float> in_world, from;
    for (std::size_t ray = 0; ray < 200; ++ray) {
      const Vec3 direction = pose.rotation * Vec3(Vec3::Map(&directions[3 * ray]));
      in_world.insert(in_world.end(), direction.data(), direction.data() + 3);
      from.insert(from.end(), pose.position.data(), pose.position.data() + 3);
    }
    const std::vector<float> expected = raycast(*world, from, in_world, 20.0F).t_hit;
    for (std::size_t ray = 0; ray < 200; ++ray) EXPECT_NEAR(ranges[ray], expected[ray], 1e-3F) << ray;
  }
  EXPECT_GT(turns.size(), 2U);
}

// A table of the playground's surfaces has one vector, two or more, depending on the target. No row of beams is a whole number of
// vectors.
TEST(LidarOutputs, HaveTheSameBitsOnEverySimdTarget) {
  LidarConfig lidar{.channels = 5, .beams = 37, .hfov_deg = 360.0F, .vfov_deg = 60.0F, .max_range_m = 8.0F};
  lidar.outputs = {.semantic = true, .instance = true, .intensity = true};
  lidar.errors.min_intensity = 0.005F;
  Random random(11);
  const Poses poses = random_poses(random, 6, {4.5F, 3.5F, 2.5F});
  const Batch::Worlds worlds{playground("train-1"), make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {6, 6, 6}),
                                                                primitive(PrimitiveKind::capsule, {2, 1, 0}, {0.5F, 0.5F, 2})},
                                                               {}, soup(random, 200))};
  std::optional<LidarReadings> first;
  on_every_target([&] {
    Batch batch(lidar_batch(6, lidar), worlds);
    batch.set_pose(poses.position, poses.quat_wxyz);
    batch.sense();
    const LidarReadings& readings = batch.lidar().readings();
    if (!first) first = readings;
    EXPECT_TRUE(same_bits(readings.ranges, first->ranges));
    EXPECT_TRUE(same_bits(readings.intensity, first->intensity));
    EXPECT_EQ(readings.semantic, first->semantic);
    EXPECT_EQ(readings.instance, first->instance);
  });
  EXPECT_GT(std::ranges::count_if(first->intensity, [](float intensity) { return intensity > 0.0F; }), 300);
  EXPECT_GT(std::ranges::count(first->instance, 0), 10);
}

TEST(LidarOutputs, NeedANumberForEachObject) {
  std::vector<Primitive> spheres;
  for (int i = 0; i < 65536; ++i) {
    spheres.push_back(primitive(PrimitiveKind::sphere, {static_cast<float>(i), 0, 0}, {0.1F, 0.1F, 0.1F}));
  }
  const Batch::Worlds worlds{make_world(std::move(spheres))};
  LidarConfig lidar{.beams = 1};
  lidar.outputs.instance = true;
  EXPECT_REFUSED(Batch(lidar_batch(1, lidar), worlds), "lidar.outputs.instance: ... 65535 ... 65536");
  lidar.outputs = {.semantic = true, .intensity = true};
  EXPECT_NO_THROW(Batch(lidar_batch(1, lidar), worlds));
}

}  // namespace
}  // namespace flockstep
