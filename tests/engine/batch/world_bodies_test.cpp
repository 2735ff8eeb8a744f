// Batches in worlds with bodies: steps allocate nothing, and no env depends on others.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/body.hpp"
#include "flockstep/generators.hpp"

namespace flockstep {
namespace {

// Worlds with 2, 3, ... bodies.
Batch::Worlds four_playgrounds() {
  Batch::Worlds worlds;
  for (int i = 0; i < 4; ++i) worlds.push_back(playground({.seed = static_cast<std::uint64_t>(i), .movers = 2 + i}));
  return worlds;
}

testing::NavigationBatch in_living_worlds(int num_envs) {
  testing::NavigationBatch config = testing::navigation_batch(num_envs);
  config.episode.max_episode_steps = 20;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.random_world = true;
  config.bodies = {BodyConfig()};
  config.bodies[0].position_m = {-50, 0, 0};  // outside of the room
  return config;
}

void step(Batch& batch, std::size_t number, std::vector<std::int64_t>& actions) {
  for (std::size_t env = 0; env < actions.size(); ++env) {
    actions[env] = static_cast<std::int64_t>(std::mt19937(static_cast<unsigned>(1000 * env + number))() % 6);
  }
  batch.step(std::span<const std::int64_t>(actions));
}

TEST(BatchInWorldsWithBodies, AStepAllocatesNothing) {
  Batch batch = in_living_worlds(64).make(four_playgrounds());
  EXPECT_EQ(batch.bodies_per_env(), 6U);
  batch.reset({});
  std::vector<std::int64_t> actions(64);
  for (std::size_t i = 0; i < 50; ++i) step(batch, i, actions);
  const std::uint64_t before = testing::allocations();
  for (std::size_t i = 50; i < 150; ++i) step(batch, i, actions);
  EXPECT_EQ(testing::allocations() - before, 0U);
}

TEST(BatchInWorldsWithBodies, EveryEnvHasThoseOfItsWorldAndTheConfiguration) {
  Batch batch = in_living_worlds(64).make(four_playgrounds());
  batch.reset({});
  std::vector<std::int64_t> actions(64);
  for (std::size_t i = 0; i < 60; ++i) {
    step(batch, i, actions);
    for (std::size_t env = 0; env < 64; ++env) {
      const auto of_world = static_cast<std::size_t>(2 + batch.state().world_index[env]);
      for (std::size_t body = 0; body < 6; ++body) {
        ASSERT_EQ(batch.state().bodies.active[6 * env + body] != 0, body <= of_world) << "step " << i << ", env " << env;
      }
      ASSERT_EQ(batch.state().bodies.position[3 * (6 * env + of_world)], -50.0F);
    }
  }
}

TEST(BatchInWorldsWithBodies, EnvsDoNotDependOnOthers) {
  testing::NavigationBatch few_config = in_living_worlds(10);
  few_config.block_size = 3;
  few_config.num_threads = 4;
  const Batch::Worlds worlds = four_playgrounds();
  Batch few = few_config.make(worlds), many = in_living_worlds(50).make(worlds);
  few.reset({});
  many.reset({});
  std::vector<std::int64_t> few_actions(10), many_actions(50);
  for (std::size_t i = 0; i < 80; ++i) {
    step(few, i, few_actions);
    step(many, i, many_actions);
    for (std::size_t env = 0; env < 10; ++env) ASSERT_TRUE(testing::same_drone(few, env, many, env)) << "step " << i;
    for (std::size_t row = 0; row < std::size_t{3} * 6 * 10; ++row) {
      ASSERT_EQ(few.state().bodies.position[row], many.state().bodies.position[row]) << "step " << i;
    }
  }
}

}  // namespace
}  // namespace flockstep
