// Navigation tasks that observe a camera, and frame skip.

#include "allocation_counter.hpp"
#include "episodes.hpp"
#include "tasks/color_blob.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kRays = 20;

// A white room, large enough to see the goal for several steps, and small enough that flights soon end in every possible way.
std::shared_ptr<const World> parlour(float pillar_y) {
  SceneDescription description;
  description.materials = {{"white", {0.9F, 0.9F, 0.9F}}, {"pillar", {0.35F, 0.45F, 0.6F}}};
  description.primitives = {primitive(PrimitiveKind::room, {2.5F, 2, 1}, {2.5F, 2, 1}),
                            primitive(PrimitiveKind::cylinder, {2.5F, pillar_y, 1}, {0.125F, 0.125F, 1})};
  description.primitives[1].material = 1;
  description.markers = {.start = Vec3(1, 2, 1),
                         .goal = Vec3(3.5F, 2.25F, 1),
                         .spawn_box = Aabb{.min = Vec3(0.75F, 1.75F, 0.875F), .max = Vec3(1.25F, 2.25F, 1.125F)}};
  return std::make_shared<const World>(std::move(description));
}

Batch::Worlds parlours() {
  static const Batch::Worlds worlds{parlour(0.75F), parlour(3.25F), playground("camera-train-1")};
  return worlds;
}

NavigationBatch camera_batch(int num_envs, ObservationKind observation, AutoresetMode mode = AutoresetMode::same_step) {
  NavigationBatch config = navigation_batch(num_envs, {.beams = kRays, .hfov_deg = 180.0F});
  CameraConfig camera{.width_px = 32, .height_px = 24, .layout = ImageLayout::chw};
  config.cameras = {camera};
  config.navigation.action = ActionKind::discrete_forward;
  config.navigation.observation = observation;
  config.episode.max_episode_steps = 40;
  config.navigation.random_start = true;
  config.episode.stagger_first_episode = true;
  config.navigation.reward.overshoot_weight = 1.0F;
  config.episode.autoreset_mode = mode;
  return config;
}

constexpr std::size_t kImage = 3 * 32 * 24;
constexpr ObservationKind kKinds[] = {ObservationKind::blob, ObservationKind::pixels};

// Mainly forward, with more left than right turns, so that drones reach goals, overshoot and hit walls.
std::vector<std::int64_t> actions_of(Random& random, std::size_t count) {
  std::vector<std::int64_t> actions(count);
  for (auto& action : actions) {
    const auto number = random.generator()() % 10;
    action = number < 5 ? 0 : number < 8 ? 1 : 2;
  }
  return actions;
}

void fly(Batch& batch, Random& random, int steps) {
  for (int step = 0; step < steps; ++step) batch.step(actions_of(random, batch.state().active.size()));
}

bool same_observations(const Batch& a, const Batch& b) {
  const auto same = [](const Buffer& x, const Buffer& y) { return x.bytes() == y.bytes(); };
  const auto& x = a.outputs().observation;
  const auto& y = b.outputs().observation;
  return std::equal(x.begin(), x.end(), y.begin(), y.end(), same);
}

// -- Actions and observations.

TEST(CameraNavigation, ForwardActionsAreThree) {
  NavigationBatch config = camera_batch(1, ObservationKind::blob);
  config.navigation.random_start = false;
  Batch batch = config.make({playground("camera-train-1")});
  batch.reset({});
  const Vec3 start(batch.state().position.data());
  const Vec3 along[] = {{0.1F, 0, 0}, {0, 0.1F, 0}, {0, -0.1F, 0}};
  for (std::int64_t action = 0; action < 3; ++action) {
    batch.reset({});
    batch.step(std::span<const std::int64_t>(&action, 1));
    EXPECT_LT((Vec3(batch.state().position.data()) - start - along[action]).norm(), 1e-6F) << action;
  }
  for (const std::int64_t action : {std::int64_t{3}, std::int64_t{-1}}) {
    EXPECT_REFUSED(batch.step(std::span<const std::int64_t>(&action, 1)), "[0, 3)");
  }
  EXPECT_REFUSED(batch.step(std::vector<float>{0.0F}), "actions");
}

TEST(CameraNavigation, BlobAndRangesAreObserved) {
  for (const ImageLayout layout : {ImageLayout::hwc, ImageLayout::chw}) {
    NavigationBatch config = camera_batch(6, ObservationKind::blob);
    config.cameras[0].layout = layout;
    Batch batch = config.make(parlours());
    ASSERT_EQ(batch.outputs().observation.size(), 1U);
    EXPECT_EQ(batch.outputs().observation[0].columns(), 22U);
    batch.reset({});
    Random random(1);
    int seen = 0;
    task::ColorBlobScratch scratch;
    for (int step = 0; step < 60; ++step) {
      fly(batch, random, 1);
      for (std::size_t i = 0; i < 6; ++i) {
        const auto observation = batch.outputs().observation[0].row<float>(i);
        const auto blob = task::find_color(row(batch.camera(0).images().rgb, i, kImage), 32, 24, layout, ColorRange(), scratch);
        EXPECT_EQ(observation[0], blob.offset);
        EXPECT_EQ(observation[1], blob.area);
        seen += blob.found;
        for (std::size_t k = 0; k < kRays; ++k) {
          EXPECT_FLOAT_EQ(observation[2 + k], std::min(batch.lidar().readings().ranges[i * kRays + k] / 3.0F, 1.0F));
        }
      }
    }
    EXPECT_GT(seen, 100);
  }
}

TEST(CameraNavigation, TheBlobIsAtTheGoal) {
  NavigationBatch config = camera_batch(1, ObservationKind::blob);
  config.cameras[0].width_px = 640;
  config.cameras[0].height_px = 480;
  config.navigation.random_start = false;
  for (const float aside : {-4.0F, -1.5F, 0.0F, 2.0F, 4.0F}) {
    const Vec3 offset(8, aside, 0);
    const Vec3 start(2, 5, 2);
    Batch batch = config.make(
        {make_world({primitive(PrimitiveKind::room, {6, 5, 2}, {6, 5, 2})}, {.start = start, .goal = Vec3(start + offset)})});
    batch.reset({});
    // Left is +y in the world and negative in the image, which is 90 degrees wide.
    EXPECT_NEAR(batch.outputs().observation[0].row<float>(0)[0], -offset.y() / offset.x(), 0.005) << aside;
    // Off the centre, a sphere is stretched away from the centre.
    const float height = 2.0F * 0.25F / offset.x() * 320.0F;  // px
    const float width = height * offset.norm() / offset.x();
    EXPECT_NEAR(batch.outputs().observation[0].row<float>(0)[1] * 640.0F * 480.0F, width * height, 2.0F * (width + height))
        << aside;
  }
}

TEST(CameraNavigation, PixelsAreTheCamerasImage) {
  Batch batch = camera_batch(6, ObservationKind::pixels).make(parlours());
  const auto& fields = batch.task()->spec().observation;
  ASSERT_EQ(fields.size(), 2U);
  EXPECT_EQ(fields[0].name, "image");
  EXPECT_EQ(fields[0].type, DType::uint8);
  EXPECT_EQ(fields[0].shape, (std::vector<std::int64_t>{3, 24, 32}));
  EXPECT_EQ(fields[1].name, "ranges");
  EXPECT_EQ(fields[1].shape, (std::vector<std::int64_t>{kRays}));
  const auto image = [&]() -> const AlignedVector<std::byte>& { return batch.outputs().observation[0].bytes(); };
  const auto rgb = [&] { return std::as_bytes(std::span(batch.camera(0).images().rgb)); };
  batch.reset({});
  EXPECT_TRUE(same_bits(image(), rgb()));
  Random random(1);
  for (int step = 0; step < 60; ++step) {
    const AlignedVector<std::byte> previous = image();
    const std::byte* const there = image().data();
    fly(batch, random, 1);
    EXPECT_TRUE(same_bits(image(), rgb()));
    EXPECT_TRUE(same_bits(previous, std::span(there, previous.size()))) << "the previous images were written";
    const std::vector<float> ranges = values_of(batch.outputs().observation[1]);
    for (std::size_t k = 0; k < 6 * kRays; ++k)
      EXPECT_FLOAT_EQ(ranges[k], std::min(batch.lidar().readings().ranges[k] / 3.0F, 1.0F));
  }
}

TEST(CameraNavigation, TheLastImageOfAnEpisodeIsKeptBesideTheResetsOne) {
  // In the mode `disabled` nothing is reset, so the final state stays visible.
  for (const ObservationKind kind : kKinds) {
    constexpr std::size_t kDrones = 12;
    Batch kept = camera_batch(kDrones, kind, AutoresetMode::disabled).make(parlours());
    Batch batch = camera_batch(kDrones, kind).make(parlours());
    Batch next = camera_batch(kDrones, kind).make(parlours());
    for (Batch* each : {&kept, &batch, &next}) each->reset(seeds_from(3, kDrones));
    next.reset({});  // advances to the second episodes
    Random random(2);
    std::size_t ended = 0;
    std::vector<std::uint8_t> over(kDrones, 0);
    for (int step = 0; step < 60; ++step) {
      const std::vector<std::int64_t> actions = actions_of(random, kDrones);
      for (Batch* each : {&kept, &batch}) each->step(actions);
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (over[i] || !(batch.outputs().terminated[i] || batch.outputs().truncated[i])) continue;
        over[i] = 1;
        ++ended;
        EXPECT_TRUE(row_of(batch.outputs().final_observation, i) == row_of(kept.outputs().observation, i));
        EXPECT_TRUE(row_of(batch.outputs().observation, i) == row_of(next.outputs().observation, i));
      }
    }
    EXPECT_EQ(ended, kDrones);
  }
}

// -- The same bits with any neighbours.

TEST(CameraNavigation, AnEnvOfManyEqualsASingleEnv) {
  for (const ObservationKind kind : kKinds) {
    for (const AutoresetMode mode : kAutoresetModes) {
      for (const int frame_skip : {1, 3}) {
        SCOPED_TRACE("observation " + std::to_string(static_cast<int>(kind)) + ", mode " +
                     std::to_string(static_cast<int>(mode)) + ", frame skip " + std::to_string(frame_skip));
        NavigationBatch config = camera_batch(11, kind, mode);
        config.episode.random_world = true;
        config.episode.frame_skip = frame_skip;
        const auto own = [](std::size_t) { return parlours(); };
        expect_many_equal_single(config, parlours(), own, 80, [](Random& random) { return actions_of(random, 11); });
      }
    }
  }
}

TEST(CameraNavigation, ModesAgreeExceptInResetRows) {
  for (const ObservationKind kind : kKinds) {
    NavigationBatch config = camera_batch(8, kind);
    config.episode.frame_skip = 2;
    const auto action_of = [](std::uint64_t number) { return number % 5 < 3 ? 0 : number % 5 == 3 ? 1 : 2; };
    expect_modes_agree(config, parlours(), 80, action_of, 76, 0);
  }
}

TEST(CameraNavigation, ASnapshotBringsTheImagesBack) {
  for (const ObservationKind kind : kKinds) {
    Batch batch = camera_batch(6, kind).make(parlours());
    batch.reset({});
    Random random(3);
    for (int step = 0; step < 5; ++step) batch.step(std::vector<std::int64_t>(6, 0));
    const std::string blob = batch.snapshot();
    Batch other = camera_batch(6, kind).make(parlours());
    other.restore(blob);
    EXPECT_TRUE(same_drones(batch, other));
    for (int step = 0; step < 30; ++step) {
      const std::vector<std::int64_t> actions = actions_of(random, 6);
      for (Batch* each : {&batch, &other}) each->step(actions);
      ASSERT_TRUE(same_drones(batch, other)) << step;
    }
  }
}

// -- Frame skip.

TEST(FrameSkip, IsThatManyStepsOfTheSameAction) {
  constexpr std::size_t kDrones = 24;
  for (const ObservationKind kind : {ObservationKind::goal, ObservationKind::blob, ObservationKind::pixels}) {
    SCOPED_TRACE(static_cast<int>(kind));
    NavigationBatch config = camera_batch(kDrones, kind, AutoresetMode::disabled);
    config.pose_sensor = {.position_noise_std_m = 0.01F, .orientation_noise_std_deg = 0.5F};
    Batch single = config.make(parlours());
    config.episode.frame_skip = 3;
    Batch skipping = config.make(parlours());
    for (Batch* each : {&single, &skipping}) each->reset(seeds_from(9, kDrones));
    Random random(4);
    int cut_short = 0;
    for (int step = 0; step < 30; ++step) {
      const std::vector<std::int64_t> actions = actions_of(random, kDrones);
      std::vector<double> reward(kDrones, 0.0);
      std::vector<double> terms(single.outputs().reward_terms.size(), 0.0);
      for (int k = 0; k < 3; ++k) {
        const AlignedVector<std::int64_t> before = single.outputs().episode_length;
        single.step(actions);
        for (std::size_t i = 0; i < kDrones; ++i) {
          reward[i] += static_cast<double>(single.outputs().reward[i]);
          const bool over = single.outputs().terminated[i] || single.outputs().truncated[i];
          cut_short += k < 2 && over && single.outputs().episode_length[i] > before[i];
        }
        for (std::size_t j = 0; j < terms.size(); ++j) terms[j] += static_cast<double>(single.outputs().reward_terms[j]);
      }
      skipping.step(actions);
      const Outputs& a = skipping.outputs();
      const Outputs& b = single.outputs();
      EXPECT_TRUE(same_observations(skipping, single)) << step;
      EXPECT_EQ(a.terminated, b.terminated);
      EXPECT_EQ(a.truncated, b.truncated);
      EXPECT_EQ(a.success, b.success);
      EXPECT_EQ(a.crashed, b.crashed);
      EXPECT_EQ(a.episode_length, b.episode_length);
      EXPECT_EQ(a.episode_return, b.episode_return);
      EXPECT_EQ(skipping.state().position, single.state().position);
      EXPECT_EQ(skipping.state().sensed, single.state().sensed);
      EXPECT_EQ(skipping.camera(0).images().frame_step, single.camera(0).images().frame_step);
      for (std::size_t i = 0; i < kDrones; ++i) EXPECT_NEAR(a.reward[i], reward[i], 1e-6 * std::max(1.0, std::abs(reward[i])));
      for (std::size_t j = 0; j < terms.size(); ++j) {
        EXPECT_NEAR(a.reward_terms[j], terms[j], 1e-6 * std::max(1.0, std::abs(terms[j])));
      }
    }
    EXPECT_GT(cut_short, 3);
  }
}

TEST(FrameSkip, CountsFlownStepsTowardsTheLimit) {
  NavigationBatch config = camera_batch(1, ObservationKind::goal, AutoresetMode::disabled);
  config.navigation.random_start = config.episode.stagger_first_episode = false;
  config.episode.frame_skip = 4;
  config.episode.max_episode_steps = 10;
  Batch batch = config.make({playground("camera-train-1")});
  batch.reset({});
  const std::int64_t action = 1;
  for (const std::int64_t length : {4, 8, 10}) {
    EXPECT_FALSE(batch.outputs().truncated[0]);
    batch.step(std::span<const std::int64_t>(&action, 1));
    EXPECT_EQ(batch.outputs().episode_length[0], length);
  }
  EXPECT_TRUE(batch.outputs().truncated[0]);
}

TEST(FrameSkip, OnlyTheFirstOfAnActionIsAChange) {
  NavigationBatch config = camera_batch(1, ObservationKind::goal, AutoresetMode::disabled);
  config.navigation.random_start = false;
  config.episode.frame_skip = 4;
  Batch batch = config.make({playground("camera-train-1")});
  batch.reset({});
  const std::pair<std::int64_t, float> flights[] = {{1, -1.0F}, {1, 0.0F}, {2, -1.0F}};
  for (const auto& [action, change] : flights) {
    batch.step(std::span<const std::int64_t>(&action, 1));
    EXPECT_EQ(batch.outputs().reward_terms[4], change);
  }
}

// -- Memory.

std::uint64_t allocations_of_steps(Batch& batch, Random& random) {
  std::vector<std::vector<std::int64_t>> steps;
  for (int step = 0; step < 40; ++step) steps.push_back(actions_of(random, batch.state().active.size()));
  const std::uint64_t before = allocations();
  for (const std::vector<std::int64_t>& actions : steps) batch.step(actions);
  return allocations() - before;
}

TEST(CameraNavigation, AStepAllocatesNothing) {
  for (const ObservationKind kind : kKinds) {
    for (const AutoresetMode mode : kAutoresetModes) {
      NavigationBatch config = camera_batch(24, kind, mode);
      config.episode.frame_skip = 2;
      Batch batch = config.make(parlours());
      batch.reset({});
      Random random(5);
      fly(batch, random, 40);
      EXPECT_EQ(allocations_of_steps(batch, random), 0U);
    }
  }
}

TEST(CameraNavigation, AStepWithConvertedImagesAllocatesNothingAndHasTheSameBitsOnAnyThreads) {
  for (const ImageLayout layout : {ImageLayout::hwc, ImageLayout::chw}) {
    std::vector<std::vector<float>> observed;
    std::vector<CameraImages> images;
    for (const int threads : {1, 3}) {
      NavigationBatch config = camera_batch(24, ObservationKind::blob);
      CameraConfig& camera = config.cameras[0];
      camera.layout = layout;
      camera.outputs = {.rgb = true, .depth = true, .grey = true, .hsv = true};
      camera.resize = {20, 18};
      camera.pool = Pool::max;
      config.cameras.push_back({.name = "belly", .width_px = 16, .height_px = 12, .outputs = {.rgb = false, .hsv = true}});
      config.navigation.color = {ColorSpace::hsv, {50, 60, 20}, {70, 255, 255}};
      config.num_threads = threads;
      Batch batch = config.make(parlours());
      batch.reset({});
      Random random(5);
      fly(batch, random, 40);
      EXPECT_EQ(allocations_of_steps(batch, random), 0U) << threads;
      observed.emplace_back();
      for (int step = 0; step < 40; ++step) {
        fly(batch, random, 1);
        const auto row = batch.outputs().observation[0].row<float>(7);
        observed.back().insert(observed.back().end(), row.begin(), row.end());
      }
      images.push_back(batch.camera(0).images());
      EXPECT_EQ(images.back().hsv.size(), std::size_t{24 * 3 * 20 * 18});
      EXPECT_EQ(batch.camera(1).images().hsv.size(), std::size_t{24 * 3 * 16 * 12});
      EXPECT_TRUE(batch.camera(1).images().rgb.empty());
    }
    EXPECT_EQ(observed[0], observed[1]);
    EXPECT_EQ(images[0].hsv, images[1].hsv);
    EXPECT_EQ(images[0].rgb, images[1].rgb);
    EXPECT_TRUE(same_bits(images[0].depth, images[1].depth));
  }
}

// -- Refusals.

TEST(CameraNavigation, RefusesABatchItCannotObserve) {
  const Batch::Worlds worlds{parlour(1)};
  for (const ObservationKind kind : kKinds) {
    const auto with = [kind](auto change) {
      NavigationBatch config = camera_batch(1, kind);
      change(config);
      return config;
    };
    EXPECT_REFUSED(with([](NavigationBatch& c) { c.cameras.clear(); }).make(worlds), "cameras");
    EXPECT_REFUSED(with([](NavigationBatch& c) { c.cameras[0].outputs = {.rgb = false, .depth = true}; }).make(worlds),
                   "camera.outputs");
    EXPECT_REFUSED(with([](NavigationBatch& c) { c.cameras[0].capture_mode = CaptureMode::on_demand; }).make(worlds),
                   "camera.capture_mode");
    EXPECT_REFUSED(with([](NavigationBatch& c) { c.lidars.clear(); }).make(worlds), "lidar");
    EXPECT_REFUSED(with([](NavigationBatch& c) { c.episode.frame_skip = 0; }).make(worlds), "frame_skip");
    Batch batch = camera_batch(1, kind).make(worlds);
    EXPECT_REFUSED(batch.camera(0).set_capture_mode(CaptureMode::on_demand), "capture_mode");
    EXPECT_EQ(batch.camera(0).config().capture_mode, CaptureMode::every_step);
    batch.camera(0).set_capture_mode(CaptureMode::on_movement);
  }
  NavigationBatch config = camera_batch(1, ObservationKind::pixels);
  config.cameras[0].layout = ImageLayout::hwc;
  EXPECT_REFUSED(config.make(worlds), "camera.layout");
}

TEST(CameraNavigation, OnMovementIsEveryStepToTheBit) {
  for (const ObservationKind kind : kKinds) {
    NavigationBatch config = camera_batch(8, kind);
    Batch every = config.make(parlours());
    config.cameras[0].capture_mode = CaptureMode::on_movement;
    Batch moving = config.make(parlours());
    for (Batch* each : {&every, &moving}) each->reset({});
    Random random(6);
    for (int step = 0; step < 60; ++step) {
      const std::vector<std::int64_t> actions = actions_of(random, 8);
      for (Batch* each : {&every, &moving}) each->step(actions);
      EXPECT_TRUE(same_observations(every, moving));
    }
  }
}

TEST(CameraNavigation, ASnapshotWithAModeTheTaskRefusesChangesNothing) {
  Batch batch = camera_batch(2, ObservationKind::blob).make(parlours());
  batch.reset({});
  std::string damaged = batch.snapshot();
  batch.camera(0).set_capture_mode(CaptureMode::on_movement);
  const std::string blob = batch.snapshot();
  const auto body = static_cast<std::ptrdiff_t>(sizeof(SnapshotHeader));
  const auto [mode, other] = std::mismatch(damaged.begin() + body, damaged.end(), blob.begin() + body);
  ASSERT_TRUE(mode != damaged.end());
  ASSERT_EQ(*mode, static_cast<char>(CaptureMode::every_step));
  *mode = static_cast<char>(CaptureMode::on_demand);
  EXPECT_REFUSED(batch.restore(mended(damaged)), "capture_mode");
  EXPECT_TRUE(batch.snapshot() == blob);
}

}  // namespace
}  // namespace flockstep
