// Cameras in a batch: capture times and their content, changes at run time, snapshots, files, bad input.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "numbers.hpp"
#include "picture_oracle.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using testing::camera_batch;
using testing::kAllOutputs;
using testing::kInfinity;
using testing::make_world;
using testing::NavigationBatch;
using testing::primitive;
using testing::Random;
using testing::row;
using testing::same_bits;

using Flags = std::vector<std::uint8_t>;
using Steps = std::vector<std::int64_t>;

// -- Capture times. A camera of one pixel faces a wall, so its depth shows the drone's position at the capture.

constexpr float kWall = 10.0F;  // m, distance of the wall ahead in the first world; doubled in the second

BatchConfig probes(int num_envs, CaptureMode mode) {
  return camera_batch({.width_px = 1, .height_px = 1, .outputs = {.rgb = false, .depth = true}, .capture_mode = mode}, num_envs);
}

const Batch::Worlds& halls() {
  static const Batch::Worlds worlds{make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {kWall, 9, 9})}),
                                    make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {2 * kWall, 9, 9})})};
  return worlds;
}

void put(Batch& batch, const std::vector<float>& x, const Flags& mask = {}) {
  std::vector<float> position;
  for (const float each : x) position.insert(position.end(), {each, 0.0F, 0.0F});
  batch.set_pose(position, {}, mask);
}

// Returns the drones' x at the capture, in the first world; inf before the first capture.
std::vector<float> shown(const Batch& batch, std::size_t camera = 0) {
  std::vector<float> x;
  for (const float depth : batch.images(camera).depth) x.push_back(depth == kInfinity ? kInfinity : kWall - depth);
  return x;
}

const Steps& frame_step(const Batch& batch, std::size_t camera = 0) { return batch.images(camera).frame_step; }

// Overwrites all frames, so that frames without a new capture are recognised.
void smear(const Batch& batch, std::size_t camera = 0) {
  for (const float& depth : batch.images(camera).depth) const_cast<float&>(depth) = -1.0F;
}

bool is_smeared(const Batch& batch, std::size_t drone) { return batch.images(0).depth[drone] == -1.0F; }

TEST(CaptureEveryStep, AtEverySenseOfTheSelectedDrones) {
  Batch batch(probes(3, CaptureMode::every_step), {halls()[0]});
  EXPECT_EQ(frame_step(batch), (Steps{-1, -1, -1}));
  EXPECT_EQ(shown(batch), (std::vector<float>{kInfinity, kInfinity, kInfinity}));
  put(batch, {1, 2, 3});
  EXPECT_EQ(frame_step(batch), (Steps{-1, -1, -1})) << "a teleport alone takes no frame";
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{1, 2, 3}));
  EXPECT_EQ(frame_step(batch), (Steps{0, 0, 0}));
  put(batch, {4, 5, 6});
  EXPECT_EQ(shown(batch), (std::vector<float>{1, 2, 3}));
  batch.sense(Flags{0, 1, 0});
  EXPECT_EQ(shown(batch), (std::vector<float>{1, 5, 3}));
  EXPECT_EQ(frame_step(batch), (Steps{0, 1, 0}));
  smear(batch);
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{4, 5, 6})) << "also of those that did not move";
  EXPECT_EQ(frame_step(batch), (Steps{1, 2, 1}));
}

TEST(CaptureOnMovement, OnlyIfThePoseOrTheWorldChanged) {
  Batch batch(probes(5, CaptureMode::on_movement), halls(), nullptr, DroneModel::quadrotor650(), std::vector<std::int32_t>(5, 0));
  put(batch, {1, 2, 3, 4, 5});
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{1, 2, 3, 4, 5}));
  EXPECT_EQ(frame_step(batch), (Steps{0, 0, 0, 0, 0}));
  smear(batch);
  batch.sense();
  for (std::size_t drone = 0; drone < 5; ++drone) EXPECT_TRUE(is_smeared(batch, drone)) << drone;
  EXPECT_EQ(frame_step(batch), (Steps{0, 0, 0, 0, 0}));

  put(batch, {1.5F, 0, 0, 0, 0}, {1, 0, 0, 0, 0});  // moved
  put(batch, {0, 7, 0, 0, 0}, {0, 1, 0, 0, 0});     // away
  put(batch, {0, 2, 0, 0, 0}, {0, 1, 0, 0, 0});     // and back again
  std::vector<float> turned(20, 0.0F);
  for (std::size_t drone = 0; drone < 5; ++drone) turned[4 * drone + 3] = 1.0F;
  batch.set_pose({}, turned, Flags{0, 0, 1, 0, 0});  // turned around, to the wall behind
  batch.set_world(std::vector<std::int32_t>{0, 0, 0, 1, 0}, Flags{0, 0, 0, 1, 0});
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{1.5F, kWall + 1.0F, -3.0F, 4.0F - kWall, kWall + 1.0F}));
  EXPECT_EQ(frame_step(batch), (Steps{2, 0, 2, 2, 0}));

  // A frame keeps its age as long as it shows the drone's current pose.
  smear(batch);
  batch.sense();
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{2, 0, 2, 2, 0}));
  // A new episode triggers a capture, even at the same pose.
  batch.begin_episode(Flags{1, 0, 0, 0, 0});
  EXPECT_EQ(frame_step(batch), (Steps{-1, 0, 2, 2, 0}));
  std::vector<std::uint64_t> seeds(5, 9);
  batch.seed(seeds, Flags{0, 1, 0, 0, 0});
  EXPECT_EQ(frame_step(batch), (Steps{-1, -1, 2, 2, 0}));
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{0, 0, 2, 2, 0}));
  for (std::size_t drone = 0; drone < 5; ++drone) EXPECT_EQ(is_smeared(batch, drone), drone >= 2) << drone;
}

TEST(CaptureOnMovement, AFlightBackToItsStartIsNoMovement) {
  Batch batch(probes(2, CaptureMode::on_movement), {halls()[0]});
  put(batch, {1, 2});
  batch.sense();
  smear(batch);
  batch.move(std::vector<float>{1, 0, 0, 2.25F, 0, 0}, {});
  batch.sense();
  EXPECT_TRUE(is_smeared(batch, 0));
  EXPECT_EQ(shown(batch)[1], 2.25F);
  EXPECT_EQ(frame_step(batch), (Steps{0, 1}));
}

TEST(CaptureOnDemand, OnlyByCapture) {
  Batch batch(probes(3, CaptureMode::on_demand), {halls()[0]});
  put(batch, {1, 2, 3});
  batch.sense();
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{-1, -1, -1}));
  batch.capture(0, Flags{0, 1, 0});
  EXPECT_EQ(shown(batch), (std::vector<float>{kInfinity, 2, kInfinity}));
  EXPECT_EQ(frame_step(batch), (Steps{-1, 1, -1})) << "the step of the last sense";
  put(batch, {4, 5, 6});
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{kInfinity, 2, kInfinity}));
  EXPECT_EQ(frame_step(batch), (Steps{-1, 1, -1})) << "it shows that step still";
  batch.capture(0);
  EXPECT_EQ(shown(batch), (std::vector<float>{4, 5, 6}));
  EXPECT_EQ(frame_step(batch), (Steps{2, 2, 2}));
  batch.begin_episode(Flags{0, 0, 1});
  EXPECT_EQ(frame_step(batch), (Steps{2, 2, -1}));
  batch.capture(0, Flags{0, 0, 1});
  EXPECT_EQ(frame_step(batch), (Steps{2, 2, 0})) << "before the episode's first sense";
}

TEST(Capture, RendersNowInEveryMode) {
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement}) {
    Batch batch(probes(2, mode), {halls()[0]});
    put(batch, {1, 2});
    batch.sense();
    batch.sense();
    smear(batch);
    put(batch, {3, 2});
    batch.capture(0);
    EXPECT_EQ(shown(batch), (std::vector<float>{3, 2}));
    EXPECT_EQ(frame_step(batch), (Steps{1, 1}));
  }
}

TEST(Capture, TheModeChangesAtRunTime) {
  Batch batch(probes(1, CaptureMode::every_step), {halls()[0]});
  put(batch, {1});
  batch.sense();
  batch.set_capture_mode(0, CaptureMode::on_demand);
  EXPECT_EQ(batch.camera_config(0).capture_mode, CaptureMode::on_demand);
  EXPECT_EQ(batch.camera_config(0, 0).capture_mode, CaptureMode::on_demand);
  put(batch, {2});
  batch.sense();
  EXPECT_EQ(shown(batch)[0], 1.0F);
  batch.set_capture_mode(0, CaptureMode::on_movement);
  EXPECT_EQ(shown(batch)[0], 1.0F);
  batch.sense();
  EXPECT_EQ(shown(batch)[0], 2.0F) << "it moved since its frame was taken";
  EXPECT_EQ(frame_step(batch), (Steps{2}));
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{2}));
  batch.set_capture_mode(0, CaptureMode::every_step);
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{4}));
}

TEST(CaptureSlots, ARemovedOneSeesNothingAndASpawnedOneRenders) {
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement, CaptureMode::on_demand}) {
    SCOPED_TRACE(static_cast<int>(mode));
    CameraConfig camera{.width_px = 5, .height_px = 3, .outputs = kAllOutputs, .capture_mode = mode};
    Batch batch(camera_batch(camera, 3), halls(), nullptr, DroneModel::quadrotor650(), std::vector<std::int32_t>(3, 0));
    put(batch, {1, 2, 3});
    batch.sense();
    batch.capture(0);
    const CameraImages before = batch.images(0);
    ASSERT_EQ(before.instance, std::vector<std::uint16_t>(45, 1));
    batch.remove(std::vector<std::int64_t>{1});
    for (int time = 0; time < 3; ++time) {  // immediately, after a scan, after a capture
      const CameraImages& images = batch.images(0);
      const auto all_are = [](const auto& values, auto value) {
        return std::all_of(values.begin(), values.end(), [&](auto each) { return each == value; });
      };
      EXPECT_TRUE(all_are(row(images.rgb, 1, 45), 0)) << time;
      EXPECT_TRUE(all_are(row(images.depth, 1, 15), kInfinity)) << time;
      EXPECT_TRUE(all_are(row(images.semantic, 1, 15), 0)) << time;
      EXPECT_TRUE(all_are(row(images.instance, 1, 15), 0)) << time;
      EXPECT_TRUE(all_are(row(images.normal, 1, 45), 0.0F)) << time;
      EXPECT_TRUE(all_are(row(images.grey, 1, 15), 0)) << time;
      EXPECT_EQ(images.frame_step[1], -1);
      for (const std::size_t other : {0U, 2U}) {
        EXPECT_TRUE(same_bits(row(images.rgb, other, 45), row(before.rgb, other, 45)));
        EXPECT_TRUE(same_bits(row(images.depth, other, 15), row(before.depth, other, 15)));
      }
      if (time == 0) batch.sense();
      if (time == 1) batch.capture(0);
    }
    batch.spawn(std::vector<std::int64_t>{1}, std::vector<float>{4, 0, 0}, {}, std::vector<std::int32_t>{1});
    const bool at_once = mode != CaptureMode::on_demand;
    EXPECT_EQ(frame_step(batch)[1], at_once ? 0 : -1);
    EXPECT_EQ(batch.images(0).depth[22], at_once ? 2 * kWall - 4 : kInfinity);
    EXPECT_EQ(frame_step(batch)[0], 1) << "no other drone is sensed";
    batch.capture(0, Flags{0, 1, 0});
    EXPECT_EQ(frame_step(batch)[1], 0);
    EXPECT_EQ(batch.images(0).depth[22], 2 * kWall - 4);
  }
}

TEST(CaptureCameras, EachHasItsSizeItsOutputsAndItsMode) {
  BatchConfig config = probes(2, CaptureMode::every_step);
  config.cameras.push_back({.name = "down",
                            .width_px = 33,
                            .height_px = 9,
                            .hfov_deg = 40.0F,
                            .quat_wxyz = {0, 0, 0, 1},  // faces backwards
                            .outputs = {.rgb = false, .depth = true, .semantic = true},
                            .capture_mode = CaptureMode::on_demand});
  Batch batch(config, {halls()[0]});
  EXPECT_EQ(batch.camera_index("front"), 0U);
  EXPECT_EQ(batch.camera_index("down"), 1U);
  EXPECT_REFUSED((void)batch.camera_index(""), R"(camera: expected one of "front", "down", got no name)");
  EXPECT_EQ(Batch(probes(1, CaptureMode::every_step), halls()).camera_index(""), 0U) << "the only one needs no name";
  EXPECT_EQ(batch.images(1).depth.size(), 2U * 33U * 9U);
  EXPECT_TRUE(batch.images(0).semantic.empty());
  put(batch, {1, 2});
  batch.sense();
  EXPECT_EQ(frame_step(batch, 0), (Steps{0, 0}));
  EXPECT_EQ(frame_step(batch, 1), (Steps{-1, -1}));
  smear(batch);
  put(batch, {3, 4});
  batch.capture(1);
  EXPECT_TRUE(is_smeared(batch, 0));
  EXPECT_EQ(batch.images(1).depth[0], kWall + 3);
  EXPECT_EQ(batch.images(1).depth[33 * 9], kWall + 4);
  EXPECT_EQ(frame_step(batch, 1), (Steps{0, 0}));
  batch.set_capture_mode(1, CaptureMode::every_step);
  batch.set_capture_mode(0, CaptureMode::on_demand);
  put(batch, {5, 6});
  batch.sense();
  EXPECT_TRUE(is_smeared(batch, 0));
  EXPECT_EQ(batch.images(1).depth[0], kWall + 5);
  for (std::size_t drone = 0; drone < 2; ++drone) EXPECT_EQ(testing::expect_picture(batch, drone, 1).clear, 33U * 9U);
}

// -- Captures by the task: in every autoreset mode, no frame is older than its capture mode allows.

std::shared_ptr<const World> smaller_closet() {
  return make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {1.0F, 1.0F, 0.75F}),
                     primitive(PrimitiveKind::sphere, {1.8F, 1.7F, 0.4F}, {0.125F, 0.125F, 0.125F})},
                    {.start = Vec3(1, 1, 0.75F),
                     .goal = Vec3(1, 1.25F, 0.75F),
                     .spawn_box = Aabb{Vec3(0.9F, 0.9F, 0.6F), Vec3(1.1F, 1, 0.9F)}});
}

constexpr std::size_t kEnvs = 12;

NavigationBatch flying(AutoresetMode autoreset, CaptureMode mode) {
  NavigationBatch config = testing::navigation_batch(kEnvs);
  config.episode.autoreset_mode = autoreset;
  config.navigation.action = ActionKind::displacement;
  config.episode.max_episode_steps = 14;
  config.navigation.random_start = true;
  config.episode.random_world = true;
  config.episode.stagger_first_episode = true;
  config.cameras = {{.width_px = 9, .height_px = 7, .outputs = {.rgb = true, .depth = true}, .capture_mode = mode}};
  return config;
}

bool same_frame(const Batch& a, const Batch& b, std::size_t drone) {
  return same_bits(row(a.images(0).rgb, drone, 3 * 63), row(b.images(0).rgb, drone, 3 * 63)) &&
         same_bits(row(a.images(0).depth, drone, 63), row(b.images(0).depth, drone, 63));
}

// Random actions. Some drones stay at rest with action 0.
std::vector<float> random_actions(Random& random) {
  std::vector<float> actions(3 * kEnvs, 0.0F);
  for (std::size_t i = 0; i < kEnvs; ++i) {
    if (random.within(0, 1) < 0.4F) continue;
    for (std::size_t k = 0; k < 3; ++k) actions[3 * i + k] = random.within(-1, 1);
  }
  return actions;
}

TEST(CaptureTask, FramesAreAsOldAsTheirModeAllows) {
  for (const AutoresetMode autoreset : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    SCOPED_TRACE(static_cast<int>(autoreset));
    const Batch::Worlds worlds{testing::closet(), smaller_closet()};
    Batch every = flying(autoreset, CaptureMode::every_step).make(worlds);
    Batch moving = flying(autoreset, CaptureMode::on_movement).make(worlds);
    Batch demand = flying(autoreset, CaptureMode::on_demand).make(worlds);
    // Captured after every call, so it shows the current poses.
    Batch truth = flying(autoreset, CaptureMode::on_demand).make(worlds);
    const std::array all{&every, &moving, &demand, &truth};
    Random random(7);
    for (Batch* batch : all) batch->reset({});
    Steps demanded(kEnvs, -1);
    std::vector<std::vector<float>> kept(kEnvs);  // depths of the last capture on demand
    std::vector<float> last_position;
    Steps last_episode;
    int resets = 0;
    int still = 0;
    int old = 0;
    for (int step = 0; step < 120; ++step) {
      if (step > 0) {
        const std::vector<float> actions = random_actions(random);
        Flags done(kEnvs);
        for (std::size_t i = 0; i < kEnvs; ++i) done[i] = truth.outputs().terminated[i] || truth.outputs().truncated[i];
        for (Batch* batch : all) {
          if (autoreset == AutoresetMode::disabled && step % 3 == 0) {
            batch->reset({}, done);
          } else {
            batch->step(std::span<const float>(actions));
          }
        }
      }
      truth.capture(0);
      const State& state = truth.state();
      for (std::size_t i = 0; i < kEnvs; ++i) {
        SCOPED_TRACE("step " + std::to_string(step) + ", drone " + std::to_string(i));
        const std::int64_t now = state.sensed[i];  // step in the episode
        ASSERT_EQ(frame_step(truth)[i], now);
        ASSERT_EQ(frame_step(every)[i], now);
        ASSERT_TRUE(same_frame(every, truth, i));
        ASSERT_TRUE(same_frame(moving, truth, i));
        const bool began = last_episode.empty() || state.episode[i] != last_episode[i];
        if (began) {
          resets += step > 0;
          ASSERT_EQ(now, 0);
          ASSERT_EQ(frame_step(moving)[i], 0);
          demanded[i] = -1;  // a reset makes frames stale
        } else {
          const bool moved = !std::equal(&state.position[3 * i], &state.position[3 * i] + 3, &last_position[3 * i]);
          if (moved) {
            ASSERT_EQ(frame_step(moving)[i], now);
          }
          still += !moved;
          old += frame_step(moving)[i] < now;
        }
        ASSERT_EQ(frame_step(demand)[i], demanded[i]);
        ASSERT_GE(frame_step(moving)[i], 0);
        if (demanded[i] >= 0) {
          ASSERT_TRUE(same_bits(row(demand.images(0).depth, i, 63), kept[i]));
        }
      }
      last_position = state.position;
      last_episode = state.episode;
      if (step % 4 != 1) continue;
      Flags some(kEnvs);
      for (std::size_t i = 0; i < kEnvs; ++i) some[i] = random.generator()() % 2;
      demand.capture(0, some);
      for (std::size_t i = 0; i < kEnvs; ++i) {
        if (!some[i]) continue;
        demanded[i] = state.sensed[i];
        ASSERT_EQ(frame_step(demand)[i], demanded[i]);
        ASSERT_TRUE(same_frame(demand, truth, i));
        const auto depths = row(demand.images(0).depth, i, 63);
        kept[i].assign(depths.begin(), depths.end());
      }
    }
    EXPECT_GT(resets, 20);
    EXPECT_GT(still, 50);
    EXPECT_GT(old, 50);
  }
}

TEST(CaptureTask, CamerasChangeNothingElse) {
  for (const AutoresetMode autoreset : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    const Batch::Worlds worlds{testing::closet(), smaller_closet()};
    Batch with = flying(autoreset, CaptureMode::every_step).make(worlds);
    NavigationBatch blind = flying(autoreset, CaptureMode::every_step);
    blind.cameras.clear();
    Batch without = blind.make(worlds);
    Random random(8);
    with.reset({});
    without.reset({});
    for (int step = 0; step < 60; ++step) {
      ASSERT_TRUE(testing::same_drones(with, without)) << step;
      const std::vector<float> actions = random_actions(random);
      with.step(std::span<const float>(actions));
      without.step(std::span<const float>(actions));
    }
  }
}

// The hundred warm-up steps wake the second thread. oneTBB allocates its tasks from its own pools, so this counts the engine's
// allocations.
void expect_no_allocation(int num_threads) {
  NavigationBatch config = testing::navigation_batch(32);
  config.num_threads = num_threads;
  config.block_size = 4;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.max_episode_steps = 50;
  config.episode.stagger_first_episode = true;
  config.episode.random_world = true;
  config.cameras = {
      {.name = "a", .width_px = 17, .height_px = 9, .outputs = kAllOutputs, .samples_per_pixel = 4, .shadows = true},
      {.name = "b", .width_px = 16, .height_px = 16, .layout = ImageLayout::chw, .capture_mode = CaptureMode::on_movement},
      {.name = "c", .width_px = 8, .height_px = 8, .capture_mode = CaptureMode::on_demand}};
  SceneDescription with_mesh;
  with_mesh.primitives = {primitive(PrimitiveKind::room, {7, 7, 2}, {7, 7, 2})};
  with_mesh.mesh.vertices = {{3, 3, 1}, {4, 3, 1}, {3, 4, 2}};
  with_mesh.mesh.triangles = {{0, 1, 2}};
  with_mesh.markers = {.start = Vec3(7, 7, 2), .goal = Vec3(10, 10, 2)};
  Batch batch = config.make({testing::playground("train-1"), std::make_shared<const World>(with_mesh)});
  batch.reset({});
  Random random(3);
  std::vector<std::int64_t> actions(32);
  const auto step = [&] {
    for (std::int64_t& action : actions) action = random.generator()() % 6;
    batch.step(std::span<const std::int64_t>(actions));
    batch.capture(2);
  };
  for (int i = 0; i < 100; ++i) step();
  int ends = 0;
  const std::uint64_t before = testing::allocations();
  for (int i = 0; i < 100; ++i) {
    step();
    ends += std::accumulate(batch.outputs().truncated.begin(), batch.outputs().truncated.end(), 0);
  }
  EXPECT_EQ(testing::allocations() - before, 0U);
  EXPECT_GT(ends, 10);
}

TEST(CaptureTask, AStepAllocatesNothing) { expect_no_allocation(1); }
TEST(CaptureTask, AStepOnTwoThreadsAllocatesNothing) { expect_no_allocation(2); }

// -- Changes at run time.

std::shared_ptr<const World> gallery() {
  return make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5, 4, 3}),
                     primitive(PrimitiveKind::box, {3, 1, 0}, {0.5F, 0.7F, 1}, Quat(0.8F, 0.2F, -0.4F, 0.4F).normalized()),
                     primitive(PrimitiveKind::cylinder, {2, -1, -1}, {0.5F, 0.5F, 1.5F}),
                     primitive(PrimitiveKind::sphere, {0, -2, 1}, {0.8F, 0.8F, 0.8F})});
}

TEST(CameraChange, EqualsASensorMadeThatWay) {
  CameraConfig base{.width_px = 24, .height_px = 18, .hfov_deg = 70.0F, .vfov_deg = 50.0F, .outputs = kAllOutputs};
  CameraConfig across = base;
  across.hfov_deg = 100.0F;
  across.vfov_deg.reset();  // setting one resets the other
  CameraConfig up = base;
  up.hfov_deg.reset();
  up.vfov_deg = 30.0F;
  CameraConfig both = base;
  both.hfov_deg = 40.0F;
  both.vfov_deg = 80.0F;
  CameraConfig moved = base;
  moved.offset_m = {0.4F, 0.2F, -0.3F};
  CameraConfig turned = base;
  turned.quat_wxyz = {0.6F, 0, 0.8F, 0};
  const std::vector<CameraConfig> configs{base, across, up, both, moved, turned, base, across};
  Batch batch(camera_batch(base, 8), {gallery()});
  const auto only = [](std::size_t drone) {
    Flags mask(8, 0);
    mask[drone] = 1;
    return mask;
  };
  batch.set_camera(0, {.hfov_deg = 100.0F}, only(1));
  batch.set_camera(0, {.vfov_deg = 30.0F}, only(2));
  batch.set_camera(0, {.hfov_deg = 40.0F, .vfov_deg = 80.0F}, only(3));
  batch.set_camera(0, {.offset_m = moved.offset_m}, only(4));
  batch.set_camera(0, {.quat_wxyz = turned.quat_wxyz}, only(5));
  // Changed, then changed back.
  batch.set_camera(0, {.hfov_deg = 20.0F, .offset_m = {{1, 1, 1}}, .quat_wxyz = {{0, 1, 0, 0}}}, only(6));
  batch.set_camera(0, {.hfov_deg = 70.0F, .vfov_deg = 50.0F, .offset_m = {{0, 0, 0}}, .quat_wxyz = {{1, 0, 0, 0}}}, only(6));
  batch.set_camera(0, {.vfov_deg = 33.0F}, only(7));  // sets vfov_deg; the next call resets it
  batch.set_camera(0, {.hfov_deg = 100.0F}, only(7));
  const std::vector<float> pose{0.5F, 0.25F, -0.5F};
  std::vector<float> poses;
  for (int i = 0; i < 8; ++i) poses.insert(poses.end(), pose.begin(), pose.end());
  batch.set_pose(poses, {});
  batch.sense();
  const CameraImages& images = batch.images(0);
  const std::size_t pixels = std::size_t{24} * 18;
  for (std::size_t drone = 0; drone < 8; ++drone) {
    SCOPED_TRACE(drone);
    const CameraConfig is = batch.camera_config(0, static_cast<std::int64_t>(drone));
    EXPECT_EQ(is.hfov_deg, configs[drone].hfov_deg);
    EXPECT_EQ(is.vfov_deg, configs[drone].vfov_deg);
    EXPECT_EQ(is.offset_m, configs[drone].offset_m);
    EXPECT_EQ(is.quat_wxyz, configs[drone].quat_wxyz);
    Batch made_so(camera_batch(configs[drone]), {gallery()});
    made_so.set_pose(pose, {});
    made_so.sense();
    EXPECT_TRUE(same_bits(row(images.rgb, drone, 3 * pixels), made_so.images(0).rgb));
    EXPECT_TRUE(same_bits(row(images.depth, drone, pixels), made_so.images(0).depth));
    EXPECT_TRUE(same_bits(row(images.normal, drone, 3 * pixels), made_so.images(0).normal));
    EXPECT_GT(testing::expect_picture(batch, drone, 0, 3).clear, 100U);
    // Each change must be visible, otherwise the comparison proves nothing.
    EXPECT_EQ(same_bits(row(images.depth, drone, pixels), row(images.depth, 0, pixels)), drone == 0 || drone == 6);
  }
}

TEST(CameraChange, MarksFramesStaleAndRendersThemWhenTheyAreDue) {
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement, CaptureMode::on_demand}) {
    Batch batch(probes(3, mode), {halls()[0]});
    put(batch, {1, 2, 3});
    batch.sense();
    batch.capture(0);
    batch.set_camera(0, {.offset_m = {{0.5F, 0, 0}}}, Flags{0, 1, 0});
    EXPECT_EQ(frame_step(batch), (Steps{0, -1, 0}));
    smear(batch);
    batch.sense();
    const bool every = mode == CaptureMode::every_step;
    const bool demand = mode == CaptureMode::on_demand;
    EXPECT_EQ(frame_step(batch), (Steps{every ? 1 : 0, demand ? -1 : 1, every ? 1 : 0}));
    EXPECT_EQ(is_smeared(batch, 0), !every);
    EXPECT_EQ(is_smeared(batch, 1), demand);
    batch.capture(0);
    EXPECT_EQ(shown(batch), (std::vector<float>{1, 2.5F, 3}));
  }
}

TEST(CameraChange, ARemovedDroneKeepsItsCamera) {
  Batch batch(probes(2, CaptureMode::every_step), {halls()[0]});
  batch.remove(std::vector<std::int64_t>{1});
  batch.set_camera(0, {.offset_m = {{0.5F, 0, 0}}});
  batch.spawn(std::vector<std::int64_t>{1}, std::vector<float>{2, 0, 0}, {}, {});
  EXPECT_EQ(shown(batch)[1], 2.0F);
  EXPECT_EQ(batch.camera_config(0, 0).offset_m[0], 0.5F);
}

// -- Bad input.

TEST(CameraRefusal, OfEveryFieldOfTheConfiguration) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::pair<std::function<void(CameraConfig&)>, std::string>> cases{
      {[](CameraConfig& c) { c.name = ""; }, "camera.name: expected letters, digits, _ and -, got \"\""},
      {[](CameraConfig& c) { c.name = "../front"; }, "camera.name: expected letters, digits, _ and -, got \"../front\""},
      {[](CameraConfig& c) { c.width_px = 0; }, "camera.width_px: expected an integer in [1, 8192], got 0"},
      {[](CameraConfig& c) { c.width_px = 8193; }, "camera.width_px: expected an integer in [1, 8192], got 8193"},
      {[](CameraConfig& c) { c.height_px = -4; }, "camera.height_px: expected an integer in [1, 8192], got -4"},
      {[](CameraConfig& c) { c.height_px = 1 << 30; }, "camera.height_px: expected an integer in [1, 8192], got 1073741824"},
      {[](CameraConfig& c) { c.hfov_deg = 0.0F; }, "camera.hfov_deg: expected a number in [0.1, 179], got 0"},
      {[](CameraConfig& c) { c.hfov_deg = 180.0F; }, "camera.hfov_deg: expected a number in [0.1, 179], got 180"},
      {[&](CameraConfig& c) { c.hfov_deg = nan; }, "camera.hfov_deg: expected a number in [0.1, 179], got nan"},
      {[](CameraConfig& c) { c.vfov_deg = 0.0F; }, "camera.vfov_deg: expected a number in [0.1, 179], got 0"},
      {[](CameraConfig& c) { c.vfov_deg = -90.0F; }, "camera.vfov_deg: expected a number in [0.1, 179], got -90"},
      {[](CameraConfig& c) { c.hfov_deg = 90.0F, c.vfov_deg = 180.0F; },
       "camera.vfov_deg: expected a number in [0.1, 179], got 180"},
      {[](CameraConfig& c) { c.width_px = 8000, c.height_px = 10, c.vfov_deg = 150.0F; },
       "camera.vfov_deg: expected an angle that keeps the other below 179 degrees"},
      {[](CameraConfig& c) { c.width_px = 10, c.height_px = 8000, c.hfov_deg = 150.0F; },
       "camera.hfov_deg: expected an angle that keeps the other below 179 degrees"},
      {[&](CameraConfig& c) { c.offset_m[1] = nan; }, "camera.offset_m[1]: expected a number within +-100, got nan"},
      {[](CameraConfig& c) { c.offset_m[2] = -1e30F; }, "camera.offset_m[2]: expected a number within +-100, got -1e+30"},
      {[](CameraConfig& c) { c.quat_wxyz = {0, 0, 0, 0}; }, "camera.quat_wxyz: expected a unit quaternion"},
      {[&](CameraConfig& c) { c.quat_wxyz[3] = nan; }, "camera.quat_wxyz: expected a unit quaternion"},
      {[](CameraConfig& c) { c.near_m = 0.0F; }, "camera.near_m: expected a finite number > 0, got 0"},
      {[&](CameraConfig& c) { c.near_m = nan; }, "camera.near_m: expected a finite number > 0, got nan"},
      {[](CameraConfig& c) { c.near_m = 5.0F, c.far_m = 5.0F; }, "camera.far_m: expected a number > near_m"},
      {[](CameraConfig& c) { c.far_m = 0.01F; }, "camera.far_m: expected a number > near_m"},
      {[](CameraConfig& c) { c.far_m = kInfinity; }, "camera.far_m: expected a number in (0, 1000000], got inf"},
      {[&](CameraConfig& c) { c.far_m = nan; }, "camera.far_m: expected a number in (0, 1000000], got nan"},
      {[](CameraConfig& c) { c.far_m = 2e6F; }, "camera.far_m: expected a number in (0, 1000000], got 2e+06"},
      {[](CameraConfig& c) { c.outputs = {.rgb = false}; }, "camera.outputs: expected at least one of"},
      {[](CameraConfig& c) { c.samples_per_pixel = 0; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 0"},
      {[](CameraConfig& c) { c.samples_per_pixel = 3; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 3"},
      {[](CameraConfig& c) { c.samples_per_pixel = 25; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 25"},
  };
  for (const auto& [spoil, message] : cases) {
    CameraConfig camera;
    spoil(camera);
    EXPECT_REFUSED(camera.validate(), message);
    EXPECT_REFUSED(Batch(camera_batch(camera), halls()), message);
  }
  EXPECT_NO_THROW(CameraConfig().validate());
  EXPECT_NO_THROW((CameraConfig{.width_px = 1, .height_px = 8192, .vfov_deg = 179.0F}).validate());
  EXPECT_NO_THROW((CameraConfig{.width_px = 8192, .height_px = 1, .hfov_deg = 0.1F}).validate());
}

TEST(CameraRefusal, OfTwoOfOneNameAndOfTooManyPixels) {
  BatchConfig config = probes(1, CaptureMode::every_step);
  config.cameras.push_back(config.cameras[0]);
  EXPECT_REFUSED(Batch(config, halls()), "camera.name: expected a name that no other camera has, got \"front\"");
  config = camera_batch({.width_px = 8192, .height_px = 8192}, 65);
  EXPECT_REFUSED(config.validate(), "num_drones x camera pixels: expected at most 4294967296 pixels");
}

TEST(CameraRefusal, OfMoreInstancesThanHaveNumbers) {
  SceneDescription description;
  for (int i = 0; i < 65535; ++i) {
    description.primitives.push_back(primitive(PrimitiveKind::sphere, {static_cast<float>(i), 0, 0}, {0.1F, 0.1F, 0.1F}));
  }
  const auto full = std::make_shared<const World>(description);
  description.markers.goal = Vec3(0, 3, 0);
  const auto over = std::make_shared<const World>(description);
  CameraConfig camera{.width_px = 1, .height_px = 1, .outputs = {.rgb = true, .instance = true}};
  EXPECT_REFUSED(Batch(camera_batch(camera), {over}), "camera.outputs.instance: expected worlds of at most 65535");
  // The last instance id is used.
  camera.quat_wxyz = {0, 0, 0, 1};
  const auto batch = testing::look(full, camera, {65534.5F, 0, 0});
  EXPECT_EQ(batch->images(0).instance[0], 65535);
  camera.outputs.instance = false;
  EXPECT_NO_THROW(Batch(camera_batch(camera), {over}));
}

TEST(CameraRefusal, ChangesNothing) {
  CameraConfig camera{.width_px = 8, .height_px = 6, .outputs = {.rgb = true, .depth = true}};
  BatchConfig config = camera_batch(camera, 2);
  camera.name = "depth";
  camera.outputs = {.rgb = false, .depth = true};
  config.cameras.push_back(camera);
  Batch batch(config, {gallery()});
  batch.sense();
  const std::string before = batch.snapshot();
  const CameraImages frames = batch.images(0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const Flags& mask : {Flags{}, Flags{1, 0}, Flags{0, 0}}) {
    EXPECT_REFUSED(batch.set_camera(0, {.hfov_deg = 0.0F}, mask), "camera.hfov_deg");
    EXPECT_REFUSED(batch.set_camera(0, {.hfov_deg = 60.0F, .vfov_deg = 180.0F}, mask), "camera.vfov_deg");
    EXPECT_REFUSED(batch.set_camera(0, {.vfov_deg = 178.9F}, mask), "camera.vfov_deg");  // hfov_deg would exceed its limit
    EXPECT_REFUSED(batch.set_camera(0, {.hfov_deg = 60.0F, .offset_m = {{0, nan, 0}}}, mask), "camera.offset_m");
    EXPECT_REFUSED(batch.set_camera(0, {.quat_wxyz = {{0, 0, 0, 0}}}, mask), "camera.quat_wxyz");
    EXPECT_REFUSED(batch.set_camera(2, {.hfov_deg = 60.0F}, mask), "camera: expected an index below 2, got 2");
    EXPECT_REFUSED(batch.capture(2, mask), "camera: expected an index below 2, got 2");
  }
  EXPECT_REFUSED(batch.set_camera(0, {.hfov_deg = 60.0F}, Flags{1}), "mask: expected 2 flags, one for each drone, got 1");
  EXPECT_REFUSED(batch.capture(0, Flags{1, 0, 1}), "mask: expected 2 flags, one for each drone, got 3");
  EXPECT_REFUSED(batch.set_capture_mode(7, CaptureMode::on_demand), "camera: expected an index below 2, got 7");
  EXPECT_REFUSED((void)batch.images(2), "camera: expected an index below 2, got 2");
  EXPECT_REFUSED((void)batch.camera_config(2, 0), "camera: expected an index below 2, got 2");
  EXPECT_REFUSED((void)batch.camera_config(0, 2), "index: expected an integer in [0, 2), got 2");
  EXPECT_REFUSED((void)batch.camera_index("back"), R"(camera: expected one of "front", "depth", got "back")");
  EXPECT_REFUSED((void)batch.jpeg(2, 0, 90), "camera: expected an index below 2, got 2");
  EXPECT_REFUSED((void)batch.jpeg(1, 0, 90), R"(camera: expected one that writes rgb or grey, got "depth")");
  EXPECT_REFUSED((void)batch.jpeg(0, -1, 90), "index: expected an integer in [0, 2), got -1");
  EXPECT_REFUSED((void)batch.jpeg(0, 2, 90), "index: expected an integer in [0, 2), got 2");
  EXPECT_REFUSED((void)batch.jpeg(0, 0, 0), "quality: expected an integer in [1, 100], got 0");
  EXPECT_REFUSED((void)batch.jpeg(0, 0, 101), "quality: expected an integer in [1, 100], got 101");
  EXPECT_TRUE(batch.snapshot() == before);
  EXPECT_EQ(batch.images(0).rgb, frames.rgb);
  EXPECT_EQ(batch.images(0).frame_step, frames.frame_step);

  Batch blind(testing::lidar_batch(1), {gallery()});
  EXPECT_REFUSED((void)blind.camera_index("front"),
                 "this Batch has no camera: give it one (cameras=[...]; a Task declares camera)");
  EXPECT_REFUSED((void)blind.images(0), "camera");
  EXPECT_EQ(blind.camera_backend_report(), "this Batch has no cameras");
}

// -- Files.

TEST(CameraJpeg, EncodesTheFrame) {
  for (const bool grey : {false, true}) {
    CameraConfig camera{.width_px = 50, .height_px = 30, .outputs = {.rgb = !grey, .grey = grey}};
    const auto batch = testing::look(gallery(), camera, {0, 0, 0});
    const std::string fine = batch->jpeg(0, 0, 95);
    EXPECT_EQ(fine.substr(0, 2), "\xFF\xD8");
    EXPECT_EQ(fine.substr(fine.size() - 2), "\xFF\xD9");
    EXPECT_GT(fine.size(), batch->jpeg(0, 0, 20).size());
    // The frame header: SOF0, length, precision, height, width, number of components.
    const std::size_t header = fine.find("\xFF\xC0");
    ASSERT_NE(header, std::string::npos);
    const auto byte = [&](std::size_t i) { return static_cast<int>(static_cast<unsigned char>(fine[header + i])); };
    EXPECT_EQ(256 * byte(5) + byte(6), 30);
    EXPECT_EQ(256 * byte(7) + byte(8), 50);
    EXPECT_EQ(byte(9), grey ? 1 : 3);
  }
}

TEST(CameraJpeg, OfAStaleFrameIsRefused) {
  Batch batch(camera_batch({.width_px = 8, .height_px = 8, .capture_mode = CaptureMode::on_demand}, 2), halls());
  const std::string message = "index: expected a drone whose frame is not stale (call sense or capture first), got 1";
  EXPECT_REFUSED((void)batch.jpeg(0, 1, 90), message);
  batch.capture(0, Flags{1, 0});
  EXPECT_NO_THROW((void)batch.jpeg(0, 0, 90));
  EXPECT_REFUSED((void)batch.jpeg(0, 1, 90), message);
}

TEST(CameraJpeg, OfEitherLayoutIsTheSame) {
  CameraConfig camera{.width_px = 33, .height_px = 17};
  const std::string last = testing::look(gallery(), camera, {0, 0, 0})->jpeg(0, 0, 90);
  camera.layout = ImageLayout::chw;
  EXPECT_EQ(testing::look(gallery(), camera, {0, 0, 0})->jpeg(0, 0, 90), last);
}

// -- Snapshots.

NavigationBatch two_cameras(CaptureMode mode) {
  NavigationBatch config = flying(AutoresetMode::same_step, mode);
  config.cameras[0].outputs = kAllOutputs;
  config.cameras.push_back({.name = "other",
                            .width_px = 17,
                            .height_px = 5,
                            .vfov_deg = 40.0F,
                            .outputs = {.rgb = true, .depth = true},
                            .layout = ImageLayout::chw,
                            .capture_mode = CaptureMode::on_demand,
                            .samples_per_pixel = 4,
                            .shadows = true});
  return config;
}

// Compares the valid frames bit for bit, and which frames are valid.
::testing::AssertionResult same_frames(const Batch& a, const Batch& b) {
  for (std::size_t camera = 0; camera < a.config().cameras.size(); ++camera) {
    const CameraImages& x = a.images(camera);
    const CameraImages& y = b.images(camera);
    const CameraConfig& config = a.camera_config(camera);
    if (config.capture_mode != b.camera_config(camera).capture_mode) return ::testing::AssertionFailure() << "another mode";
    if (x.frame_step != y.frame_step) return ::testing::AssertionFailure() << "camera " << camera << ": other ages";
    const auto pixels = static_cast<std::size_t>(config.width_px * config.height_px);
    for (std::size_t i = 0; i < x.frame_step.size(); ++i) {
      const CameraConfig mine = a.camera_config(camera, static_cast<std::int64_t>(i));
      const CameraConfig other = b.camera_config(camera, static_cast<std::int64_t>(i));
      if (mine.hfov_deg != other.hfov_deg || mine.vfov_deg != other.vfov_deg || mine.offset_m != other.offset_m ||
          mine.quat_wxyz != other.quat_wxyz || mine.capture_mode != other.capture_mode) {
        return ::testing::AssertionFailure() << "camera " << camera << " of drone " << i << " is set otherwise";
      }
      if (x.frame_step[i] < 0) continue;
      const auto same = [&](const auto& p, const auto& q, std::size_t values) {
        return p.size() == q.size() && (p.empty() || same_bits(row(p, i, values * pixels), row(q, i, values * pixels)));
      };
      if (!same(x.rgb, y.rgb, 3) || !same(x.depth, y.depth, 1) || !same(x.semantic, y.semantic, 1) ||
          !same(x.instance, y.instance, 1) || !same(x.normal, y.normal, 3) || !same(x.grey, y.grey, 1)) {
        return ::testing::AssertionFailure() << "camera " << camera << ": the frame of drone " << i << " differs";
      }
    }
  }
  return ::testing::AssertionSuccess();
}

TEST(CameraSnapshot, RestoredIsUninterrupted) {
  const Batch::Worlds worlds{testing::closet(), smaller_closet()};
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement, CaptureMode::on_demand}) {
    SCOPED_TRACE(static_cast<int>(mode));
    Batch one = two_cameras(mode).make(worlds);
    Random random(9);
    const auto fly = [&](const std::vector<Batch*>& batches, int steps) {
      for (int i = 0; i < steps; ++i) {
        const std::vector<float> actions = random_actions(random);
        Flags some(kEnvs);
        for (auto& flag : some) flag = random.generator()() % 4 == 0;
        for (Batch* batch : batches) {
          batch->step(std::span<const float>(actions));
          batch->capture(1, some);
        }
      }
    };
    one.reset({});
    fly({&one}, 20);
    one.capture(0);
    one.set_camera(0, {.hfov_deg = 50.0F, .offset_m = {{0.1F, 0, 0.05F}}}, Flags{0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0});
    one.set_camera(1, {.vfov_deg = 60.0F, .quat_wxyz = {{0.6F, 0, 0.8F, 0}}}, Flags{0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    one.remove(std::vector<std::int64_t>{5});
    fly({&one}, 3);
    one.set_camera(0, {.hfov_deg = 100.0F}, Flags{0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0});  // stale
    one.set_capture_mode(1, CaptureMode::on_movement);
    std::vector<std::int32_t> swapped(one.state().world_index);
    swapped[7] = 1 - swapped[7];
    one.set_world(swapped);  // the frame still shows its old world
    const std::string blob = one.snapshot();

    NavigationBatch config = two_cameras(mode);
    config.num_threads = 2;
    config.block_size = 5;
    Batch fresh = config.make(worlds);
    Batch lived = config.make(worlds);
    lived.reset({});
    lived.set_camera(0, {.hfov_deg = 33.0F});
    lived.set_capture_mode(0, CaptureMode::on_demand);
    lived.remove(std::vector<std::int64_t>{1, 5});
    for (Batch* batch : {&fresh, &lived}) {
      batch->restore(blob);
      EXPECT_TRUE(same_frames(one, *batch));
      EXPECT_TRUE(batch->snapshot() == blob);
      // A removed drone has an empty frame, no matter what was there before.
      for (const float depth : row(batch->images(0).depth, 5, 63)) EXPECT_EQ(depth, kInfinity);
    }
    const auto counting =
        std::count_if(frame_step(one, 1).begin(), frame_step(one, 1).end(), [](auto step) { return step >= 0; });
    EXPECT_GT(counting, 2);
    EXPECT_LT(counting, static_cast<std::ptrdiff_t>(kEnvs) - 1);
    for (int i = 0; i < 40; ++i) {
      fly({&one, &fresh, &lived}, 1);
      ASSERT_TRUE(same_frames(one, fresh)) << i;
      ASSERT_TRUE(same_frames(one, lived)) << i;
      ASSERT_TRUE(testing::same_drones(one, fresh)) << i;
    }
  }
}

TEST(CameraSnapshot, RestoresItsMode) {
  Batch batch(probes(1, CaptureMode::every_step), {halls()[0]});
  batch.set_capture_mode(0, CaptureMode::on_movement);
  const std::string blob = batch.snapshot();
  batch.set_capture_mode(0, CaptureMode::on_demand);
  batch.restore(blob);
  EXPECT_EQ(batch.camera_config(0, 0).capture_mode, CaptureMode::on_movement);
  EXPECT_EQ(batch.camera_config(0).capture_mode, CaptureMode::on_movement);
  // The capture mode is not part of the configuration that a snapshot must match.
  Batch other(probes(1, CaptureMode::on_demand), {halls()[0]});
  other.restore(blob);
  EXPECT_EQ(other.camera_config(0).capture_mode, CaptureMode::on_movement);
}

TEST(CameraSnapshot, OfAnotherCameraIsRefused) {
  const std::vector<std::function<void(NavigationBatch&)>> changes{
      [](NavigationBatch& c) { c.cameras.pop_back(); },
      [](NavigationBatch& c) { std::swap(c.cameras[0], c.cameras[1]); },
      [](NavigationBatch& c) { c.cameras[0].name = "face"; },
      [](NavigationBatch& c) { c.cameras[0].width_px = 7, c.cameras[0].height_px = 9; },
      [](NavigationBatch& c) { c.cameras[0].hfov_deg = 91.0F; },
      [](NavigationBatch& c) { c.cameras[1].vfov_deg = 41.0F; },
      [](NavigationBatch& c) { c.cameras[0].vfov_deg = 60.0F, c.cameras[0].hfov_deg = 90.0F; },
      [](NavigationBatch& c) { c.cameras[0].offset_m[2] = 0.1F; },
      [](NavigationBatch& c) { c.cameras[0].quat_wxyz = {0, 1, 0, 0}; },
      [](NavigationBatch& c) { c.cameras[0].near_m = 0.06F; },
      [](NavigationBatch& c) { c.cameras[0].far_m = 99.0F; },
      [](NavigationBatch& c) { c.cameras[0].outputs.grey = false; },
      [](NavigationBatch& c) { c.cameras[1].outputs.normal = true; },
      [](NavigationBatch& c) { c.cameras[0].depth_kind = DepthKind::range; },
      [](NavigationBatch& c) { c.cameras[0].layout = ImageLayout::chw; },
      [](NavigationBatch& c) { c.cameras[0].samples_per_pixel = 9; },
      [](NavigationBatch& c) { c.cameras[0].shadows = true; },
      [](NavigationBatch& c) { c.cameras[0].rate_hz = 5.0F; },
  };
  const Batch::Worlds worlds{testing::closet()};
  Batch batch = two_cameras(CaptureMode::every_step).make(worlds);
  batch.reset({});
  const std::string before = batch.snapshot();
  for (std::size_t i = 0; i < changes.size(); ++i) {
    SCOPED_TRACE("change " + std::to_string(i));
    NavigationBatch config = two_cameras(CaptureMode::every_step);
    changes[i](config);
    EXPECT_REFUSED(batch.restore(config.make(worlds).snapshot()), "snapshot");
    EXPECT_TRUE(batch.snapshot() == before);
  }
  EXPECT_NO_THROW(batch.restore(two_cameras(CaptureMode::every_step).make(worlds).snapshot()));
}

// Without a task, the camera data is the end of a snapshot: the mode, settings of 40 bytes per drone, and seven arrays with
// the place and time of the frames. Each is preceded by its length.
TEST(CameraSnapshot, DamagedOnesAreRefusedAndChangeNothing) {
  constexpr std::size_t kDrones = 3;
  Batch batch(probes(kDrones, CaptureMode::every_step), halls());
  put(batch, {1, 2, 3});
  batch.sense();
  const std::string blob = batch.snapshot();
  const std::size_t steps = blob.size() - 8 * kDrones;
  const std::size_t drones = steps - 8 - 8 * kDrones;
  const std::size_t bodies = drones - 8 - 8 * kDrones;
  const std::size_t ticks = bodies - 8 - 8 * kDrones;
  const std::size_t worlds = ticks - 8 - 4 * kDrones;
  const std::size_t positions = worlds - 8 - 16 * kDrones - 8 - 12 * kDrones;
  const std::size_t settings = positions - 8 - 40 * kDrones;
  const std::size_t mode = settings - 8 - 1;
  const auto expect_refused = [&](std::size_t at, const auto& value, const std::string& field) {
    std::string damaged = blob;
    std::memcpy(damaged.data() + at, &value, sizeof(value));
    EXPECT_REFUSED(batch.restore(damaged), "bytes that match their checksum");
    EXPECT_REFUSED(batch.restore(testing::mended(damaged)), field);
    EXPECT_TRUE(batch.snapshot() == blob) << "a refused blob changed the batch";
  };
  float x = 0.0F;
  std::memcpy(&x, blob.data() + positions + 12, sizeof(x));
  ASSERT_EQ(x, 2.0F) << "the layout is another than this test knows";
  ASSERT_EQ(blob[mode], 0);
  expect_refused(worlds + 4, std::int32_t{2}, "snapshot: expected world indices below 2");
  expect_refused(worlds + 8, std::int32_t{-1}, "snapshot: expected world indices below 2");
  expect_refused(mode, std::uint8_t{3}, "snapshot: expected a capture mode");
  expect_refused(settings, 200.0F, "camera.hfov_deg");
  expect_refused(settings + 40 + 12, kInfinity, "camera.offset_m");
  for (const std::size_t length : {steps, ticks, worlds, settings, mode}) {
    EXPECT_REFUSED(batch.restore(blob.substr(0, length)), "snapshot");
    EXPECT_REFUSED(batch.restore(testing::mended(blob.substr(0, length))), "snapshot");
    EXPECT_TRUE(batch.snapshot() == blob);
  }
  batch.restore(blob);
  EXPECT_EQ(shown(batch)[0], 1.0F);
}

}  // namespace
}  // namespace flockstep
