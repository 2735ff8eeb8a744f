// Cameras in a batch: capture times and their content, changes at run time, snapshots, files, bad input.
#include "sensors/captures.hpp"

namespace flockstep {
namespace {

using namespace captures;

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
  batch.camera(0).capture(Flags{0, 1, 0});
  EXPECT_EQ(shown(batch), (std::vector<float>{kInfinity, 2, kInfinity}));
  EXPECT_EQ(frame_step(batch), (Steps{-1, 1, -1})) << "the step of the last sense";
  put(batch, {4, 5, 6});
  batch.sense();
  EXPECT_EQ(shown(batch), (std::vector<float>{kInfinity, 2, kInfinity}));
  EXPECT_EQ(frame_step(batch), (Steps{-1, 1, -1})) << "it shows that step still";
  batch.camera(0).capture();
  EXPECT_EQ(shown(batch), (std::vector<float>{4, 5, 6}));
  EXPECT_EQ(frame_step(batch), (Steps{2, 2, 2}));
  batch.begin_episode(Flags{0, 0, 1});
  EXPECT_EQ(frame_step(batch), (Steps{2, 2, -1}));
  batch.camera(0).capture(Flags{0, 0, 1});
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
    batch.camera(0).capture();
    EXPECT_EQ(shown(batch), (std::vector<float>{3, 2}));
    EXPECT_EQ(frame_step(batch), (Steps{1, 1}));
  }
}

TEST(Capture, TheModeChangesAtRunTime) {
  Batch batch(probes(1, CaptureMode::every_step), {halls()[0]});
  put(batch, {1});
  batch.sense();
  batch.camera(0).set_capture_mode(CaptureMode::on_demand);
  EXPECT_EQ(batch.camera(0).config().capture_mode, CaptureMode::on_demand);
  EXPECT_EQ(batch.camera(0).config(DroneIndex(0)).capture_mode, CaptureMode::on_demand);
  put(batch, {2});
  batch.sense();
  EXPECT_EQ(shown(batch)[0], 1.0F);
  batch.camera(0).set_capture_mode(CaptureMode::on_movement);
  EXPECT_EQ(shown(batch)[0], 1.0F);
  batch.sense();
  EXPECT_EQ(shown(batch)[0], 2.0F) << "it moved since its frame was taken";
  EXPECT_EQ(frame_step(batch), (Steps{2}));
  batch.sense();
  EXPECT_EQ(frame_step(batch), (Steps{2}));
  batch.camera(0).set_capture_mode(CaptureMode::every_step);
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
    batch.camera(0).capture();
    const CameraImages before = batch.camera(0).images();
    ASSERT_EQ(before.instance, std::vector<std::uint16_t>(45, 1));
    batch.remove(std::vector<std::int64_t>{1});
    for (int time = 0; time < 3; ++time) {  // immediately, after a scan, after a capture
      const CameraImages& images = batch.camera(0).images();
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
      if (time == 1) batch.camera(0).capture();
    }
    batch.spawn(std::vector<std::int64_t>{1}, std::vector<float>{4, 0, 0}, {}, std::vector<std::int32_t>{1});
    const bool at_once = mode != CaptureMode::on_demand;
    EXPECT_EQ(frame_step(batch)[1], at_once ? 0 : -1);
    EXPECT_EQ(batch.camera(0).images().depth[22], at_once ? 2 * kWall - 4 : kInfinity);
    EXPECT_EQ(frame_step(batch)[0], 1) << "no other drone is sensed";
    batch.camera(0).capture(Flags{0, 1, 0});
    EXPECT_EQ(frame_step(batch)[1], 0);
    EXPECT_EQ(batch.camera(0).images().depth[22], 2 * kWall - 4);
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
  EXPECT_EQ(batch.camera("front").index(), 0U);
  EXPECT_EQ(batch.camera("down").index(), 1U);
  EXPECT_REFUSED((void)batch.camera("").index(), R"(camera: ... "front" ... "down")");
  EXPECT_EQ(Batch(probes(1, CaptureMode::every_step), halls()).camera("").index(), 0U) << "the only one needs no name";
  EXPECT_EQ(batch.camera(1).images().depth.size(), 2U * 33U * 9U);
  EXPECT_TRUE(batch.camera(0).images().semantic.empty());
  put(batch, {1, 2});
  batch.sense();
  EXPECT_EQ(frame_step(batch, 0), (Steps{0, 0}));
  EXPECT_EQ(frame_step(batch, 1), (Steps{-1, -1}));
  smear(batch);
  put(batch, {3, 4});
  batch.camera(1).capture();
  EXPECT_TRUE(is_smeared(batch, 0));
  EXPECT_EQ(batch.camera(1).images().depth[0], kWall + 3);
  EXPECT_EQ(batch.camera(1).images().depth[33 * 9], kWall + 4);
  EXPECT_EQ(frame_step(batch, 1), (Steps{0, 0}));
  batch.camera(1).set_capture_mode(CaptureMode::every_step);
  batch.camera(0).set_capture_mode(CaptureMode::on_demand);
  put(batch, {5, 6});
  batch.sense();
  EXPECT_TRUE(is_smeared(batch, 0));
  EXPECT_EQ(batch.camera(1).images().depth[0], kWall + 5);
  for (std::size_t drone = 0; drone < 2; ++drone) EXPECT_EQ(expect_picture(batch, drone, 1).clear, 33U * 9U);
}

bool same_frame(const Batch& a, const Batch& b, std::size_t drone) {
  return same_bits(row(a.camera(0).images().rgb, drone, 3 * 63), row(b.camera(0).images().rgb, drone, 3 * 63)) &&
         same_bits(row(a.camera(0).images().depth, drone, 63), row(b.camera(0).images().depth, drone, 63));
}

TEST(CaptureTask, FramesAreAsOldAsTheirModeAllows) {
  for (const AutoresetMode autoreset : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    SCOPED_TRACE(static_cast<int>(autoreset));
    const Batch::Worlds worlds{closet(), smaller_closet()};
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
      truth.camera(0).capture();
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
          ASSERT_TRUE(same_bits(row(demand.camera(0).images().depth, i, 63), kept[i]));
        }
      }
      last_position = state.position;
      last_episode = state.episode;
      if (step % 4 != 1) continue;
      Flags some(kEnvs);
      for (std::size_t i = 0; i < kEnvs; ++i) some[i] = random.generator()() % 2;
      demand.camera(0).capture(some);
      for (std::size_t i = 0; i < kEnvs; ++i) {
        if (!some[i]) continue;
        demanded[i] = state.sensed[i];
        ASSERT_EQ(frame_step(demand)[i], demanded[i]);
        ASSERT_TRUE(same_frame(demand, truth, i));
        const auto depths = row(demand.camera(0).images().depth, i, 63);
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
    const Batch::Worlds worlds{closet(), smaller_closet()};
    Batch with = flying(autoreset, CaptureMode::every_step).make(worlds);
    NavigationBatch blind = flying(autoreset, CaptureMode::every_step);
    blind.cameras.clear();
    Batch without = blind.make(worlds);
    Random random(8);
    with.reset({});
    without.reset({});
    for (int step = 0; step < 60; ++step) {
      ASSERT_TRUE(same_drones(with, without)) << step;
      const std::vector<float> actions = random_actions(random);
      with.step(std::span<const float>(actions));
      without.step(std::span<const float>(actions));
    }
  }
}

// The hundred warm-up steps wake the second thread, unless others keep the processors busy: then it allocates what it works with
// in a later round. oneTBB allocates its tasks from its own pools, so this counts the engine's allocations.
void expect_no_allocation(int num_threads) {
  NavigationBatch config = navigation_batch(32);
  config.num_threads = num_threads;
  config.block_size = 4;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.max_episode_steps = 50;
  config.episode.stagger_first_episode = true;
  config.episode.random_world = true;
  config.cameras = {
      {.name = "a", .width_px = 17, .height_px = 9, .outputs = kAllOutputs, .samples_per_pixel = 4, .shadows = true},
      {.name = "b", .width_px = 16, .height_px = 16, .layout = ImageLayout::chw, .capture_mode = CaptureMode::on_movement},
      {.name = "c", .width_px = 8, .height_px = 8, .capture_mode = CaptureMode::on_demand},
      {.name = "d", .width_px = 17, .height_px = 9, .samples_per_pixel = 4, .adaptive_samples = true}};
  SceneDescription with_mesh;
  with_mesh.primitives = {primitive(PrimitiveKind::room, {7, 7, 2}, {7, 7, 2})};
  with_mesh.mesh.vertices = {{3, 3, 1}, {4, 3, 1}, {3, 4, 2}};
  with_mesh.mesh.triangles = {{0, 1, 2}};
  with_mesh.markers = {.start = Vec3(7, 7, 2), .goal = Vec3(10, 10, 2)};
  Batch batch = config.make({playground("train-1"), std::make_shared<const World>(with_mesh)});
  batch.reset({});
  Random random(3);
  std::vector<std::int64_t> actions(32);
  const auto step = [&] {
    for (std::int64_t& action : actions) action = random.generator()() % 6;
    batch.step(std::span<const std::int64_t>(actions));
    batch.camera(2).capture();
  };
  for (int i = 0; i < 100; ++i) step();
  std::uint64_t allocated = 1;
  for (int round = 0; round < (num_threads == 1 ? 1 : 20) && allocated > 0; ++round) {
    int ends = 0;
    const std::uint64_t before = allocations();
    for (int i = 0; i < 100; ++i) {
      step();
      ends += std::accumulate(batch.outputs().truncated.begin(), batch.outputs().truncated.end(), 0);
    }
    allocated = allocations() - before;
    EXPECT_GT(ends, 10);
  }
  EXPECT_EQ(allocated, 0U);
}

TEST(CaptureTask, AStepAllocatesNothing) { expect_no_allocation(1); }
TEST(CaptureTask, AStepOnTwoThreadsAllocatesNothing) { expect_no_allocation(2); }

}  // namespace
}  // namespace flockstep
