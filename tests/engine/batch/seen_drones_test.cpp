// Drones of an env that see each other by LiDAR and camera.
#include "allocation_counter.hpp"
#include "base/pose_access.hpp"
#include "batch_helpers.hpp"
#include "flockstep/world_builder.hpp"
#include "ray_oracle.hpp"
#include "world/hull_faces.hpp"

namespace flockstep {
namespace {

// OpenGL is optional: tests of it are skipped where it is not installed, and fail where it is but does not work.
bool lacks_opengl(const Batch& batch) { return batch.camera_backend_report().find("not installed") != std::string::npos; }

using oracle::Vec3d;
using namespace testing;

std::shared_ptr<const World> hall() {
  return make_world(
      {primitive(PrimitiveKind::room, {0, 0, 0}, {5, 5, 4}), primitive(PrimitiveKind::cylinder, {1, 1, 0}, {0.3F, 0.3F, 2}),
       primitive(PrimitiveKind::box, {-2, 0, 0}, {0.5F, 0.4F, 0.6F})},
      {.start = Vec3(0, 0, 1), .goal = Vec3(3, 3, 1)});
}

// A coloured arrow that points forward.
std::shared_ptr<const World> arrow() {
  WorldBuilder builder("arrow");
  MeshPart part;
  part.vertices = {{0.5F, 0, 0}, {-0.3F, 0.3F, 0}, {-0.3F, -0.3F, 0}, {-0.2F, 0, 0.25F}};
  part.triangles = {{0, 3, 2}, {0, 1, 3}, {1, 2, 3}, {0, 2, 1}};
  builder.mesh(part, builder.material({.name = "red", .base_color = {0.8F, 0.1F, 0.1F}}));
  return builder.build();
}

BatchConfig flock_of(int num_envs, int drones_per_env, Interaction interaction = Interaction::sense) {
  BatchConfig config{.num_envs = num_envs, .drones_per_env = drones_per_env, .interaction = interaction, .num_threads = 1};
  config.lidars = {{.channels = 5, .beams = 60, .hfov_deg = 360, .vfov_deg = 60, .max_range_m = 6}};
  return config;
}

CameraConfig camera_of(CaptureMode mode = CaptureMode::every_step) {
  return {.width_px = 64,
          .height_px = 48,
          .outputs = {.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true},
          .capture_mode = mode,
          .shadows = true};
}

// Drones of an env that have a camera, and no LiDAR.
BatchConfig filmed(int drones, CameraBackend backend, Interaction interaction = Interaction::sense) {
  BatchConfig config{.num_envs = 1, .drones_per_env = drones, .interaction = interaction, .num_threads = 1};
  config.camera_backend = backend;
  config.cameras = {camera_of()};
  return config;
}

Pose pose_of_row(const Poses& poses, std::size_t row) {
  return load_pose(poses.position.data() + 3 * row, poses.quat_wxyz.data() + 4 * row);
}

// The poses of some rows.
Poses rows_of(const Poses& poses, std::span<const std::size_t> rows) {
  Poses some;
  for (const std::size_t row : rows) {
    some.position.insert(some.position.end(), &poses.position[3 * row], &poses.position[3 * row] + 3);
    some.quat_wxyz.insert(some.quat_wxyz.end(), &poses.quat_wxyz[4 * row], &poses.quat_wxyz[4 * row] + 4);
  }
  return some;
}

// The nearest of the static world, which is element -2, and the other drones of an env.
oracle::Hit nearest(const World& world, const oracle::Hull& hull, const Batch& batch, const Poses& poses, std::size_t drone,
                    const Vec3d& origin, const Vec3d& direction) {
  const auto range = static_cast<double>(batch.config().lidars[0].max_range_m);
  oracle::Hit found = oracle::nearest(world, origin, direction, range);
  if (found.element >= 0) found.element = -2;
  const std::size_t per_env = static_cast<std::size_t>(batch.config().drones_per_env), env = drone / per_env;
  for (std::size_t other = env * per_env; other < (env + 1) * per_env; ++other) {
    if (other == drone || !batch.state().active[other]) continue;
    oracle::Hit hit = hull.hit(pose_of_row(poses, other), origin, direction);
    if (hit.t > range || hit.t >= found.t) continue;
    found = hit;
    found.element = static_cast<int>(other);
  }
  return found;
}

struct RayCounts {
  std::size_t rays = 0, on_drones = 0, unclear = 0;
};

// Checks the ranges of all drones against the nearest hit of each ray.
void check_ranges(const World& world, const DroneModel& model, const Batch& batch, const Poses& poses, RayCounts& counts) {
  const oracle::Hull hull(model.hull());
  const std::vector<float>& ranges = batch.lidar().readings().ranges;
  std::vector<float> directions(3 * ranges.size());
  batch.lidar().directions(directions);
  const std::size_t per_drone = ranges.size() / static_cast<std::size_t>(batch.config().num_drones());
  for (std::size_t ray = 0; ray < ranges.size(); ++ray) {
    const std::size_t drone = ray / per_drone;
    const float range = ranges[ray];
    if (!batch.state().active[drone]) {
      ASSERT_TRUE(std::isinf(range));
      continue;
    }
    const Pose pose = pose_of_row(poses, drone);
    const Vec3d origin = pose.position.cast<double>();
    const Vec3d direction =
        (pose.rotation.cast<double>().normalized() * Vec3(Vec3::Map(&directions[3 * ray])).cast<double>()).normalized();
    const oracle::Hit expected = nearest(world, hull, batch, poses, drone, origin, direction);
    ++counts.rays;
    bool clear = true;
    double steepest = 1.0;
    const Vec3d u = direction.unitOrthogonal(), v = direction.cross(u);
    for (const Vec3d& way : {u, Vec3d(-u), v, Vec3d(-v), direction, Vec3d(-direction)}) {
      const oracle::Hit other = nearest(world, hull, batch, poses, drone, origin + 2e-5 * way, direction);
      clear = clear && other.element == expected.element && (expected.element == -1 || other.normal.dot(expected.normal) > 0.9);
      if (clear && expected.element != -1) steepest = std::max(steepest, std::abs(other.t - expected.t) / 2e-5);
    }
    if (!clear) {
      ++counts.unclear;
      continue;
    }
    counts.on_drones += expected.element >= 0 ? 1 : 0;
    if (expected.element == -1) {
      ASSERT_TRUE(std::isinf(range)) << range;
    } else {
      ASSERT_NEAR(static_cast<double>(range), expected.t, 5e-6 * steepest) << expected.element;
    }
  }
}

TEST(SeenDrones, LidarsDetectTheHullsOfTheOthers) {
  const auto world = hall();
  Random random(1);
  RayCounts counts;
  for (const DroneModel& model : {DroneModel::quadrotor650(), DroneModel::load("crazyflie")}) {
    Batch batch(flock_of(3, 5), {world}, nullptr, model);
    batch.remove(std::array<std::int64_t, 1>{7});
    for (int i = 0; i < 16; i += kThinning) {
      const Poses poses = random_poses(random, 15, Vec3::Constant(std::min(1.0F, 4.0F * model.radius())));
      batch.set_pose(poses.position, poses.quat_wxyz);
      batch.sense();
      check_ranges(*world, model, batch, poses, counts);
    }
  }
  EXPECT_GT(counts.rays, 100'000U / kThinning);
  EXPECT_GT(counts.on_drones, 10'000U / kThinning);
  EXPECT_LT(counts.unclear, counts.rays / 50);
}

// Scans of many drones of an env share slices of their balls. A single scan searches all drones.
TEST(SeenDrones, LidarsDetectTheSameAmongMany) {
  const auto world = hall();
  Random random(8);
  RayCounts counts;
  const DroneModel model = DroneModel::load("crazyflie");
  for (const int per_env : {60, 700}) {
    const auto drones = static_cast<std::size_t>(per_env);
    for (const Vec3& spread : {Vec3(0.3F, 0.3F, 0.3F), Vec3(0.1F, 3, 0.3F), Vec3(0.05F, 0.05F, 2)}) {
      BatchConfig config = flock_of(2, per_env);
      config.lidars[0].beams = 8;
      config.lidars[0].channels = 2;
      config.lidars[0].max_range_m = 1.5F;
      Batch batch(config, {world}, nullptr, model);
      batch.remove(std::array<std::int64_t, 2>{7, static_cast<std::int64_t>(2 * drones - 1)});
      Poses poses = random_poses(random, 2 * per_env, spread);
      poses.position[3 * 20] = 400.0F;  // one is far from the others
      batch.set_pose(poses.position, poses.quat_wxyz);
      batch.sense();
      const std::vector<float> ranges = batch.lidar().readings().ranges;
      if (per_env == 60) check_ranges(*world, model, batch, poses, counts);
      std::vector<float> one(16);
      for (std::size_t drone = 0; drone < 2 * drones; drone += kThinning) {
        if (!batch.state().active[drone]) continue;
        batch.lidar().scan(DroneIndex(drone), one);
        ASSERT_TRUE(same_bits(one, testing::row(ranges, drone, 16))) << drone;
      }
      std::vector<std::uint8_t> few(2 * drones);
      few[3] = few[drones + 1] = few[drones + 2] = 1;
      batch.sense(few);
      ASSERT_TRUE(same_bits(ranges, batch.lidar().readings().ranges));
    }
  }
  EXPECT_GT(counts.rays, 5'000U);
  EXPECT_GT(counts.on_drones, 500U);
  EXPECT_LT(counts.unclear, counts.rays / 20);
}

TEST(SeenDrones, ADroneDoesNotSeeItselfNorDronesOfOtherEnvs) {
  for (const int per_env : {1, 2}) {
    BatchConfig config = flock_of(4 / per_env, per_env), never = flock_of(4 / per_env, per_env, Interaction::none);
    config.cameras = never.cameras = {camera_of()};
    Batch seen(config, {hall()}), unseen(never, {hall()});
    const std::vector<std::int64_t> second{1, 3};
    Random random(2);
    const Poses poses = random_poses(random, 4, {0.3F, 0.3F, 0.3F});
    for (Batch* const batch : {&seen, &unseen}) {
      if (per_env == 2) batch->remove(second);
      batch->set_pose(poses.position, poses.quat_wxyz);
      batch->sense();
    }
    EXPECT_TRUE(same_bits(seen.lidar().readings().ranges, unseen.lidar().readings().ranges)) << per_env;
    EXPECT_TRUE(same_arrays(seen.camera(0).images(), unseen.camera(0).images())) << per_env;
  }
}

NavigationBatch flying_flock(int num_envs, Interaction interaction = Interaction::sense) {
  NavigationBatch config = navigation_batch(num_envs);
  config.drones_per_env = 6;
  config.interaction = interaction;
  config.navigation.random_start = true;
  config.episode.max_episode_steps = 25;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  return config;
}

TEST(SeenDrones, ResultsDoNotDependOnThreadsBlocksOrOtherEnvs) {
  const auto world = closet();
  NavigationBatch few_config = flying_flock(4), small_blocks = flying_flock(40);
  small_blocks.block_size = 3;
  const auto actions = discrete_actions(60, 240);
  Batch few = few_config.make({world}), many = flying_flock(40).make({world}), others = small_blocks.make({world});
  Batch unseen = flying_flock(40, Interaction::none).make({world});
  for (Batch* const batch : {&few, &many, &others, &unseen}) batch->reset({});
  std::size_t nearer = 0;
  for (std::size_t step = 0; step < 60; ++step) {
    few.step(std::span(actions[step]).first(24));
    for (Batch* const batch : {&many, &others, &unseen}) batch->step(actions[step]);
    ASSERT_TRUE(same_bits(many.lidar().readings().ranges, others.lidar().readings().ranges)) << step;
    const auto first = std::span(many.lidar().readings().ranges).first(few.lidar().readings().ranges.size());
    ASSERT_TRUE(same_bits(few.lidar().readings().ranges, first)) << step;
    ASSERT_TRUE(same_bits(many.state().position, unseen.state().position));  // what they see does not move them
    for (std::size_t ray = 0; ray < many.lidar().readings().ranges.size(); ++ray) {
      ASSERT_LE(many.lidar().readings().ranges[ray], unseen.lidar().readings().ranges[ray]);
      nearer += many.lidar().readings().ranges[ray] < unseen.lidar().readings().ranges[ray] ? 1 : 0;
    }
  }
  EXPECT_GT(nearer, 10'000U);
}

TEST(SeenDrones, AStepAllocatesNothing) {
  Batch batch = flying_flock(64).make({closet()});
  batch.reset({});
  const auto actions = discrete_actions(60, 384);
  for (std::size_t step = 0; step < 30; ++step) batch.step(actions[step]);
  const std::uint64_t before = allocations();
  for (std::size_t step = 30; step < 60; ++step) batch.step(actions[step]);
  EXPECT_EQ(allocations() - before, 0U);
}

TEST(SeenDrones, TheirOrderDoesNotMatter) {
  Random random(3);
  const Poses poses = random_poses(random, 6, {1, 1, 1});
  const std::array<std::size_t, 6> order{4, 2, 0, 5, 1, 3};
  const Poses permuted = rows_of(poses, order);
  Batch a(flock_of(1, 6), {hall()}), b(flock_of(1, 6), {hall()});
  a.set_pose(poses.position, poses.quat_wxyz);
  a.sense();
  b.set_pose(permuted.position, permuted.quat_wxyz);
  b.sense();
  const std::vector<float>&x = a.lidar().readings().ranges, &y = b.lidar().readings().ranges;
  for (std::size_t i = 0; i < 6; ++i) EXPECT_TRUE(same_bits(row(x, order[i], 300), row(y, i, 300)));
}

TEST(SeenDrones, ASnapshotBringsTheSameBitsBack) {
  BatchConfig config = flock_of(2, 4);
  config.cameras = {camera_of(CaptureMode::on_movement)};
  Random random(4);
  const Poses first = random_poses(random, 8, {1, 1, 1}), second = random_poses(random, 8, {1, 1, 1});
  Batch batch(config, {hall()});
  batch.set_pose(first.position, first.quat_wxyz);
  batch.sense();
  batch.remove(std::array<std::int64_t, 1>{2});
  batch.set_pose(second.position, second.quat_wxyz, std::vector<std::uint8_t>{0, 1, 0, 0, 0, 0, 0, 0});  // frames are old now
  const std::string blob = batch.snapshot();
  const CameraImages images = batch.camera(0).images();
  const std::vector<float> ranges = batch.lidar().readings().ranges;
  batch.sense();
  const CameraImages next = batch.camera(0).images();
  const std::vector<float> next_ranges = batch.lidar().readings().ranges;
  Batch other(config, {hall()});
  other.restore(blob);
  EXPECT_TRUE(same_arrays(other.camera(0).images(), images));
  EXPECT_TRUE(same_bits(other.lidar().readings().ranges, ranges));
  other.sense();
  EXPECT_TRUE(same_arrays(other.camera(0).images(), next));
  EXPECT_FALSE(same_bits(images.depth, next.depth));
  EXPECT_TRUE(same_bits(other.lidar().readings().ranges, next_ranges));
}

TEST(SeenDrones, DronesThatComeAreSeen) {
  BatchConfig config = flock_of(1, 0);
  config.cameras = {camera_of()};
  Batch batch(config, {hall()});
  const std::vector<float> at{0, 0, 0, 1, 0, 0, 2, 0, 0};
  batch.spawn({}, std::span(at).first(3), {}, {}, {});
  const auto ahead = [&] { return batch.lidar().readings().ranges[2 * 60 + 30]; };  // of the first drone
  EXPECT_FLOAT_EQ(ahead(), 5.0F);
  batch.spawn({}, std::span(at).subspan(3), {}, {}, {});
  batch.sense();
  EXPECT_FLOAT_EQ(ahead(), 1.0F - 0.465F);
  const std::size_t middle = 24 * 64 + 32;
  EXPECT_EQ(batch.camera(0).images().instance[middle], kFirstDroneInstance + 1);
  EXPECT_EQ(batch.camera(0).images().semantic[middle], kSemanticDrone);
  EXPECT_FLOAT_EQ(batch.camera(0).images().depth[middle], 1.0F - 0.465F);
  batch.remove(std::array<std::int64_t, 1>{1});
  batch.sense();
  EXPECT_FLOAT_EQ(ahead(), 2.0F - 0.465F);
  EXPECT_EQ(batch.camera(0).images().instance[middle], kFirstDroneInstance + 2);
  std::vector<float> one(300);
  batch.lidar().scan(DroneIndex(0), one);
  EXPECT_FLOAT_EQ(one[2 * 60 + 30], 2.0F - 0.465F);
}

TEST(SeenDrones, AFrameIsStaleWhenADroneHasMovedThatItMayShow) {
  BatchConfig config = flock_of(2, 3);
  config.cameras = {camera_of(CaptureMode::on_movement)};
  Batch batch(config, {hall()});
  std::vector<float> at{0, 0, 0, 2, 0, 0, 2, 2, 0, 0, 0, 0, 2, 0, 0, 2, 2, 0};
  batch.set_pose(at, {});
  batch.sense();
  const auto is_drawn_again = [&](std::size_t drone) {
    const std::size_t first = drone * 64 * 48;
    std::vector<float>& depth = const_cast<std::vector<float>&>(batch.camera(0).images().depth);
    std::fill_n(depth.begin() + static_cast<std::ptrdiff_t>(first), 64 * 48, -1.0F);
    return [&depth, first] { return depth[first] != -1.0F; };
  };
  const auto check = [&](std::array<bool, 6> expected) {
    std::vector<std::function<bool()>> drawn;
    for (std::size_t drone = 0; drone < 6; ++drone) drawn.emplace_back(is_drawn_again(drone));
    batch.sense();
    for (std::size_t drone = 0; drone < 6; ++drone) EXPECT_EQ(drawn[drone](), expected[drone]) << drone;
  };
  check({false, false, false, false, false, false});
  at[4] = 0.1F;  // of drone 1
  batch.set_pose(at, {});
  check({true, true, true, false, false, false});
  check({false, false, false, false, false, false});
  batch.remove(std::array<std::int64_t, 1>{4});
  check({false, false, false, true, false, true});
}

// Each drone sees what a drone by itself sees among bodies with the same mesh.
class SeenDronesBy : public ::testing::TestWithParam<std::tuple<CameraBackend, bool>> {};

TEST_P(SeenDronesBy, CamerasShowThemAsBodiesWithTheirMesh) {
  const auto [backend, has_mesh] = GetParam();
  BatchConfig config = filmed(5, backend, Interaction::both);
  config.cameras[0].shadows = backend == CameraBackend::raycast;
  if (has_mesh) config.drone_mesh = arrow();
  const DroneModel tetrahedron({{0.5F, 0, 0}, {-0.3F, 0.3F, 0}, {-0.3F, -0.3F, 0}, {-0.2F, 0, 0.25F}});
  WorldBuilder grey("grey");
  MeshPart part{.vertices = {tetrahedron.hull().begin(), tetrahedron.hull().end()}};
  for (const HullFace& face : hull_faces(tetrahedron.hull(), 64)) {
    const auto corner = [&](std::size_t i) { return static_cast<std::int32_t>(face.corners[i]); };
    part.triangles.push_back({corner(0), corner(1), corner(2)});
  }
  grey.mesh(part, grey.material({.name = "grey", .base_color = {0.4F, 0.4F, 0.4F}}));
  const auto world = hall();
  Batch batch(config, {world}, nullptr, tetrahedron);
  if (lacks_opengl(batch)) GTEST_SKIP() << batch.camera_backend_report();
  BatchConfig one = config;
  one.drones_per_env = 1;
  one.num_envs = 5;
  one.interaction = Interaction::none;
  one.drone_mesh = nullptr;
  one.max_bodies = 4;
  BodyConfig body{.shape = BodyShape::mesh, .mesh = has_mesh ? arrow() : grey.build(), .semantic = kSemanticDrone};
  Batch bodies(one, {world}, nullptr, tetrahedron);
  Random random(6);
  const Poses poses = random_poses(random, 5, {1, 1, 1});
  batch.set_pose(poses.position, poses.quat_wxyz);
  bodies.set_pose(poses.position, poses.quat_wxyz);
  for (std::size_t env = 0; env < 5; ++env) {
    std::vector<std::uint8_t> only(5, 0);
    only[env] = 1;
    for (std::size_t other = 0; other < 5; ++other) {
      if (other == env) continue;
      const Poses pose = rows_of(poses, std::array{other, other, other, other, other});  // for the envs
      bodies.bodies().spawn(body, pose.position, pose.quat_wxyz, {}, {}, only);
    }
  }
  batch.sense();
  bodies.sense();
  const CameraImages &got = batch.camera(0).images(), &expected = bodies.camera(0).images();
  std::size_t of_drones = 0, different = 0, ids = 0;
  const std::size_t pixels = got.depth.size();
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    const std::size_t drone = pixel / (64 * 48);
    ids += got.semantic[pixel] != expected.semantic[pixel] ? 1 : 0;
    const bool is_same = got.rgb[3 * pixel] == expected.rgb[3 * pixel] && got.depth[pixel] == expected.depth[pixel] &&
                         got.normal[3 * pixel] == expected.normal[3 * pixel];
    different += is_same ? 0 : 1;
    if (got.semantic[pixel] != kSemanticDrone) {
      EXPECT_EQ(got.instance[pixel], expected.instance[pixel]);
      continue;
    }
    ++of_drones;
    ASSERT_GE(got.instance[pixel], kFirstDroneInstance);
    const std::size_t number = static_cast<std::size_t>(got.instance[pixel] - kFirstDroneInstance);
    ASSERT_LT(number, 5U);
    ASSERT_NE(number, drone);
    EXPECT_EQ(expected.instance[pixel], kFirstBodyInstance + number - (number > drone ? 1 : 0));
  }
  EXPECT_GT(of_drones, pixels / 50);
  EXPECT_EQ(ids, 0U);
  EXPECT_EQ(different, 0U);
}

INSTANTIATE_TEST_SUITE_P(Backends, SeenDronesBy,
                         ::testing::Combine(::testing::Values(CameraBackend::raycast, CameraBackend::gl), ::testing::Bool()));

// The own drone casts no shadow for its cameras; another one does.
TEST(SeenDrones, CastShadowsForTheOthers) {
  BatchConfig config = filmed(2, CameraBackend::raycast);
  config.cameras[0].quat_wxyz = {0.70710678F, 0, 0.70710678F, 0};  // down
  SceneDescription scene;
  scene.materials = {{"chalk", {0.7F, 0.7F, 0.6F}, 0}};
  scene.primitives = {primitive(PrimitiveKind::plane, {0, 0, 0}, {9, 9, 0})};
  scene.light.sun_direction = {0, 0, 1};
  const auto world = std::make_shared<const World>(scene);
  Batch batch(config, {world});
  const auto middle_of_first = [&](float above) {
    batch.set_pose(std::vector<float>{0, 0, 2, above, 0, 4}, {});
    batch.sense();
    return int{batch.camera(0).images().grey[24 * 64 + 32]};
  };
  const int lit = middle_of_first(5.0F), shaded = middle_of_first(0.0F);
  EXPECT_LT(shaded, lit - 20);
  config.interaction = Interaction::none;
  Batch unseen(config, {world});
  unseen.set_pose(std::vector<float>{0, 0, 2, 5, 0, 4}, {});
  unseen.sense();
  EXPECT_EQ(lit, int{unseen.camera(0).images().grey[24 * 64 + 32]});
}

TEST(SeenDrones, BadConfigurationsAreRefused) {
  BatchConfig config = flock_of(1, 2, Interaction::collide);
  config.drone_mesh = arrow();
  EXPECT_REFUSED(config.validate(), R"(drone_mesh: ... "sense" ... "both")");
  config.interaction = Interaction::both;
  config.validate();
  config.drone_mesh = hall();
  EXPECT_REFUSED(config.validate(), "drone_mesh: ... triangles");
  config = flock_of(1, 4097);
  EXPECT_REFUSED(config.validate(), "drones_per_env: ... 4096");
  config.interaction = Interaction::none;
  config.validate();
}

}  // namespace
}  // namespace flockstep
