#include "batch_helpers.hpp"
#include "flockstep/sensors/lidar.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Batch::Lidar::scan() reads what sense() has read, errors by surfaces included.
TEST(LidarScan, IsTheReadingOfItsDrone) {
  LidarConfig lidar{.channels = 8, .beams = 50, .hfov_deg = 360.0F, .vfov_deg = 40.0F, .max_range_m = 8.0F};
  lidar.errors = {
      .divergence_mrad = 50.0F, .noise_std_m = 0.01F, .dropout = 0.1F, .max_incidence_deg = 60.0F, .min_intensity = 0.02F};
  Random random(10);
  const Poses poses = random_poses(random, 5, {4.5F, 3.5F, 2.5F});
  Batch batch(lidar_batch(5, lidar), {playground("train-1")});
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense();
  std::vector<float> ranges(400);
  for (std::size_t drone = 0; drone < 5; ++drone) {
    batch.lidar().scan(DroneIndex(drone), ranges);
    EXPECT_TRUE(same_bits(ranges, row(batch.lidar().readings().ranges, drone, 400))) << drone;
    EXPECT_GT(std::ranges::count(ranges, kInfinity), 100) << drone;
  }
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
