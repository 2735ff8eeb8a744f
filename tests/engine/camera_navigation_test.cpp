// The navigation tasks that observe a camera, and frame skip.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "random.hpp"
#include "task/green_blob.hpp"

namespace flockstep {
namespace {

using testing::lidar_batch;
using testing::make_world;
using testing::primitive;
using testing::Random;
using testing::row;
using testing::same_bits;
using testing::same_drone;
using testing::same_drones;

constexpr std::size_t kRays = 20;

// White and large enough that the goal is seen over some steps, small enough that flights end soon in every way.
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
  static const Batch::Worlds worlds{parlour(0.75F), parlour(3.25F), testing::playground("camera-train-1")};
  return worlds;
}

BatchConfig camera_batch(int num_drones, ObservationKind observation, AutoresetMode mode = AutoresetMode::same_step) {
  BatchConfig config = lidar_batch(num_drones, {.beams = kRays, .hfov_deg = 180.0F});
  CameraConfig camera;
  camera.width_px = 32;
  camera.height_px = 24;
  camera.layout = ImageLayout::chw;
  config.cameras = {camera};
  config.task = TaskKind::navigation;
  config.navigation.action = ActionKind::discrete_forward;
  config.navigation.observation = observation;
  config.navigation.max_episode_steps = 40;
  config.navigation.random_start = true;
  config.navigation.stagger_first_episode = true;
  config.navigation.reward.overshoot_weight = 1.0F;
  config.autoreset_mode = mode;
  return config;
}

constexpr std::size_t kImage = 3 * 32 * 24;
constexpr ObservationKind kKinds[] = {ObservationKind::blob, ObservationKind::pixels};
constexpr AutoresetMode kModes[] = {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled};

// Mostly forward, and more to the left: so that goals are reached and overshoot, and walls hit.
std::int64_t action_of(Random& random) {
  const auto number = random.generator()() % 10;
  return number < 5 ? 0 : number < 8 ? 1 : 2;
}

std::vector<std::uint64_t> seeds_from(std::uint64_t first, std::size_t count) {
  std::vector<std::uint64_t> seeds(count);
  std::iota(seeds.begin(), seeds.end(), first);
  return seeds;
}

// -- Actions and observations.

TEST(CameraNavigation, ForwardActionsAreThree) {
  BatchConfig config = camera_batch(1, ObservationKind::blob);
  config.navigation.random_start = false;
  Batch batch(config, {testing::playground("camera-train-1")});
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
    BatchConfig config = camera_batch(6, ObservationKind::blob);
    config.cameras[0].layout = layout;
    Batch batch(config, parlours());
    EXPECT_EQ(batch.observation_size(), 22);
    EXPECT_EQ(batch.image_size(), 0);
    batch.reset({});
    Random random(1);
    std::vector<std::int64_t> actions(6);
    int seen = 0;
    task::GreenBlobScratch scratch;
    for (int step = 0; step < 60; ++step) {
      for (auto& action : actions) action = action_of(random);
      batch.step(std::span<const std::int64_t>(actions));
      const State& state = batch.state();
      for (std::size_t i = 0; i < 6; ++i) {
        const auto observation = row(batch.outputs().observation, i, 22);
        const auto blob = task::find_green(row(batch.images(0).rgb, i, kImage), 32, 24, layout, scratch);
        EXPECT_EQ(observation[0], blob.offset);
        EXPECT_EQ(observation[1], blob.area);
        seen += blob.found;
        for (std::size_t k = 0; k < kRays; ++k) {
          EXPECT_FLOAT_EQ(observation[2 + k], std::min(state.lidar_ranges[i * kRays + k] / 3.0F, 1.0F));
        }
      }
    }
    EXPECT_GT(seen, 100);
  }
}

TEST(CameraNavigation, TheBlobIsWhereTheGoalIs) {
  BatchConfig config = camera_batch(1, ObservationKind::blob);
  config.cameras[0].width_px = 640;
  config.cameras[0].height_px = 480;
  config.navigation.random_start = false;
  for (const float aside : {-4.0F, -1.5F, 0.0F, 2.0F, 4.0F}) {
    const Vec3 offset(8, aside, 0);
    const Vec3 start(2, 5, 2);
    Batch batch(config, {make_world({primitive(PrimitiveKind::room, {6, 5, 2}, {6, 5, 2})},
                                    {.start = start, .goal = Vec3(start + offset)})});
    batch.reset({});
    // Left is positive y, and to the left is negative in the image, which is 90 degrees wide.
    EXPECT_NEAR(batch.outputs().observation[0], -offset.y() / offset.x(), 0.005) << aside;
    // A sphere aside is drawn longer, away from the centre.
    const float height = 2.0F * 0.25F / offset.x() * 320.0F;  // px
    const float width = height * offset.norm() / offset.x();
    EXPECT_NEAR(batch.outputs().observation[1] * 640.0F * 480.0F, width * height, 2.0F * (width + height)) << aside;
  }
}

TEST(CameraNavigation, PixelsAreTheCamerasImage) {
  Batch batch(camera_batch(6, ObservationKind::pixels), parlours());
  EXPECT_EQ(batch.observation_size(), static_cast<int>(kRays));
  EXPECT_EQ(batch.image_size(), static_cast<int>(kImage));
  batch.reset({});
  EXPECT_TRUE(same_bits(batch.outputs().image, batch.images(0).rgb));
  Random random(1);
  std::vector<std::int64_t> actions(6);
  for (int step = 0; step < 60; ++step) {
    const std::vector<std::uint8_t> previous = batch.outputs().image;
    const std::uint8_t* const there = batch.outputs().image.data();
    for (auto& action : actions) action = action_of(random);
    batch.step(std::span<const std::int64_t>(actions));
    EXPECT_TRUE(same_bits(batch.outputs().image, batch.images(0).rgb));
    EXPECT_TRUE(same_bits(previous, std::span(there, previous.size()))) << "the previous images were written";
    for (std::size_t k = 0; k < 6 * kRays; ++k) {
      EXPECT_FLOAT_EQ(batch.outputs().observation[k], std::min(batch.state().lidar_ranges[k] / 3.0F, 1.0F));
    }
  }
}

TEST(CameraNavigation, TheLastImageOfAnEpisodeIsKeptBesideTheResetsOne) {
  // In the mode `disabled` nothing is reset, so what is there after the end is what the episode ended with.
  for (const ObservationKind kind : kKinds) {
    constexpr std::size_t kDrones = 12;
    Batch kept(camera_batch(kDrones, kind, AutoresetMode::disabled), parlours());
    Batch batch(camera_batch(kDrones, kind), parlours());
    Batch next(camera_batch(kDrones, kind), parlours());
    for (Batch* each : {&kept, &batch, &next}) each->reset(seeds_from(3, kDrones));
    next.reset({});  // the second episodes
    Random random(2);
    std::vector<std::int64_t> actions(kDrones);
    std::size_t ended = 0;
    std::vector<std::uint8_t> over(kDrones, 0);
    for (int step = 0; step < 60; ++step) {
      for (auto& action : actions) action = action_of(random);
      kept.step(std::span<const std::int64_t>(actions));
      batch.step(std::span<const std::int64_t>(actions));
      const auto size = static_cast<std::size_t>(batch.observation_size());
      const auto image = static_cast<std::size_t>(batch.image_size());
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (over[i] || !(batch.outputs().terminated[i] || batch.outputs().truncated[i])) continue;
        over[i] = 1;
        ++ended;
        EXPECT_TRUE(same_bits(row(batch.outputs().final_observation, i, size), row(kept.outputs().observation, i, size)));
        EXPECT_TRUE(same_bits(row(batch.outputs().final_image, i, image), row(kept.outputs().image, i, image)));
        EXPECT_TRUE(same_bits(row(batch.outputs().observation, i, size), row(next.outputs().observation, i, size)));
        EXPECT_TRUE(same_bits(row(batch.outputs().image, i, image), row(next.outputs().image, i, image)));
      }
    }
    EXPECT_EQ(ended, kDrones);
  }
}

// -- The same bits.

TEST(CameraNavigation, AnEnvOfManyIsTheEnvAlone) {
  constexpr std::size_t kDrones = 11;
  for (const ObservationKind kind : kKinds) {
    for (const AutoresetMode mode : kModes) {
      for (const int frame_skip : {1, 3}) {
        SCOPED_TRACE("observation " + std::to_string(static_cast<int>(kind)) + ", mode " +
                     std::to_string(static_cast<int>(mode)) + ", frame skip " + std::to_string(frame_skip));
        BatchConfig config = camera_batch(kDrones, kind, mode);
        config.navigation.random_world = true;
        config.navigation.frame_skip = frame_skip;
        config.block_size = 4;
        config.num_threads = 2;
        Batch many(config, parlours());
        const auto seeds = seeds_from(77, kDrones);
        many.reset(seeds);
        config.num_drones = config.num_threads = 1;
        config.block_size = 64;
        std::vector<std::unique_ptr<Batch>> alone;
        for (std::size_t i = 0; i < kDrones; ++i) {
          alone.push_back(std::make_unique<Batch>(config, parlours()));
          alone[i]->reset(std::span(seeds).subspan(i, 1));
        }
        Random random(2);
        std::vector<std::int64_t> actions(kDrones);
        std::map<std::string, int> ends;
        for (int step = 0; step < 80; ++step) {
          for (auto& action : actions) action = action_of(random);
          many.step(std::span<const std::int64_t>(actions));
          std::vector<std::uint8_t> mask(kDrones, 0);
          for (std::size_t i = 0; i < kDrones; ++i) {
            alone[i]->step(std::span<const std::int64_t>(actions).subspan(i, 1));
            ASSERT_TRUE(same_drone(many, i, *alone[i], 0)) << "step " << step;
            ends["crashed"] += many.outputs().crashed[i];
            ends["success"] += many.outputs().success[i];
            ends["truncated"] += many.outputs().truncated[i];
            mask[i] = step % 7 == 6 && (many.outputs().terminated[i] || many.outputs().truncated[i]);
          }
          if (mode != AutoresetMode::disabled || std::find(mask.begin(), mask.end(), 1) == mask.end()) continue;
          many.reset({}, mask);
          for (std::size_t i = 0; i < kDrones; ++i) {
            if (mask[i]) alone[i]->reset({});
            ASSERT_TRUE(same_drone(many, i, *alone[i], 0)) << "reset in step " << step;
          }
        }
        for (const char* end : {"crashed", "success", "truncated"}) EXPECT_GT(ends[end], 0) << end;
      }
    }
  }
}

TEST(CameraNavigation, ModesAgreeButForTheResetRows) {
  constexpr std::size_t kDrones = 8;
  struct Row {
    std::vector<float> observation;
    std::vector<std::uint8_t> image;
    float reward;
    std::uint8_t terminated, truncated;
    bool operator==(const Row&) const = default;
  };
  for (const ObservationKind kind : kKinds) {
    const auto live = [kind](AutoresetMode mode) {
      BatchConfig config = camera_batch(kDrones, kind, mode);
      config.navigation.frame_skip = 2;
      Batch batch(config, parlours());
      const auto size = static_cast<std::size_t>(batch.observation_size());
      const auto image = static_cast<std::size_t>(batch.image_size());
      batch.reset(seeds_from(5, kDrones));
      std::vector<std::vector<Row>> rows(kDrones);
      std::vector<std::uint64_t> episode(kDrones, 0);
      std::vector<std::uint64_t> step(kDrones, 0);
      std::vector<std::uint8_t> ended(kDrones, 0);
      std::vector<std::int64_t> actions(kDrones);
      const auto add = [&](std::size_t i, bool final, float reward, std::uint8_t terminated, std::uint8_t truncated) {
        const Outputs& out = batch.outputs();
        const auto seen = row(final ? out.final_observation : out.observation, i, size);
        const auto picture = row(final ? out.final_image : out.image, i, image);
        rows[i].push_back({{seen.begin(), seen.end()}, {picture.begin(), picture.end()}, reward, terminated, truncated});
      };
      for (std::size_t i = 0; i < kDrones; ++i) add(i, false, 0, 0, 0);
      for (int time = 0; time < 80; ++time) {
        for (std::size_t i = 0; i < kDrones; ++i) {
          const std::uint64_t number = i * 31 + episode[i] * 17 + step[i] * step[i] * 7 + step[i] / 3;
          actions[i] = number % 5 < 3 ? 0 : number % 5 == 3 ? 1 : 2;
        }
        batch.step(std::span<const std::int64_t>(actions));
        const Outputs& out = batch.outputs();
        for (std::size_t i = 0; i < kDrones; ++i) {
          if (mode == AutoresetMode::next_step && ended[i]) {  // the reset row
            add(i, false, 0, 0, 0);
            ended[i] = 0;
            continue;
          }
          ended[i] = out.terminated[i] || out.truncated[i];
          const bool was_reset = ended[i] && mode == AutoresetMode::same_step;
          add(i, was_reset, out.reward[i], out.terminated[i], out.truncated[i]);
          ++step[i];
          if (!ended[i]) continue;
          ++episode[i];
          step[i] = 0;
          if (was_reset) add(i, false, 0, 0, 0);
        }
        if (mode != AutoresetMode::disabled || std::find(ended.begin(), ended.end(), 1) == ended.end()) continue;
        batch.reset({}, ended);
        for (std::size_t i = 0; i < kDrones; ++i) {
          if (ended[i]) add(i, false, 0, 0, 0);
        }
      }
      return rows;
    };
    const auto next_step = live(AutoresetMode::next_step);
    for (const AutoresetMode mode : {AutoresetMode::same_step, AutoresetMode::disabled}) {
      const auto other = live(mode);
      for (std::size_t i = 0; i < kDrones; ++i) {
        const std::size_t count = std::min(next_step[i].size(), other[i].size());
        ASSERT_GT(count, 75U);
        for (std::size_t k = 0; k < count; ++k) ASSERT_EQ(next_step[i][k], other[i][k]) << "env " << i << ", row " << k;
      }
    }
  }
}

TEST(CameraNavigation, ASnapshotBringsTheImagesBack) {
  for (const ObservationKind kind : kKinds) {
    Batch batch(camera_batch(6, kind), parlours());
    batch.reset({});
    Random random(3);
    std::vector<std::int64_t> actions(6, 0);
    for (int step = 0; step < 5; ++step) batch.step(std::span<const std::int64_t>(actions));
    const std::string blob = batch.snapshot();
    Batch other(camera_batch(6, kind), parlours());
    other.restore(blob);
    EXPECT_TRUE(same_drones(batch, other));
    for (int step = 0; step < 30; ++step) {
      for (auto& action : actions) action = action_of(random);
      batch.step(std::span<const std::int64_t>(actions));
      other.step(std::span<const std::int64_t>(actions));
      ASSERT_TRUE(same_drones(batch, other)) << step;
    }
  }
}

// -- Frame skip.

TEST(FrameSkip, IsThatManyStepsOfTheSameAction) {
  constexpr std::size_t kDrones = 24;
  for (const ObservationKind kind : {ObservationKind::goal, ObservationKind::blob, ObservationKind::pixels}) {
    SCOPED_TRACE(static_cast<int>(kind));
    BatchConfig config = camera_batch(kDrones, kind, AutoresetMode::disabled);
    config.pose_sensor = {.position_noise_std_m = 0.01F, .tilt_noise_std_deg = 0.5F};
    Batch single(config, parlours());
    config.navigation.frame_skip = 3;
    Batch skipping(config, parlours());
    for (Batch* each : {&single, &skipping}) each->reset(seeds_from(9, kDrones));
    Random random(4);
    std::vector<std::int64_t> actions(kDrones);
    int cut_short = 0;
    for (int step = 0; step < 30; ++step) {
      for (auto& action : actions) action = action_of(random);
      std::vector<double> reward(kDrones, 0.0);
      std::vector<double> terms(kDrones * kNumRewardTerms, 0.0);
      for (int k = 0; k < 3; ++k) {
        const std::vector<std::int64_t> before = single.outputs().episode_length;
        single.step(std::span<const std::int64_t>(actions));
        for (std::size_t i = 0; i < kDrones; ++i) {
          reward[i] += static_cast<double>(single.outputs().reward[i]);
          const bool over = single.outputs().terminated[i] || single.outputs().truncated[i];
          cut_short += k < 2 && over && single.outputs().episode_length[i] > before[i];
        }
        for (std::size_t j = 0; j < terms.size(); ++j) terms[j] += static_cast<double>(single.outputs().reward_terms[j]);
      }
      skipping.step(std::span<const std::int64_t>(actions));
      const Outputs& a = skipping.outputs();
      const Outputs& b = single.outputs();
      EXPECT_TRUE(same_bits(a.observation, b.observation)) << step;
      EXPECT_TRUE(same_bits(a.image, b.image)) << step;
      EXPECT_EQ(a.terminated, b.terminated);
      EXPECT_EQ(a.truncated, b.truncated);
      EXPECT_EQ(a.success, b.success);
      EXPECT_EQ(a.crashed, b.crashed);
      EXPECT_EQ(a.episode_length, b.episode_length);
      EXPECT_EQ(a.episode_return, b.episode_return);
      EXPECT_EQ(skipping.state().position, single.state().position);
      EXPECT_EQ(skipping.state().scans, single.state().scans);
      EXPECT_EQ(skipping.images(0).frame_step, single.images(0).frame_step);
      for (std::size_t i = 0; i < kDrones; ++i) EXPECT_NEAR(a.reward[i], reward[i], 1e-6 * std::max(1.0, std::abs(reward[i])));
      for (std::size_t j = 0; j < terms.size(); ++j) {
        EXPECT_NEAR(a.reward_terms[j], terms[j], 1e-6 * std::max(1.0, std::abs(terms[j])));
      }
    }
    EXPECT_GT(cut_short, 3);
  }
}

TEST(FrameSkip, CountsFlownStepsTowardsTheLimit) {
  BatchConfig config = camera_batch(1, ObservationKind::goal, AutoresetMode::disabled);
  config.navigation.random_start = config.navigation.stagger_first_episode = false;
  config.navigation.frame_skip = 4;
  config.navigation.max_episode_steps = 10;
  Batch batch(config, {testing::playground("camera-train-1")});
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
  BatchConfig config = camera_batch(1, ObservationKind::goal, AutoresetMode::disabled);
  config.navigation.random_start = false;
  config.navigation.frame_skip = 4;
  Batch batch(config, {testing::playground("camera-train-1")});
  batch.reset({});
  const std::pair<std::int64_t, float> flights[] = {{1, -1.0F}, {1, 0.0F}, {2, -1.0F}};
  for (const auto& [action, change] : flights) {
    batch.step(std::span<const std::int64_t>(&action, 1));
    EXPECT_EQ(batch.outputs().reward_terms[4], change);
  }
}

// -- Memory.

TEST(CameraNavigation, AStepAllocatesNothing) {
  for (const ObservationKind kind : kKinds) {
    for (const AutoresetMode mode : kModes) {
      BatchConfig config = camera_batch(24, kind, mode);
      config.navigation.frame_skip = 2;
      Batch batch(config, parlours());
      batch.reset({});
      Random random(5);
      std::vector<std::int64_t> actions(24);
      const auto fly = [&](int steps) {
        for (int step = 0; step < steps; ++step) {
          for (auto& action : actions) action = action_of(random);
          batch.step(std::span<const std::int64_t>(actions));
        }
      };
      fly(40);
      const std::uint64_t before = testing::allocations();
      fly(40);
      EXPECT_EQ(testing::allocations() - before, 0U);
    }
  }
}

// -- What cannot be.

TEST(CameraNavigation, RefusesABatchItCannotObserve) {
  const Batch::Worlds worlds{parlour(1)};
  for (const ObservationKind kind : kKinds) {
    const auto with = [kind](auto change) {
      BatchConfig config = camera_batch(1, kind);
      change(config);
      return config;
    };
    EXPECT_REFUSED(Batch(with([](BatchConfig& c) { c.cameras.clear(); }), worlds), "cameras");
    EXPECT_REFUSED(Batch(with([](BatchConfig& c) { c.cameras[0].outputs = {.rgb = false, .depth = true}; }), worlds),
                   "camera.outputs");
    EXPECT_REFUSED(Batch(with([](BatchConfig& c) { c.cameras[0].capture_mode = CaptureMode::on_demand; }), worlds),
                   "camera.capture_mode");
    EXPECT_REFUSED(Batch(with([](BatchConfig& c) { c.has_lidar = false; }), worlds), "lidar");
    EXPECT_REFUSED(Batch(with([](BatchConfig& c) { c.navigation.frame_skip = 0; }), worlds), "frame_skip");
    Batch batch(camera_batch(1, kind), worlds);
    EXPECT_REFUSED(batch.set_capture_mode(0, CaptureMode::on_demand), "capture_mode");
    EXPECT_EQ(batch.config().cameras[0].capture_mode, CaptureMode::every_step);
    batch.set_capture_mode(0, CaptureMode::on_movement);
  }
  BatchConfig config = camera_batch(1, ObservationKind::pixels);
  config.cameras[0].layout = ImageLayout::hwc;
  EXPECT_REFUSED(Batch(config, worlds), "camera.layout");
}

TEST(CameraNavigation, OnMovementIsEveryStepToTheBit) {
  for (const ObservationKind kind : kKinds) {
    BatchConfig config = camera_batch(8, kind);
    Batch every(config, parlours());
    config.cameras[0].capture_mode = CaptureMode::on_movement;
    Batch moving(config, parlours());
    for (Batch* each : {&every, &moving}) each->reset({});
    Random random(6);
    std::vector<std::int64_t> actions(8);
    for (int step = 0; step < 60; ++step) {
      for (auto& action : actions) action = action_of(random);
      every.step(std::span<const std::int64_t>(actions));
      moving.step(std::span<const std::int64_t>(actions));
      EXPECT_TRUE(same_bits(every.outputs().observation, moving.outputs().observation));
      EXPECT_TRUE(same_bits(every.outputs().image, moving.outputs().image));
    }
  }
}

TEST(CameraNavigation, ASnapshotWithAModeTheTaskRefusesChangesNothing) {
  Batch batch(camera_batch(2, ObservationKind::blob), parlours());
  batch.reset({});
  std::string damaged = batch.snapshot();
  batch.set_capture_mode(0, CaptureMode::on_movement);
  const std::string blob = batch.snapshot();
  const auto [mode, other] = std::mismatch(damaged.begin(), damaged.end(), blob.begin());
  ASSERT_TRUE(mode != damaged.end());
  ASSERT_EQ(*mode, static_cast<char>(CaptureMode::every_step));
  *mode = static_cast<char>(CaptureMode::on_demand);
  EXPECT_REFUSED(batch.restore(damaged), "capture_mode");
  EXPECT_TRUE(batch.snapshot() == blob);
}

}  // namespace
}  // namespace flockstep
