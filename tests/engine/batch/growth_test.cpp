// A batch that grows has the bits of a batch that had its final size from the start.
#include "batch/growth.hpp"

#include <set>
#include <type_traits>

#include "batch_helpers.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Indices = std::vector<std::int64_t>;

// Sensors of every kind, with errors. Fields: camera resolution and number of beams.
BatchConfig instruments(Motion motion, int num_threads, int beams = 9, int width = 6) {
  BatchConfig config;
  config.num_threads = num_threads;
  config.block_size = 2;
  config.tracer = TracerKind::embree;
  config.lidars = {{.channels = 2, .beams = beams, .vfov_deg = 30.0F}, {.name = "slow", .beams = 3, .rate_hz = 5.0F}};
  config.cameras = {{.width_px = width, .height_px = 4, .outputs = {.rgb = true, .depth = true, .hsv = true}},
                    {.name = "small",
                     .width_px = 8,
                     .height_px = 8,
                     .outputs = {.grey = true},
                     .capture_mode = CaptureMode::on_movement,
                     .resize = {{4, 4}}}};
  config.pose_sensor = {.position_noise_std_m = 0.1F, .position_random_walk = 0.1F, .yaw_random_walk = 5.0F};
  config.imus = {{.accelerometer_noise_density = 0.02F, .gyroscope_random_walk = 0.01F, .scale_std = 0.01F}};
  config.gps_receivers = {{.drift_std_m = 1.0F, .outages_per_s = 2.0F, .outage_s = 0.3F}};
  config.clock.policy_hz = 10.0F;
  config.dynamics.motion = motion;
  if (motion == Motion::kinematic) return config;
  config.dynamics.control = Control::velocity;
  config.dynamics.wind.gusts = Gusts::dryden;
  config.imus[0].accelerometer_vibration_mps2 = 0.1F;
  return config;
}

// A closet with triangles, whose rays Embree counts.
std::shared_ptr<const World> furnished() {
  TriangleMesh mesh;
  mesh.vertices = {{0.2F, 0.2F, 0.3F}, {1.8F, 0.2F, 0.3F}, {0.2F, 1.8F, 0.2F}};
  mesh.triangles = {{0, 1, 2}};
  return make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {1.25F, 1.25F, 0.75F})}, {.start = Vec3(1, 1, 0.75F)},
                    std::move(mesh));
}

std::unique_ptr<Batch> batch_of(BatchConfig config, int num_envs, int drones_per_env) {
  config.num_envs = num_envs;
  config.drones_per_env = drones_per_env;
  return std::make_unique<Batch>(config, Batch::Worlds{closet(), furnished()}, nullptr, DroneModel::load("crazyflie"));
}

// Random calls. They depend on the env and the number of a drone in it, and not on the size of the batch.
class Calls {
 public:
  explicit Calls(Batch& batch) : batch_(batch) {}

  void spawn(std::int64_t env, std::int64_t member, bool by_env) {
    const std::vector<float> at = point(env, member);
    const std::int64_t index = env * batch_.config().drones_per_env + member;
    const Indices spawned = by_env ? batch_.spawn({}, at, {}, {}, Indices{env}) : batch_.spawn(Indices{index}, at, {}, {});
    EXPECT_EQ(spawned, (Indices{env * batch_.config().drones_per_env + member}));
    ++call_;
  }
  void remove(std::int64_t env, std::int64_t member) {
    batch_.remove(Indices{env * batch_.config().drones_per_env + member});
    ++call_;
  }
  void fly() {
    const auto m = static_cast<std::size_t>(batch_.config().drones_per_env);
    const auto n = static_cast<std::size_t>(batch_.config().num_drones());
    const bool is_kinematic = batch_.config().dynamics.is_kinematic();
    std::vector<float> rows;
    for (std::size_t i = 0; i < n; ++i) {
      const std::vector<float> at = point(static_cast<std::int64_t>(i / m), static_cast<std::int64_t>(i % m));
      rows.insert(rows.end(), at.begin(), at.end());
      if (!is_kinematic) rows.push_back(0.3F);
    }
    if (is_kinematic) {
      batch_.move(rows, {});
    } else {
      batch_.fly(rows, 7);
    }
    ++call_;
    batch_.sense();
  }
  // Runs calls by name. Spawns and removals are followed by env/member; `add` spawns into the env, at any free slot.
  void play(const std::string& script) {
    std::istringstream words(script);
    for (std::string word; words >> word;) {
      std::int64_t env = 0, member = 0;
      char slash = 0;
      if (word == "spawn" || word == "add" || word == "remove") words >> env >> slash >> member;
      if (word == "spawn" || word == "add") spawn(env, member, word == "add");
      if (word == "remove") remove(env, member);
      if (word == "fly") fly();
      if (word == "begin") batch_.begin_episode();
      if (word == "seed") batch_.seed(seeds_from(100, static_cast<std::size_t>(batch_.config().num_envs)));
      if (word == "widen") widen();
    }
  }
  void widen() {
    batch_.lidar().set({.max_range_m = 2.0F, .hfov_deg = 90.0F, .offset_m = {{0.1F, 0.0F, 0.0F}}});
    batch_.camera(0).set({.hfov_deg = 60.0F});
    batch_.camera(1).set_capture_mode(CaptureMode::every_step);
    batch_.sense();
  }

 private:
  std::vector<float> point(std::int64_t env, std::int64_t member) const {
    Random random(static_cast<unsigned>((call_ * 64 + env) * 64 + member));
    return {random.within(0.6F, 1.6F), random.within(0.6F, 1.6F), random.within(0.4F, 1.1F)};
  }

  Batch& batch_;
  std::int64_t call_ = 0;
};

void expect_same(Batch& grown, Batch& whole) {
  ASSERT_EQ(grown.config().num_envs, whole.config().num_envs);
  ASSERT_EQ(grown.config().drones_per_env, whole.config().drones_per_env);
  EXPECT_TRUE(grown.snapshot() == whole.snapshot());
  for (std::size_t lidar = 0; lidar < grown.config().lidars.size(); ++lidar) {
    EXPECT_TRUE(same_bits(grown.lidar(lidar).readings().ranges, whole.lidar(lidar).readings().ranges));
    EXPECT_TRUE(same_bits(grown.lidar(lidar).readings().max_range_m, whole.lidar(lidar).readings().max_range_m));
  }
  for (std::size_t camera = 0; camera < grown.config().cameras.size(); ++camera) {
    EXPECT_TRUE(same_arrays(grown.camera(camera).images(), whole.camera(camera).images()));
  }
  EXPECT_TRUE(same_bits(grown.state().active, whole.state().active));
}

// Plays a script on a batch that begins empty, and on one of the final size whose slots are removed first.
void compare(const BatchConfig& config, int num_envs, int drones_per_env, const std::string& script) {
  SCOPED_TRACE(script);
  const auto grown = batch_of(config, num_envs, drones_per_env);
  Calls calls(*grown);
  calls.play(script);
  EXPECT_GT(ServedBatch::generation(*grown), 0);
  EXPECT_EQ(grown->embree().rays > 0, grown->config().num_envs > 1);
  const auto whole = batch_of(config, grown->config().num_envs, grown->config().drones_per_env);
  Indices all(static_cast<std::size_t>(whole->config().num_drones()));
  std::iota(all.begin(), all.end(), 0);
  whole->remove(all);
  Calls same(*whole);
  same.play(script);
  EXPECT_EQ(ServedBatch::generation(*whole), 0);
  expect_same(*grown, *whole);
  EXPECT_EQ(grown->embree().rays, whole->embree().rays);
  EXPECT_EQ(grown->embree().packets, whole->embree().packets);
}

class Growth : public ::testing::TestWithParam<std::pair<Motion, int>> {
 protected:
  BatchConfig config() const { return instruments(GetParam().first, GetParam().second); }
};

TEST_P(Growth, HasTheBitsOfABatchMadeAtOnce) {
  compare(config(), 0, 1,
          "spawn 0/0 fly spawn 4/0 fly widen seed spawn 2/0 fly remove 0/0 spawn 5/0 begin fly spawn 0/0 fly spawn 7/0 fly");
  compare(config(), 1, 0,  // one env
          "spawn 0/0 fly add 0/1 widen fly seed spawn 0/3 fly remove 0/1 begin fly add 0/1 add 0/2 add 0/4 fly");
  compare(config(), 3, 0,  // all envs
          "add 1/0 fly add 2/0 add 1/1 widen fly seed add 1/2 fly remove 1/1 fly add 1/1 begin add 1/3 add 1/4 add 0/0 fly");
}

TEST_P(Growth, WithOtherResolutionsHasTheBitsOfABatchThatWasMadeWithThem) {
  BatchConfig small = config();
  const auto changed = batch_of(small, 3, 1);
  Calls calls(*changed);
  calls.widen();
  calls.fly();
  changed->lidar().set({.beams = 17, .channels = 3});
  changed->camera(0).set({.width_px = 10, .height_px = 5});
  EXPECT_EQ(ServedBatch::generation(*changed), 2);
  EXPECT_THROW(changed->lidar(0).require_scan(), std::logic_error);
  changed->lidar(1).require_scan();
  EXPECT_EQ(changed->lidar(0).readings().ranges.size(), 3U * 3U * 17U);
  EXPECT_TRUE(std::ranges::all_of(changed->lidar(0).readings().ranges, [](float range) { return std::isinf(range); }));
  EXPECT_TRUE(std::ranges::all_of(changed->camera(0).images().frame_step, [](std::int64_t step) { return step == -1; }));
  EXPECT_TRUE(std::ranges::all_of(changed->camera(1).images().frame_step, [](std::int64_t step) { return step >= 0; }));
  EXPECT_EQ(changed->lidar().config(DroneIndex(2)).hfov_deg, 90.0F);
  EXPECT_EQ(changed->lidar().config(DroneIndex(2)).beams, 17);
  EXPECT_EQ(changed->camera(0).config(DroneIndex(1)).hfov_deg, 60.0F);
  EXPECT_EQ(changed->camera(1).config().capture_mode, CaptureMode::every_step);
  calls.fly();
  small.lidars[0].beams = 17;
  small.lidars[0].channels = 3;
  small.cameras[0].width_px = 10;
  small.cameras[0].height_px = 5;
  const auto made = batch_of(small, 3, 1);
  Calls same(*made);
  same.widen();
  same.fly();
  same.fly();
  expect_same(*changed, *made);
}

INSTANTIATE_TEST_SUITE_P(Motions, Growth,
                         ::testing::Values(std::pair(Motion::kinematic, 1), std::pair(Motion::kinematic, 3),
                                           std::pair(Motion::rotors, 1), std::pair(Motion::rotors, 3)));

TEST(GrowthOfBatches, WithoutDronesEverythingWorks) {
  for (const auto& [num_envs, drones_per_env] : {std::pair(0, 1), std::pair(1, 0), std::pair(5, 0)}) {
    for (const Motion motion : {Motion::kinematic, Motion::rotors}) {
      const auto batch = batch_of(instruments(motion, 2), num_envs, drones_per_env);
      EXPECT_EQ(batch->config().num_drones(), 0);
      batch->sense();
      batch->set_pose({}, {});
      batch->camera(0).capture();
      if (motion == Motion::kinematic) batch->move({}, {});
      if (motion == Motion::rotors) batch->fly({}, 3);
      batch->begin_episode();
      batch->lidar().set({.hfov_deg = 80.0F});
      batch->camera(0).set({.hfov_deg = 80.0F});
      std::vector<float> numbers(2 * static_cast<std::size_t>(num_envs));
      batch->random(0, 2, numbers);
      batch->restore(batch->snapshot());
      EXPECT_EQ(batch->spawn({}, {}, {}, {}), Indices());
      EXPECT_REFUSED(batch->remove(Indices{0}), "indices (row 0): ... [0, 0) ... 0");
      batch->lidar().set({.beams = 5});
      batch->camera(1).set({.width_px = 9});
      EXPECT_EQ(ServedBatch::generation(*batch), 2);
      EXPECT_EQ(batch->spawn({}, std::vector<float>{1, 1, 0.75F}, {}, {}), Indices{0});
      EXPECT_EQ(batch->lidar().readings().ranges.size(), 10U * static_cast<std::size_t>(batch->config().num_drones()));
    }
  }
}

TEST(GrowthOfBatches, ChoosesSlots) {
  const BatchConfig plain;
  const std::vector<float> one{1, 1, 0.75F}, two{1, 1, 0.75F, 0.9F, 1, 0.75F};
  const auto size = [](const Batch& batch) { return std::pair(batch.config().num_envs, batch.config().drones_per_env); };

  const auto own = batch_of(plain, 1, 1);  // each drone has an env
  EXPECT_EQ(own->spawn(Indices{3}, one, {}, {}), Indices{3});
  EXPECT_EQ(size(*own), std::pair(4, 1));
  EXPECT_EQ(own->spawn({}, two, {}, {}), (Indices{1, 2}));
  EXPECT_EQ(ServedBatch::generation(*own), 1);
  EXPECT_EQ(own->spawn({}, two, {}, {}), (Indices{4, 5}));
  EXPECT_EQ(size(*own), std::pair(6, 1));
  EXPECT_EQ(own->spawn({}, one, {}, {}, Indices{2}), Indices{5});  // a second drone in env 2
  EXPECT_EQ(size(*own), std::pair(6, 2));
  EXPECT_EQ(own->state().active, (FlagArray{1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0}));

  const auto shared = batch_of(plain, 1, 0);  // drones share an env
  EXPECT_EQ(shared->spawn(Indices{0}, one, {}, {}), Indices{0});
  EXPECT_EQ(size(*shared), std::pair(1, 2));
  EXPECT_EQ(shared->spawn({}, one, {}, {}, Indices{0}), Indices{1});
  EXPECT_EQ(ServedBatch::generation(*shared), 1);
  EXPECT_EQ(shared->spawn(Indices{2}, one, {}, {}), Indices{2});
  EXPECT_EQ(size(*shared), std::pair(1, 4));
  EXPECT_EQ(shared->spawn(Indices{10, 9}, two, {}, {}), (Indices{10, 9}));
  EXPECT_EQ(size(*shared), std::pair(1, 11));
  EXPECT_EQ(shared->spawn({}, two, {}, {}), (Indices{3, 4}));

  const auto grid = batch_of(plain, 2, 2);
  EXPECT_REFUSED(grid->spawn(Indices{4}, one, {}, {}), "indices (row 0): ... [0, 4) ... 4");
  grid->remove(Indices{1});
  EXPECT_EQ(grid->spawn({}, two, {}, {}, Indices{0, 0}), (Indices{1, 2}));
  EXPECT_EQ(size(*grid), std::pair(2, 4));
  EXPECT_EQ(grid->state().active, (FlagArray{1, 1, 1, 0, 1, 1, 0, 0}));
  EXPECT_EQ(grid->spawn({}, std::vector<float>(12, 1.0F), {}, {}), (Indices{3, 4, 5, 6}));
  EXPECT_EQ(size(*grid), std::pair(2, 8));
}

TEST(GrowthOfBatches, KeepsTheOldArraysForThoseWhoHoldTheirMemory) {
  const auto batch = batch_of(instruments(Motion::kinematic, 1), 1, 1);
  batch->sense();
  std::shared_ptr<const void> memory = ServedBatch::memory(*batch);
  const std::weak_ptr<const void> watched = memory;
  const std::vector<float>& position = batch->state().position;
  const std::vector<float>& ranges = batch->lidar().readings().ranges;
  const std::vector<float> before = position, ranges_before = ranges;
  batch->spawn(Indices{1}, position, {}, {});  // a span of the memory that moves
  EXPECT_TRUE(same_bits(std::span(batch->state().position).subspan(3), before));
  batch->move(std::vector<float>(6, 0.8F), {});
  batch->sense();
  EXPECT_EQ(position, before);
  EXPECT_EQ(ranges, ranges_before);
  EXPECT_NE(ServedBatch::memory(*batch), memory);
  memory.reset();
  EXPECT_TRUE(watched.expired());
}

TEST(GrowthOfBatches, KeepsMoveLinesAndBeams) {
  Batch batch({.num_envs = 2, .drones_per_env = 2}, {closet()});
  const std::vector<std::uint8_t> mask{0, 0, 0, 1};
  batch.move_lines().set_visible(true, mask);
  batch.move_lines().set_beams_visible(true, mask);
  std::vector<float> position = batch.state().position;
  position[3 * 3] += 0.25F;
  batch.move(position, {}, mask);
  const std::vector<Vec3> line = batch.move_lines().path(DroneIndex(3));
  ASSERT_EQ(line.size(), 2U);

  const std::vector<std::int64_t> envs{0};
  batch.spawn({}, {}, {}, {}, envs);  // drone 1 of env 1 is now drone 5
  EXPECT_EQ(batch.move_lines().path(DroneIndex(5)), line);
  EXPECT_EQ(batch.move_lines().state().move_line_visible, (FlagArray{0, 0, 0, 0, 0, 1, 0, 0}));
  EXPECT_EQ(batch.move_lines().state().beams_visible, (FlagArray{0, 0, 0, 0, 0, 1, 0, 0}));
  position = batch.state().position;
  position[3 * 5] += 0.25F;
  batch.move(position, {}, std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1, 0, 0});
  EXPECT_EQ(batch.move_lines().path(DroneIndex(5)).size(), 3U);
}

TEST(GrowthOfBatches, MovesItsArraysOnlyInsideTheGivenFunction) {
  const auto batch = batch_of({}, 1, 1);
  int moves = 0;
  ServedBatch::run_moves_with(*batch, [&](const std::function<void()>& move) {
    const void* const before = ServedBatch::memory(*batch).get();
    EXPECT_EQ(batch->config().num_envs, 1);
    move();
    EXPECT_NE(ServedBatch::memory(*batch).get(), before);
    EXPECT_EQ(batch->config().num_envs, 2);
    ++moves;
  });
  batch->spawn(Indices{1}, {}, {}, {});
  EXPECT_EQ(moves, 1);
}

TEST(GrowthOfBatches, RefusesBadCallsBeforeAnythingChanges) {
  const auto batch = batch_of(instruments(Motion::rotors, 2), 2, 1);
  batch->sense();
  const std::string before = batch->snapshot();
  const void* const memory = ServedBatch::memory(*batch).get();
  const std::vector<float> at{1, 1, 0.75F};
  EXPECT_REFUSED(batch->spawn(Indices{std::int64_t{1} << 40}, at, {}, {}), "indices (row 0): ... [0, 1048576) ... 1099511627776");
  EXPECT_REFUSED(batch->spawn(Indices{1048576}, at, {}, {}), "indices (row 0): ... [0, 1048576) ... 1048576");
  EXPECT_REFUSED(batch->spawn(Indices{-1}, at, {}, {}), "indices (row 0): ... [0, 1048576) ... -1");
  EXPECT_REFUSED(batch->spawn(Indices{5}, std::vector<float>{1, kNan, 1}, {}, {}), "position (row 0)");
  EXPECT_REFUSED(batch->spawn(Indices{5}, std::vector<float>{1, 1}, {}, {}), "position: ... 3 ... 2");
  EXPECT_REFUSED(batch->spawn(Indices{5}, at, std::vector<float>{0, 0, 0, 0}, {}), "quat_wxyz (row 0)");
  EXPECT_REFUSED(batch->spawn(Indices{5}, at, {}, std::vector<std::int32_t>{2}), "world_index (row 0)");
  EXPECT_REFUSED(batch->spawn(Indices{5, 5}, std::vector<float>(6, 1.0F), {}, std::vector<std::int32_t>{0, 1}),
                 "world_index (row 1): ... 0 ... 1");
  EXPECT_REFUSED(batch->spawn(Indices{5}, at, {}, {}, Indices{0}), "env: ... 1 of them");
  EXPECT_REFUSED(batch->spawn({}, at, {}, {}, Indices{2}), "env (row 0): ... [0, 2) ... 2");
  EXPECT_REFUSED(batch->spawn({}, at, {}, {}, Indices{-1}), "env (row 0): ... [0, 2) ... -1");
  EXPECT_REFUSED(batch->lidar().set({.beams = 0}), "lidar.beams: ... [1, 262144] ... 0");
  EXPECT_REFUSED(batch->lidar().set({.beams = 1 << 18}), "lidar.channels x lidar.beams");
  EXPECT_REFUSED(batch->lidar().set({.hfov_deg = -1.0F, .channels = 4}), "lidar.hfov_deg");
  EXPECT_REFUSED(batch->lidar(2).set({.channels = 4}), "lidar: ... 2 ... 2");
  EXPECT_REFUSED(batch->lidar().set({.beams = 4}, std::vector<std::uint8_t>{1, 0}), "mask: ... none for drone 1");
  EXPECT_REFUSED(batch->camera(0).set({.width_px = 0}), "camera.width_px");
  EXPECT_REFUSED(batch->camera(1).set({.height_px = 3}), "camera.resize");
  EXPECT_REFUSED(batch->camera(0).set({.hfov_deg = 179.5F, .height_px = 8}), "camera.hfov_deg");
  EXPECT_REFUSED(batch->camera(0).set({.height_px = 8}, std::vector<std::uint8_t>{0, 1}), "mask: ... none for drone 0");
  EXPECT_EQ(ServedBatch::memory(*batch).get(), memory);
  EXPECT_EQ(ServedBatch::generation(*batch), 0);
  EXPECT_TRUE(batch->snapshot() == before);
}

TEST(GrowthOfBatches, RefusesAResolutionThatTheFieldOfViewOfADroneDoesNotAllow) {
  BatchConfig config;
  config.cameras = {{.width_px = 8, .height_px = 8}};
  const auto batch = batch_of(config, 2, 1);
  batch->camera(0).set({.hfov_deg = 178.0F}, std::vector<std::uint8_t>{0, 1});
  EXPECT_NE(refusal([&] { batch->camera(0).set({.height_px = 64}); }), "accepted");
  EXPECT_EQ(ServedBatch::generation(*batch), 0);
  batch->camera(0).set({.hfov_deg = 90.0F});
  batch->camera(0).set({.height_px = 64});
  EXPECT_EQ(ServedBatch::generation(*batch), 1);
  EXPECT_EQ(batch->camera(0).config().height_px, 64);
}

TEST(GrowthOfBatches, RefusesSnapshotsOfOtherSizes) {
  const auto batch = batch_of(instruments(Motion::rotors, 1), 2, 1);
  const std::string before = batch->snapshot();
  batch->spawn(Indices{2}, {}, {}, {});
  EXPECT_REFUSED(batch->restore(before), "snapshot: ... (3 drones in 3 envs) ... 2 ... 2");
  batch->restore(batch->snapshot());
  const auto shared = batch_of(instruments(Motion::rotors, 1), 1, 3);
  EXPECT_REFUSED(shared->restore(batch->snapshot()), "snapshot: ... (3 drones in 1 env) ... 3 ... 3");
}

TEST(GrowthOfBatches, RefusesToGrowWithATask) {
  BatchConfig config = lidar_batch(2);
  const Batch::Worlds worlds{playground("train-1")};
  Batch batch(config, worlds, make_task(NavigationConfig{}));
  EXPECT_REFUSED(batch.spawn(Indices{2}, {}, {}, {}), "indices (row 0): ... [0, 2) ... 2");
  EXPECT_REFUSED(batch.spawn({}, {}, {}, {}, Indices{0}), "env (row 0): ... 0");
  EXPECT_REFUSED(batch.spawn({}, std::vector<float>{1, 1, 1}, {}, {}), "position: ... 1");
  EXPECT_REFUSED(batch.lidar().set({.beams = 4}), "beams: ... 4");
  for (const auto& [num_envs, drones_per_env] : {std::pair(0, 1), std::pair(1, 0)}) {
    config.num_envs = num_envs;
    config.drones_per_env = drones_per_env;
    EXPECT_REFUSED(Batch(config, worlds, make_task(NavigationConfig{})), "num_drones = num_envs x drones_per_env: ... 0");
  }
  config.num_envs = 0;
  config.drones_per_env = 2;
  EXPECT_REFUSED(config.validate(), "num_envs: ... >= ... 0");
}

TEST(GrowthOfBatches, OfABeamPatternIsRefused) {
  BatchConfig config = lidar_batch(1, {.azimuth_deg = {0, 90}, .elevation_deg = {0, 0}});
  const auto batch = batch_of(config, 1, 1);
  EXPECT_REFUSED(batch->lidar().set({.beams = 4}), "beams: ... 4");
  EXPECT_REFUSED(batch->lidar().set({.channels = 4}), "channels: ... 4");
}

TEST(GrowthOfBatches, WorksInABatchLockAndInTheAnnouncementOfACall) {
  const auto batch = batch_of(lidar_batch(1), 0, 1);
  bool spawns = true;
  ServedBatch served(*batch, [&] {
    if (std::exchange(spawns, false)) batch->spawn(Indices{0, 1}, {}, {}, {});
  });
  batch->sense();  // reads the two drones that the announcement spawned
  EXPECT_EQ(batch->config().num_drones(), 2);
  batch->lidar().require_scan();
  const BatchLock lock(*batch);
  batch->spawn(Indices{2}, {}, {}, {});
  batch->lidar().set({.beams = 5});
  EXPECT_EQ(ServedBatch::generation(*batch), 3);
}

TEST(SpawnedDrones, HaveTheSensorSettingsOfTheConfiguration) {
  const auto batch = batch_of(instruments(Motion::kinematic, 1), 1, 3);
  batch->remove(Indices{2});
  batch->sense();
  const auto readings = [&] {
    std::vector<float> ranges(batch->lidar().readings().ranges.size());
    std::ranges::copy(batch->lidar().readings().ranges, ranges.begin());
    return ranges;
  };
  const std::vector<float> before = readings();
  const float range = batch->lidar().readings().max_range_m[1];
  const std::vector<std::uint8_t> second{0, 1, 0};
  batch->lidar().set({.max_range_m = 0.5F, .hfov_deg = 90.0F, .offset_m = {{0.1F, 0.0F, 0.0F}}, .quat_wxyz = {{0, 0, 0, 1}}},
                     second);
  batch->camera(0).set({.hfov_deg = 60.0F, .offset_m = {{0.1F, 0.0F, 0.0F}}, .quat_wxyz = {{0, 0, 0, 1}}}, second);
  batch->sense();
  EXPECT_FALSE(readings() == before);
  batch->remove(Indices{1});
  const std::vector<float> place(batch->state().position.begin(), batch->state().position.begin() + 3);
  EXPECT_EQ(batch->spawn({}, place, {}, {}), Indices{1});
  for (const std::int64_t drone : {0, 1}) {
    const LidarConfig lidar = batch->lidar().config(DroneIndex(drone));
    EXPECT_EQ(lidar.max_range_m, batch->config().lidars[0].max_range_m);
    EXPECT_EQ(lidar.hfov_deg, batch->config().lidars[0].hfov_deg);
    EXPECT_EQ(lidar.offset_m, batch->config().lidars[0].offset_m);
    EXPECT_EQ(lidar.quat_wxyz, batch->config().lidars[0].quat_wxyz);
    const CameraConfig camera = batch->camera(0).config(DroneIndex(drone));
    EXPECT_EQ(camera.hfov_deg, batch->config().cameras[0].hfov_deg);
    EXPECT_EQ(camera.offset_m, batch->config().cameras[0].offset_m);
    EXPECT_EQ(camera.quat_wxyz, batch->config().cameras[0].quat_wxyz);
  }
  EXPECT_EQ(batch->lidar().readings().max_range_m[1], range);
  EXPECT_TRUE(readings() == before);  // those of both drones, which are at one place
  const auto& rgb = batch->camera(0).images().rgb;
  const std::size_t width = rgb.size() / 3;
  EXPECT_TRUE(std::equal(rgb.begin(), rgb.begin() + static_cast<std::ptrdiff_t>(width),
                         rgb.begin() + static_cast<std::ptrdiff_t>(width)));
}

TEST(SpawnedDrones, StandAsSetPosePlacesThem) {
  const std::vector<float> at{1, 1, 0.75F}, level{1, 0, 0, 0}, inverted{0, 1, 0, 0};
  for (const Motion motion : {Motion::rotors, Motion::kinematic}) {
    const auto batch = batch_of(instruments(motion, 1), 1, 1);
    batch->set_pose(at, inverted);
    batch->remove(Indices{0});
    batch->spawn(Indices{0}, at, {}, {});
    EXPECT_EQ(batch->state().quat_wxyz, motion == Motion::rotors ? level : inverted);
  }
}

TEST(GrowthOfBatches, ThreadsSpawnIntoASharedBatch) {
  const auto batch = batch_of(instruments(Motion::kinematic, 2), 1, 0);
  ServedBatch served(*batch);
  constexpr int kThreads = 3, kSpawns = 8;
  std::vector<Indices> spawned(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t thread = 0; thread < kThreads; ++thread) {
    threads.emplace_back([&, thread] {
      for (int i = 0; i < kSpawns; ++i) {
        const std::vector<float> at{1, 0.5F + 0.1F * static_cast<float>(i), 0.75F};
        const Indices index = batch->spawn({}, at, {}, {});
        spawned[thread].push_back(index.at(0));
        const BatchLock lock(*batch);
        EXPECT_EQ(batch->state().position[3 * static_cast<std::size_t>(index[0]) + 1], at[1]);
        EXPECT_EQ(batch->state().position.size(), 3U * static_cast<std::size_t>(batch->config().num_drones()));
        EXPECT_FALSE(std::isnan(batch->lidar().readings().ranges[0]));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  std::set<std::int64_t> all;
  for (const Indices& of_thread : spawned) all.insert(of_thread.begin(), of_thread.end());
  EXPECT_EQ(all.size(), static_cast<std::size_t>(kThreads * kSpawns));
  EXPECT_EQ(std::ranges::count(batch->state().active, 1), kThreads * kSpawns);
}

}  // namespace
}  // namespace flockstep
