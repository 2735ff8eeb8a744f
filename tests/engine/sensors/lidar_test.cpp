#include "sensors/lidar.hpp"

#include "batch_helpers.hpp"
#include "ray_oracle.hpp"

namespace flockstep {
namespace {

using oracle::Vec3d;
using namespace testing;

// -- Beams as defined by the conventions, in double precision.

struct Beam {
  double azimuth_deg, elevation_deg;
};

std::vector<Beam> beams_of(const LidarConfig& config) {
  std::vector<Beam> beams;
  for (std::size_t i = 0; i < config.azimuth_deg.size(); ++i) beams.push_back({config.azimuth_deg[i], config.elevation_deg[i]});
  if (config.has_pattern()) return beams;
  const double hfov = config.hfov_deg;
  const double vfov = config.vfov_deg;
  for (int channel = 0; channel < config.channels; ++channel) {
    double elevation = config.vfov_center_deg;
    if (config.channels > 1) elevation += -vfov / 2 + vfov * channel / (config.channels - 1);
    for (int beam = 0; beam < config.beams; ++beam) {
      double azimuth = 0.0;
      if (config.beams > 1) azimuth = -hfov / 2 + hfov * beam / (hfov == 360.0 ? config.beams : config.beams - 1);
      beams.push_back({azimuth, elevation});
    }
  }
  return beams;
}

// Rotates v by q: Rodrigues' formula for q v q*.
Vec3d rotated(const Eigen::Vector4d& wxyz, const Vec3d& v) {
  const Eigen::Vector4d q = wxyz.normalized();
  const Vec3d axis = q.tail<3>();
  const Vec3d twice = 2.0 * axis.cross(v);
  return v + q[0] * twice + axis.cross(twice);
}

Eigen::Vector4d wxyz_of(const std::array<float, 4>& q) { return Eigen::Vector4f(q.data()).cast<double>(); }

// Returns the direction of a beam in the body frame.
Vec3d direction_of(const LidarConfig& config, const Beam& beam) {
  const double azimuth = beam.azimuth_deg * std::numbers::pi / 180.0;
  const double elevation = beam.elevation_deg * std::numbers::pi / 180.0;
  const Vec3d direction(std::cos(azimuth) * std::cos(elevation), std::sin(azimuth) * std::cos(elevation), std::sin(elevation));
  return rotated(wxyz_of(config.quat_wxyz), direction);
}

std::vector<Vec3d> directions_of(const Batch& batch, std::size_t drone = 0) {
  const auto rays = static_cast<std::size_t>(batch.config().lidars[0].rows() * batch.config().lidars[0].columns());
  std::vector<float> all(batch.state().active.size() * rays * 3);
  batch.lidar().directions(all);
  std::vector<Vec3d> directions;
  for (std::size_t ray = 0; ray < rays; ++ray) {
    directions.push_back(Eigen::Vector3f(all.data() + 3 * (drone * rays + ray)).cast<double>());
  }
  return directions;
}

void expect_beams(const LidarConfig& config) {
  const Batch batch(lidar_batch(1, config), {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {4, 4, 4})})});
  const std::vector<Vec3d> directions = directions_of(batch);
  const std::vector<Beam> beams = beams_of(config);
  ASSERT_EQ(directions.size(), beams.size());
  for (std::size_t i = 0; i < beams.size(); ++i) {
    ASSERT_LT((directions[i] - direction_of(config, beams[i])).norm(), 2e-7) << "beam " << i;
  }
}

double azimuth_deg(const Vec3d& v) { return std::atan2(v.y(), v.x()) * 180.0 / std::numbers::pi; }
double elevation_deg(const Vec3d& v) { return std::asin(v.z()) * 180.0 / std::numbers::pi; }

std::vector<Vec3d> directions_of(const LidarConfig& config) {
  return directions_of(Batch(lidar_batch(1, config), {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {4, 4, 4})})}));
}

TEST(LidarBeams, AFanRunsCounterClockwiseWithBothEnds) {
  const auto fan = directions_of(LidarConfig());
  ASSERT_EQ(fan.size(), 35U);
  EXPECT_NEAR(azimuth_deg(fan.front()), -135.0, 1e-5);
  EXPECT_NEAR(azimuth_deg(fan[1]), -135.0 + 270.0 / 34.0, 1e-5);
  EXPECT_NEAR(azimuth_deg(fan[17]), 0.0, 1e-5);
  EXPECT_NEAR(azimuth_deg(fan.back()), 135.0, 1e-5);
  expect_beams(LidarConfig());
  expect_beams({.beams = 2, .hfov_deg = 359.0F});
  expect_beams({.beams = 720, .hfov_deg = 90.0F});
}

TEST(LidarBeams, AFullTurnLeavesTheEndOut) {
  const auto turn = directions_of({.beams = 4, .hfov_deg = 360.0F});
  const std::vector<Vec3d> expected{{-1, 0, 0}, {0, -1, 0}, {1, 0, 0}, {0, 1, 0}};
  for (std::size_t i = 0; i < 4; ++i) EXPECT_LT((turn[i] - expected[i]).norm(), 1e-7) << i;
  expect_beams({.beams = 360, .hfov_deg = 360.0F});
  expect_beams({.channels = 3, .beams = 7, .hfov_deg = 360.0F, .vfov_deg = 40.0F});
}

TEST(LidarBeams, OneBeamLooksForwardAndOneChannelAtTheHorizon) {
  for (const float hfov : {10.0F, 270.0F, 360.0F}) {
    const auto one = directions_of({.beams = 1, .hfov_deg = hfov, .vfov_deg = 30.0F});
    EXPECT_EQ(one[0], Vec3d(1, 0, 0)) << hfov;
  }
  for (const Vec3d& beam : directions_of({.vfov_deg = 90.0F})) EXPECT_EQ(beam.z(), 0.0);
}

TEST(LidarBeams, AGridHasARowPerChannelFromBelow) {
  const auto grid = directions_of({.channels = 16, .beams = 5, .hfov_deg = 120.0F, .vfov_deg = 30.0F});
  ASSERT_EQ(grid.size(), 80U);
  EXPECT_NEAR(elevation_deg(grid[0]), -15.0, 1e-5);
  EXPECT_NEAR(azimuth_deg(grid[0]), -60.0, 1e-5);
  EXPECT_NEAR(elevation_deg(grid[4]), -15.0, 1e-5);
  EXPECT_NEAR(azimuth_deg(grid[4]), 60.0, 1e-5);
  EXPECT_NEAR(elevation_deg(grid[5]), -13.0, 1e-5);
  EXPECT_NEAR(elevation_deg(grid[79]), 15.0, 1e-5);
  expect_beams({.channels = 16, .beams = 5, .hfov_deg = 120.0F, .vfov_deg = 30.0F});
  expect_beams({.channels = 2, .beams = 9, .vfov_deg = 180.0F});
  expect_beams({.channels = 5, .beams = 1, .vfov_deg = 60.0F});
}

TEST(LidarBeams, AFieldOfViewMayLieAboveOrBelowTheHorizon) {
  const auto grid = directions_of({.channels = 40, .beams = 8, .hfov_deg = 360.0F, .vfov_deg = 59.0F, .vfov_center_deg = 22.5F});
  EXPECT_NEAR(elevation_deg(grid.front()), -7.0, 1e-5);
  EXPECT_NEAR(elevation_deg(grid.back()), 52.0, 1e-5);
  expect_beams({.channels = 40, .beams = 8, .hfov_deg = 360.0F, .vfov_deg = 59.0F, .vfov_center_deg = 22.5F});
  expect_beams({.channels = 3, .beams = 35, .vfov_deg = 100.0F, .vfov_center_deg = -40.0F});
  for (const Vec3d& beam : directions_of({.vfov_center_deg = 30.0F})) EXPECT_NEAR(beam.z(), 0.5, 1e-7);
  EXPECT_REFUSED((LidarConfig{.channels = 2, .vfov_deg = 100.0F, .vfov_center_deg = -41.0F}.validate()), "lidar.vfov_center_deg");
  EXPECT_REFUSED((LidarConfig{.vfov_center_deg = 1.0F, .azimuth_deg = {0}, .elevation_deg = {0}}.validate()),
                 "lidar.vfov_center_deg");
}

TEST(LidarBeams, APatternIsItsTwoLists) {
  const LidarConfig pattern{.azimuth_deg = {0, 90, -45, 360, 12.5F}, .elevation_deg = {0, 0, 30, -90, 89}};
  const auto beams = directions_of(pattern);
  EXPECT_LT((beams[0] - Vec3d(1, 0, 0)).norm(), 1e-7);
  EXPECT_LT((beams[1] - Vec3d(0, 1, 0)).norm(), 1e-7);
  EXPECT_LT((beams[2] - Vec3d(std::sqrt(0.375), -std::sqrt(0.375), 0.5)).norm(), 1e-7);
  EXPECT_LT((beams[3] - Vec3d(0, 0, -1)).norm(), 1e-7);
  expect_beams(pattern);
}

TEST(LidarBeams, TheMountingTurnsThemAndItsPlaceDoesNot) {
  // A quarter turn to the left, then a quarter turn nose down.
  const auto half = static_cast<float>(std::numbers::sqrt2 / 2.0);
  LidarConfig config{.offset_m = {1, 2, 3}, .azimuth_deg = {0, 90}, .elevation_deg = {0, 0}};
  config.quat_wxyz = {half, 0, 0, half};
  auto beams = directions_of(config);
  EXPECT_LT((beams[0] - Vec3d(0, 1, 0)).norm(), 1e-7);
  EXPECT_LT((beams[1] - Vec3d(-1, 0, 0)).norm(), 1e-7);
  config.quat_wxyz = {half, 0, half, 0};
  beams = directions_of(config);
  EXPECT_LT((beams[0] - Vec3d(0, 0, -1)).norm(), 1e-7);
  EXPECT_LT((beams[1] - Vec3d(0, 1, 0)).norm(), 1e-7);
  Random random(1);
  for (int i = 0; i < 10; ++i) {
    const Quat turn = random.rotation();
    const float length = random.within(0.995F, 1.005F);  // normalised on input
    expect_beams({.channels = 3,
                  .vfov_deg = 50.0F,
                  .quat_wxyz = {length * turn.w(), length * turn.x(), length * turn.y(), length * turn.z()}});
  }
}

// -- Ranges.

// Four primitives, so that everything in range is traced directly.
std::vector<Primitive> a_few() {
  const Quat tilted = Quat(Eigen::AngleAxisf(0.6F, Vec3(1, 2, 3).normalized()));
  return {primitive(PrimitiveKind::room, {0, 0, 0}, {5, 4, 3}), primitive(PrimitiveKind::box, {2, 1, 0}, {0.5F, 0.7F, 1}, tilted),
          primitive(PrimitiveKind::cylinder, {-2, 1, -1}, {0.5F, 0.5F, 1.5F}, tilted),
          primitive(PrimitiveKind::sphere, {0, -2, 1}, {0.8F, 0.8F, 0.8F})};
}

// 120 primitives and some triangles, so that many rays go through Embree.
std::shared_ptr<const World> crowded_world() {
  Random random(2);
  std::vector<Primitive> primitives{primitive(PrimitiveKind::room, {0, 0, 0}, {5, 4, 3})};
  TriangleMesh mesh;
  for (int i = 0; i < 40; ++i) {
    const float radius = random.within(0.1F, 0.3F);
    primitives.push_back(primitive(PrimitiveKind::box, random.point(3.5F), {radius, 0.3F, 0.4F}, random.rotation()));
    primitives.push_back(primitive(PrimitiveKind::cylinder, random.point(3.5F), {radius, radius, 0.5F}, random.rotation()));
    primitives.push_back(primitive(PrimitiveKind::sphere, random.point(3.5F), Vec3::Constant(radius)));
    const Vec3 corner = random.point(3.5F);
    for (int k = 0; k < 3; ++k) mesh.vertices.push_back(corner + random.point(0.8F));
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return make_world(std::move(primitives), {}, std::move(mesh));
}

// Checks the scan of one drone with this LiDAR against the oracle.
void expect_scan(const Batch& batch, std::size_t drone, const LidarConfig& config) {
  SCOPED_TRACE("drone " + std::to_string(drone));
  const State& state = batch.state();
  const World& world = *batch.worlds()[static_cast<std::size_t>(state.world_index[drone])];
  const Vec3d position = Eigen::Vector3f(state.position.data() + 3 * drone).cast<double>();
  const Eigen::Vector4d wxyz = Eigen::Vector4f(state.quat_wxyz.data() + 4 * drone).cast<double>();
  const Vec3d origin = position + rotated(wxyz, Eigen::Vector3f(config.offset_m.data()).cast<double>());
  const std::vector<Beam> beams = beams_of(config);
  const auto ranges = row(batch.lidar().readings().ranges, drone, beams.size());
  const double max_range = config.max_range_m;
  std::size_t compared = 0;
  for (std::size_t ray = 0; ray < beams.size(); ++ray) {
    const Vec3d direction = rotated(wxyz, direction_of(config, beams[ray]));
    const oracle::Hit expected = oracle::nearest(world, origin, direction, max_range);
    if (!oracle::is_clear_cut(world, expected, origin, direction, max_range)) continue;
    ++compared;
    if (expected.element < 0) {
      ASSERT_EQ(ranges[ray], kInfinity) << "ray " << ray;
    } else {
      ASSERT_NEAR(static_cast<double>(ranges[ray]), expected.t, 2e-5) << "ray " << ray;
    }
  }
  EXPECT_GT(compared, beams.size() * 9 / 10);
}

TEST(LidarRanges, AgreeWithTheOracleInRandomPoses) {
  const LidarConfig config{.channels = 3,
                           .beams = 40,
                           .hfov_deg = 300.0F,
                           .vfov_deg = 70.0F,
                           .max_range_m = 4.0F,
                           .offset_m = {0.3F, -0.2F, 0.1F},
                           .quat_wxyz = {0.8F, 0.2F, -0.4F, 0.4F}};
  for (const auto& world : {make_world(a_few()), crowded_world()}) {
    Random random(3);
    Batch batch(lidar_batch(24, config), {world});
    const Poses poses = random_poses(random, 24, {4.5F, 3.5F, 2.5F});
    batch.set_pose(poses.position, poses.quat_wxyz);
    batch.sense();
    for (std::size_t drone = 0; drone < 24; ++drone) expect_scan(batch, drone, config);
    const auto& ranges = batch.lidar().readings().ranges;
    const auto misses = std::count(ranges.begin(), ranges.end(), kInfinity);
    EXPECT_GT(misses, 0);
    EXPECT_LT(misses, static_cast<std::ptrdiff_t>(ranges.size()) / 2);
  }
}

TEST(LidarRanges, MoreRaysThanABlock) {
  // A block has 256 rays. Covers scans around one block, and scans of many blocks.
  for (const auto& [channels, beams] : {std::pair{1, 255}, {1, 256}, {1, 257}, {3, 171}, {16, 360}}) {
    SCOPED_TRACE(std::to_string(channels) + " x " + std::to_string(beams));
    const LidarConfig config{.channels = channels, .beams = beams, .hfov_deg = 360.0F, .vfov_deg = 60.0F, .max_range_m = 6.0F};
    Random random(4);
    Batch batch(lidar_batch(2, config), {make_world(a_few()), crowded_world()});
    const Poses poses = random_poses(random, 2, {4.5F, 3.5F, 2.5F});
    batch.set_pose(poses.position, poses.quat_wxyz);
    batch.sense();
    for (std::size_t drone = 0; drone < 2; ++drone) expect_scan(batch, drone, config);
  }
}

TEST(LidarRanges, AHitAtTheRangeItselfIsAHit) {
  // A box's face 2 m ahead, first with only its room, then with enough spheres in view that no scan is traced directly.
  std::vector<Primitive> alone{primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8}),
                               primitive(PrimitiveKind::box, {2.5F, 0, 0}, {0.5F, 1, 1})};
  std::vector<Primitive> crowd = alone;
  for (int i = 0; i < 40; ++i) {
    const float angle = 0.4F + 0.06F * static_cast<float>(i);  // to the left
    crowd.push_back(primitive(PrimitiveKind::sphere, {std::cos(angle), std::sin(angle), 0}, Vec3::Constant(0.1F)));
  }
  const LidarConfig ahead{.max_range_m = 2.0F, .azimuth_deg = {0, 180}, .elevation_deg = {0, 0}};
  for (const auto& world : {make_world(alone), make_world(crowd)}) {
    Batch batch(lidar_batch(3, ahead), {world});
    batch.set_pose(std::vector<float>(9, 0.0F), {});
    batch.lidar().set({.max_range_m = std::nextafter(2.0F, 0.0F)}, std::vector<std::uint8_t>{0, 1, 0});
    batch.lidar().set({.max_range_m = 8.0F}, std::vector<std::uint8_t>{0, 0, 1});
    batch.sense();
    EXPECT_EQ(batch.lidar().readings().ranges, (std::vector<float>{2, kInfinity, kInfinity, kInfinity, 2, 8}));
  }
}

TEST(LidarRanges, PointsLieWhereTheRangesSay) {
  const LidarConfig config{
      .channels = 2, .vfov_deg = 40.0F, .max_range_m = 4.0F, .offset_m = {0.3F, -0.2F, 0.1F}, .quat_wxyz = {0.6F, 0, 0.8F, 0}};
  Random random(5);
  Batch batch(lidar_batch(9, config), {crowded_world()});
  const Poses poses = random_poses(random, 9, {4.5F, 3.5F, 2.5F});
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense();
  std::vector<float> points(9 * 70 * 3);
  batch.lidar().points(points);
  const std::vector<Beam> beams = beams_of(config);
  for (std::size_t drone = 0; drone < 9; ++drone) {
    const Eigen::Vector4d wxyz = Eigen::Vector4f(batch.state().quat_wxyz.data() + 4 * drone).cast<double>();
    for (std::size_t ray = 0; ray < 70; ++ray) {
      const Vec3 point(points.data() + 3 * (70 * drone + ray));
      const float range = batch.lidar().readings().ranges[70 * drone + ray];
      if (range == kInfinity) {
        EXPECT_EQ(point, Vec3::Constant(kInfinity));
        continue;
      }
      const Vec3d in_body =
          Eigen::Vector3f(config.offset_m.data()).cast<double>() + static_cast<double>(range) * direction_of(config, beams[ray]);
      const Vec3d expected = Eigen::Vector3f(batch.state().position.data() + 3 * drone).cast<double>() + rotated(wxyz, in_body);
      EXPECT_LT((point.cast<double>() - expected).norm(), 5e-6) << drone << ' ' << ray;
    }
  }
}

// -- Changes at run time.

TEST(LidarChange, EqualsASensorMadeThatWay) {
  const LidarConfig config{.channels = 2, .beams = 20, .hfov_deg = 200.0F, .vfov_deg = 30.0F, .max_range_m = 4.0F};
  LidarConfig shorter = config;
  shorter.max_range_m = 1.5F;
  LidarConfig wider = config;
  wider.hfov_deg = 360.0F;
  wider.vfov_deg = 80.0F;
  LidarConfig moved = config;
  moved.offset_m = {0.4F, 0, -0.3F};
  LidarConfig turned = config;
  turned.quat_wxyz = {0.6F, 0, 0.8F, 0};
  const std::vector<LidarConfig> configs{config, shorter, wider, moved, turned, config};

  Random random(6);
  const std::vector<std::shared_ptr<const World>> worlds{crowded_world()};
  const Poses poses = random_poses(random, 6, {4.5F, 3.5F, 2.5F});
  Batch batch(lidar_batch(6, config), worlds);
  const auto only = [](std::size_t drone) {
    std::vector<std::uint8_t> mask(6, 0);
    mask[drone] = 1;
    return mask;
  };
  batch.lidar().set({.max_range_m = shorter.max_range_m}, only(1));
  batch.lidar().set({.hfov_deg = wider.hfov_deg, .vfov_deg = wider.vfov_deg}, only(2));
  batch.lidar().set({.offset_m = moved.offset_m}, only(3));
  batch.lidar().set({.quat_wxyz = turned.quat_wxyz}, only(4));
  // Changed, then changed back.
  batch.lidar().set({.max_range_m = 1.0F, .hfov_deg = 10.0F, .offset_m = {{1, 1, 1}}, .quat_wxyz = {{0, 1, 0, 0}}}, only(5));
  batch.lidar().set({.max_range_m = 4.0F, .hfov_deg = 200.0F, .offset_m = {{0, 0, 0}}, .quat_wxyz = {{1, 0, 0, 0}}}, only(5));
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense();
  for (std::size_t drone = 0; drone < 6; ++drone) {
    SCOPED_TRACE(drone);
    EXPECT_EQ(batch.lidar().readings().max_range_m[drone], configs[drone].max_range_m);
    Batch made_so(lidar_batch(1, configs[drone]), worlds);
    made_so.set_pose(row(poses.position, drone, 3), row(poses.quat_wxyz, drone, 4));
    made_so.sense();
    EXPECT_TRUE(same_bits(row(batch.lidar().readings().ranges, drone, 40), made_so.lidar().readings().ranges));
    EXPECT_EQ(directions_of(batch, drone), directions_of(made_so));
    expect_scan(batch, drone, configs[drone]);
    // Each change must be visible, otherwise the comparison proves nothing.
    const bool is_changed =
        !same_bits(row(batch.lidar().readings().ranges, drone, 40), row(batch.lidar().readings().ranges, 0, 40));
    EXPECT_EQ(is_changed, drone != 0);
  }
}

TEST(LidarChange, IsRefusedEvenIfNoDroneIsSelected) {
  Batch batch(lidar_batch(2), {make_world(a_few())});
  batch.remove(std::vector<std::int64_t>{1});
  const std::string before = batch.snapshot();
  for (const std::vector<std::uint8_t>& mask : {std::vector<std::uint8_t>{}, {1, 0}, {0, 1}, {0, 0}}) {
    EXPECT_REFUSED(batch.lidar().set({.max_range_m = -1.0F}, mask), "lidar.max_range_m");
    EXPECT_REFUSED(batch.lidar().set({.max_range_m = 1.0F, .hfov_deg = 361.0F}, mask), "lidar.hfov_deg");
    EXPECT_REFUSED(batch.lidar().set({.vfov_deg = -1.0F}, mask), "lidar.vfov_deg");
    EXPECT_REFUSED(batch.lidar().set({.offset_m = {{0, kNan, 0}}}, mask), "lidar.offset_m");
    EXPECT_REFUSED(batch.lidar().set({.quat_wxyz = {{0, 0, 0, 0}}}, mask), "lidar.quat_wxyz");
  }
  EXPECT_REFUSED(batch.lidar().set({.max_range_m = 1.0F}, std::vector<std::uint8_t>{1}), "mask");
  EXPECT_EQ(batch.snapshot(), before);

  const LidarConfig pattern{.azimuth_deg = {0}, .elevation_deg = {0}};
  Batch patterned(lidar_batch(1, pattern), {make_world(a_few())});
  EXPECT_REFUSED(patterned.lidar().set({.hfov_deg = 90.0F}, std::vector<std::uint8_t>{0}), "hfov_deg");
}

// The errors follow eight floats after the range in the settings of a snapshot.
TEST(LidarChange, ASnapshotWithErrorsThatNeedMemoryIsRefused) {
  Batch batch(lidar_batch(2, {.max_range_m = 4.0625F}), {make_world(a_few())});
  const std::string blob = batch.snapshot();
  constexpr float kRange = 4.0625F;
  const std::size_t at = blob.find(std::string(reinterpret_cast<const char*>(&kRange), sizeof(kRange)));
  ASSERT_NE(at, std::string::npos);
  const auto restore = [&](std::size_t error, float value) {
    std::string damaged = blob;
    std::memcpy(damaged.data() + at + sizeof(float) * (8 + error), &value, sizeof(value));
    batch.restore(mended(damaged));
  };
  EXPECT_REFUSED(restore(0, 1.0F), "lidar.errors.divergence_mrad");
  EXPECT_REFUSED(restore(7, kNan), "lidar.errors.dropout");
  EXPECT_REFUSED(restore(8, 2.0F), "lidar.errors.dropout_per_m");
  EXPECT_REFUSED(restore(9, 80.0F), "lidar.errors.max_incidence_deg");
  EXPECT_REFUSED(restore(10, 0.5F), "lidar.errors.min_intensity");
  EXPECT_EQ(batch.snapshot(), blob);
  restore(7, 0.25F);
  EXPECT_EQ(batch.lidar().config(DroneIndex(0)).errors.dropout, 0.25F);
}

TEST(LidarChange, NeedsALidar) {
  BatchConfig config;
  config.num_threads = 1;
  Batch batch(config, {make_world(a_few())});
  EXPECT_THROW(batch.lidar().set({.max_range_m = 1.0F}), std::logic_error);
  EXPECT_THROW(batch.lidar().config(DroneIndex(0)), std::logic_error);
  EXPECT_TRUE(batch.lidar().readings().max_range_m.empty());
}

// -- The same bits with any neighbours.

TEST(LidarBits, AreTheSameForAnyBlocksThreadsAndNeighbours) {
  const Batch::Worlds worlds{crowded_world(), make_world(a_few()), playground("train-1")};
  // A fan fills a part of a block of rays, a grid more than one block.
  for (const LidarConfig& lidar :
       {LidarConfig(), LidarConfig{.channels = 8, .beams = 50, .hfov_deg = 360.0F, .vfov_deg = 40.0F, .max_range_m = 8.0F}}) {
    constexpr int kDrones = 50;
    const auto rays = static_cast<std::size_t>(lidar.rows() * lidar.columns());
    Random random(7);
    const Poses poses = random_poses(random, kDrones, {4.5F, 3.5F, 2.5F});
    const auto scan = [&](int block_size, int num_threads) {
      BatchConfig config = lidar_batch(kDrones, lidar);
      config.block_size = block_size;
      config.num_threads = num_threads;
      Batch batch(config, worlds);
      batch.set_pose(poses.position, poses.quat_wxyz);
      batch.sense();
      return batch.lidar().readings().ranges;
    };
    const std::vector<float> ranges = scan(64, 1);
    EXPECT_TRUE(same_bits(ranges, scan(1, 1)));
    EXPECT_TRUE(same_bits(ranges, scan(7, 3)));
    EXPECT_TRUE(same_bits(ranges, scan(1, 4)));
    for (std::size_t drone = 0; drone < kDrones; ++drone) {
      Batch alone(lidar_batch(1, lidar), {worlds[drone % 3]});
      alone.set_pose(row(poses.position, drone, 3), row(poses.quat_wxyz, drone, 4));
      alone.sense();
      EXPECT_TRUE(same_bits(row(ranges, drone, rays), alone.lidar().readings().ranges)) << drone;
    }
  }
}

TEST(LidarBits, AMaskScansOnlyItsDrones) {
  Batch batch(lidar_batch(4), {crowded_world()});
  Random random(8);
  const Poses poses = random_poses(random, 4, {4.5F, 3.5F, 2.5F});
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense(std::vector<std::uint8_t>{0, 1, 0, 1});
  const std::vector<float> some = batch.lidar().readings().ranges;
  batch.sense();
  const std::vector<float>& all = batch.lidar().readings().ranges;
  for (std::size_t drone = 0; drone < 4; ++drone) {
    const auto ranges = row(some, drone, 35);
    if (drone % 2 == 1) {
      EXPECT_TRUE(same_bits(ranges, row(all, drone, 35))) << drone;
    } else {
      EXPECT_TRUE(std::all_of(ranges.begin(), ranges.end(), [](float r) { return r == kInfinity; })) << drone;
    }
  }
}

// -- Slots.

TEST(LidarSlots, ARemovedOneReadsInfAndASpawnedOneScans) {
  const LidarConfig lidar{.channels = 3, .beams = 40, .vfov_deg = 50.0F, .max_range_m = 5.0F};
  const Batch::Worlds worlds{crowded_world(), make_world(a_few())};
  Random random(9);
  const Poses poses = random_poses(random, 5, {4.5F, 3.5F, 2.5F});
  Batch batch(lidar_batch(5, lidar), worlds);
  batch.set_pose(poses.position, poses.quat_wxyz);
  batch.sense();
  const std::vector<float> before = batch.lidar().readings().ranges;
  const auto is_absent = [&](std::size_t drone) {
    const auto ranges = row(batch.lidar().readings().ranges, drone, 120);
    return std::all_of(ranges.begin(), ranges.end(), [](float r) { return r == kInfinity; });
  };
  const auto reads_as_before = [&](std::size_t drone) {
    return same_bits(row(batch.lidar().readings().ranges, drone, 120), row(before, drone, 120));
  };

  batch.remove(std::vector<std::int64_t>{1, 3});
  for (int time = 0; time < 2; ++time) {  // immediately, then after a scan
    for (const std::size_t drone : {1U, 3U}) EXPECT_TRUE(is_absent(drone)) << drone;
    for (const std::size_t drone : {0U, 2U, 4U}) EXPECT_TRUE(reads_as_before(drone)) << drone;
    std::vector<float> points(5 * 120 * 3);
    batch.lidar().points(points);
    EXPECT_EQ(std::count(points.begin() + 360, points.begin() + 720, kInfinity), 360);
    batch.sense();
  }

  // At its old place, and in the other world.
  batch.spawn(std::vector<std::int64_t>{3, 1}, {}, {}, std::vector<std::int32_t>{1, 0});
  EXPECT_TRUE(reads_as_before(3));
  Batch other(lidar_batch(1, lidar), {worlds[0]});
  other.set_pose(row(poses.position, 1, 3), row(poses.quat_wxyz, 1, 4));
  other.sense();
  EXPECT_TRUE(same_bits(row(batch.lidar().readings().ranges, 1, 120), other.lidar().readings().ranges));
  EXPECT_FALSE(reads_as_before(1));
  const std::vector<float> spawned = batch.lidar().readings().ranges;
  batch.sense();
  EXPECT_TRUE(same_bits(batch.lidar().readings().ranges, spawned));
}

}  // namespace
}  // namespace flockstep
