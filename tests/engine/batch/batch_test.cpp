#include "flockstep/batch.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/raycast.hpp"

namespace flockstep {
namespace {

Batch::Worlds playgrounds() {
  Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) worlds.push_back(testing::playground("train-" + std::to_string(i)));
  return worlds;
}

testing::NavigationBatch navigation(int num_envs) {
  testing::NavigationBatch config = testing::navigation_batch(num_envs);
  config.episode.max_episode_steps = 60;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  return config;
}

std::vector<std::vector<std::int64_t>> random_actions(std::size_t steps, std::size_t num_envs) {
  std::mt19937 random(7);
  std::vector<std::vector<std::int64_t>> actions(steps, std::vector<std::int64_t>(num_envs));
  for (auto& step : actions) {
    for (auto& action : step) action = static_cast<std::int64_t>(random() % 6);
  }
  return actions;
}

void expect_no_allocation(int num_threads, int drones_per_env = 1, Episodes episodes = Episodes::team) {
  testing::NavigationBatch config = navigation(256 / drones_per_env);
  config.drones_per_env = drones_per_env;
  config.episode.episodes = episodes;
  config.num_threads = num_threads;
  config.block_size = 16;
  config.episode.random_world = true;
  config.episode.max_episode_steps = 3000;
  Batch batch = config.make(playgrounds());
  batch.reset({});
  const auto actions = random_actions(400, 256);
  for (int i = 0; i < 100; ++i) batch.step(std::span<const std::int64_t>(actions[static_cast<std::size_t>(i)]));
  int crashes = 0;
  const std::uint64_t before = testing::allocations();
  for (std::size_t i = 100; i < actions.size(); ++i) {
    batch.step(std::span<const std::int64_t>(actions[i]));
    const FlagArray& crashed = batch.outputs().crashed;
    crashes += std::accumulate(crashed.begin(), crashed.end(), 0);
  }
  EXPECT_EQ(testing::allocations() - before, 0U);
  EXPECT_GT(crashes, 0) << "the test means to have contacts";
}

TEST(Batch, AStepAllocatesNothingContactsAndResetsIncluded) { expect_no_allocation(1); }

// The hundred warm-up steps wake the second thread. oneTBB allocates its tasks from its own pools without operator new, so this
// counts only the engine's allocations, on both threads.
TEST(Batch, AStepOnTwoThreadsAllocatesNothing) { expect_no_allocation(2); }

TEST(Batch, AStepOfSeveralDronesAllocatesNothing) {
  for (const Episodes episodes : {Episodes::team, Episodes::each, Episodes::last}) expect_no_allocation(1, 4, episodes);
}

TEST(Batch, EnvsDoNotDependOnOthers) {
  // The same five worlds and seeds, once with 20 envs in blocks of 3 on four threads, and once with 200 envs on one thread.
  testing::NavigationBatch few_config = navigation(20);
  few_config.block_size = 3;
  few_config.num_threads = 4;
  Batch few = few_config.make(playgrounds());
  Batch many = navigation(200).make(playgrounds());
  std::vector<std::uint64_t> seeds(200);
  std::iota(seeds.begin(), seeds.end(), std::uint64_t{11});
  few.reset(std::span(seeds).first(20));
  many.reset(seeds);
  const auto actions = random_actions(300, 200);
  for (const auto& step : actions) {
    many.step(std::span<const std::int64_t>(step));
    few.step(std::span<const std::int64_t>(step).first(20));
    const Outputs& a = few.outputs();
    const Outputs& b = many.outputs();
    const std::span<const std::byte> seen = a.observation[0].bytes();
    ASSERT_TRUE(testing::same_bits(seen, std::span(b.observation[0].bytes()).first(seen.size())));
    ASSERT_TRUE(std::equal(a.reward.begin(), a.reward.end(), b.reward.begin()));
    ASSERT_TRUE(std::equal(a.terminated.begin(), a.terminated.end(), b.terminated.begin()));
    ASSERT_TRUE(std::equal(a.truncated.begin(), a.truncated.end(), b.truncated.begin()));
  }
}

TEST(Batch, DirectTracingAndEmbreeAgree) {
  // Within a range of 3 m there are few shapes, which are traced directly. A raycast goes through Embree.
  const Batch::Worlds worlds = playgrounds();
  Batch batch(testing::lidar_batch(50), worlds);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> across(0.5F, 13.5F);
  std::vector<float> position;
  for (int i = 0; i < 50; ++i) position.insert(position.end(), {across(random), across(random), 2.0F});
  batch.set_pose(position, {});
  batch.sense();
  std::vector<float> directions(3 * 50 * 35);
  batch.lidar_directions(directions);
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
      const float range = batch.lidar_readings().ranges[35 * drone + ray];
      if (range == hits.t_hit[ray]) continue;
      ASSERT_NEAR(range, hits.t_hit[ray], 2e-6F) << drone << ' ' << ray;
    }
  }
}

}  // namespace
}  // namespace flockstep
