#include <random>

#include "allocation_counter.hpp"
#include "batch/move_lines.hpp"
#include "batch_helpers.hpp"
#include "flockstep/raycast.hpp"

namespace flockstep {
namespace {

using namespace testing;

NavigationBatch navigation(int num_envs) {
  NavigationBatch config = navigation_batch(num_envs);
  config.episode.max_episode_steps = 60;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  return config;
}

void expect_no_allocation(int num_threads, int drones_per_env = 1, Episodes episodes = Episodes::team) {
  NavigationBatch config = navigation(256 / drones_per_env);
  config.drones_per_env = drones_per_env;
  config.episode.episodes = episodes;
  config.num_threads = num_threads;
  config.block_size = 16;
  config.episode.random_world = true;
  config.episode.max_episode_steps = 3000;
  Batch batch = config.make(training_playgrounds());
  batch.reset({});
  const auto actions = discrete_actions(400, 256);
  for (std::size_t i = 0; i < 100; ++i) batch.step(actions[i]);
  int crashes = 0;
  const std::uint64_t before = allocations();
  for (std::size_t i = 100; i < actions.size(); ++i) {
    batch.step(actions[i]);
    const FlagArray& crashed = batch.outputs().crashed;
    crashes += std::accumulate(crashed.begin(), crashed.end(), 0);
  }
  EXPECT_EQ(allocations() - before, 0U);
  EXPECT_GT(crashes, 0) << "the test means to have contacts";
}

TEST(Batch, AStepAllocatesNothingContactsAndResetsIncluded) { expect_no_allocation(1); }

// The hundred warm-up steps wake the second thread. oneTBB allocates its tasks from its own pools without operator new, so this
// counts only the engine's allocations, on both threads.
TEST(Batch, AStepOnTwoThreadsAllocatesNothing) { expect_no_allocation(2); }

TEST(Batch, AStepOfSeveralDronesAllocatesNothing) {
  for (const Episodes episodes : {Episodes::team, Episodes::each, Episodes::last}) expect_no_allocation(1, 4, episodes);
}

TEST(Batch, EnvsDoNotDependOnOthers) { expect_envs_alone(navigation(200), training_playgrounds(), 20, 300); }

TEST(Batch, DirectTracingAndEmbreeAgree) {
  // Within a range of 3 m there are few shapes, which are traced directly. A raycast goes through Embree.
  const Batch::Worlds worlds = training_playgrounds();
  Batch batch(lidar_batch(50), worlds);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> across(0.5F, 13.5F);
  std::vector<float> position;
  for (int i = 0; i < 50; ++i) position.insert(position.end(), {across(random), across(random), 2.0F});
  batch.set_pose(position, {});
  batch.sense();
  std::vector<float> directions(3 * 50 * 35);
  batch.lidar().directions(directions);
  for (std::size_t drone = 0; drone < 50; ++drone) {
    std::vector<float> origins;
    for (int ray = 0; ray < 35; ++ray) {
      origins.insert(origins.end(), position.begin() + static_cast<std::ptrdiff_t>(3 * drone),
                     position.begin() + static_cast<std::ptrdiff_t>(3 * drone + 3));
    }
    const RayHits hits =
        raycast(*worlds[drone % 5], origins, std::span(directions).subspan(3 * 35 * drone, std::size_t{3} * 35), 3.0F);
    for (std::size_t ray = 0; ray < 35; ++ray) {
      // raycast() normalises the directions again, which can change the last bit of a beam.
      const float range = batch.lidar().readings().ranges[35 * drone + ray];
      if (range == hits.t_hit[ray]) continue;
      ASSERT_NEAR(range, hits.t_hit[ray], 2e-6F) << drone << ' ' << ray;
    }
  }
}

// -- MoveLines: the recorded paths of drones, and what they cost.

// A line whose row i, without a limit, would be (i, 0, 0).
MoveLine flown(std::size_t motions) {
  MoveLine line;
  line.begin(Vec3::Zero());
  for (std::size_t i = 1; i <= motions; ++i) line.add(Vec3(static_cast<float>(i), 0.0F, 0.0F));
  return line;
}

TEST(MoveLine, KeepsItsWholePathAtEqualDistances) {
  for (const std::size_t motions : {0U, 1U, 2U, 1000U, 4093U, 4094U, 4095U, 4096U, 4097U, 4098U, 8187U, 8188U, 8189U, 8190U,
                                    8191U, 8192U, 100000U, 999999U}) {
    const MoveLine line = flown(motions);
    const std::span<const Vec3> rows = line.rows();
    ASSERT_LE(rows.size(), MoveLine::kMaxRows);
    EXPECT_EQ(rows.front().x(), 0.0F);
    EXPECT_EQ(rows.back().x(), static_cast<float>(motions));
    EXPECT_GT(rows.size(), std::min(motions, MoveLine::kMaxRows / 2 - 2));
    std::size_t period = 1;
    while (motions / period > MoveLine::kMaxRows) period *= 2;
    for (std::size_t i = 1; i < rows.size(); ++i) {
      const auto apart = static_cast<std::size_t>(rows[i].x() - rows[i - 1].x());
      if (i + 1 == rows.size()) {
        EXPECT_GE(apart, 1U) << motions;
        EXPECT_LE(apart, 2 * period) << motions;
      } else {
        EXPECT_EQ(apart, static_cast<std::size_t>(rows[1].x())) << motions << ' ' << i;
      }
    }
  }
}

TEST(MoveLine, SkipsADroneThatRests) {
  MoveLine line = flown(3);
  for (int i = 0; i < 10; ++i) line.add(Vec3(3.0F, 0.0F, 0.0F));
  EXPECT_EQ(line.rows().size(), 4U);
}

TEST(MoveLine, SeparatesPiecesAndDiscardsTheOldest) {
  MoveLine line = flown(2);
  line.begin(Vec3(10.0F, 0.0F, 0.0F));
  line.begin(Vec3(20.0F, 0.0F, 0.0F));  // instead of the piece without a motion
  line.add(Vec3(21.0F, 0.0F, 0.0F));
  ASSERT_EQ(line.rows().size(), 6U);
  EXPECT_TRUE(std::isnan(line.rows()[3].x()));
  EXPECT_EQ(line.rows()[4].x(), 20.0F);
  for (int piece = 3; piece < 5000; ++piece) {
    line.begin(Vec3(10.0F * static_cast<float>(piece), 0.0F, 0.0F));
    for (int i = 1; i < 5; ++i) line.add(Vec3(10.0F * static_cast<float>(piece) + static_cast<float>(i), 0.0F, 0.0F));
  }
  const std::span<const Vec3> rows = line.rows();
  ASSERT_LE(rows.size(), MoveLine::kMaxRows);
  ASSERT_GE(rows.size(), MoveLine::kMaxRows / 2 - 6);
  EXPECT_EQ(rows.back().x(), 49994.0F);
  ASSERT_EQ(rows.size() % 6, 5U);  // five rows and a gap for each piece; all of the remaining pieces are whole
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i % 6 == 5) {
      EXPECT_TRUE(std::isnan(rows[i].x()));
    } else if (i % 6 > 0) {
      EXPECT_EQ(rows[i].x() - rows[i - 1].x(), 1.0F);
    }
  }
}

TEST(MoveLine, ALongPieceThatFollowsOthersIsKept) {
  MoveLine line = flown(100);
  line.begin(Vec3(1e6F, 0.0F, 0.0F));
  for (int i = 1; i <= 5000; ++i) line.add(Vec3(1e6F + static_cast<float>(i), 0.0F, 0.0F));
  EXPECT_EQ(line.rows().front().x(), 1e6F);
  EXPECT_EQ(line.rows().back().x(), 1e6F + 5000.0F);
}

TEST(MoveLines, AStepWithVisibleLinesAllocatesNothing) {
  NavigationBatch config = navigation_batch(20);
  config.num_threads = 1;
  config.episode.max_episode_steps = 100;
  Batch batch = config.make({playground("train-1")});
  batch.reset({});
  batch.move_lines().set_visible(true);
  std::vector<std::int64_t> actions(20);
  const auto step = [&](int i) {
    for (std::size_t k = 0; k < actions.size(); ++k) actions[k] = (i / 7 + static_cast<int>(k)) % 3;
    batch.step(std::span<const std::int64_t>(actions));
  };
  for (int i = 0; i < 150; ++i) step(i);
  const std::uint64_t before = allocations();
  for (int i = 0; i < 5000; ++i) step(i);
  EXPECT_EQ(allocations() - before, 0U);
  EXPECT_GT(batch.move_lines().path(DroneIndex(0)).size(), MoveLine::kMaxRows / 3);
}

}  // namespace
}  // namespace flockstep
