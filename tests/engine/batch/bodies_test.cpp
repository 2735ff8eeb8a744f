// Bodies in a batch: they move with the time of their env, and cost no allocation.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

Batch::Worlds five_playgrounds() {
  Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) worlds.push_back(testing::playground("train-" + std::to_string(i)));
  return worlds;
}

BodyConfig body_at(const std::array<float, 3>& position, const std::array<float, 3>& velocity, BodyShape shape) {
  BodyConfig body;
  body.shape = shape;
  body.size_m = {0.5F, 0.5F, shape == BodyShape::sphere ? 0.5F : 1.5F};
  body.position_m = position;
  body.motion.velocity_mps = velocity;
  body.motion.turn_rate_dps = {0.0F, 20.0F, 45.0F};
  return body;
}

testing::NavigationBatch among_bodies(int num_envs) {
  testing::NavigationBatch config = testing::navigation_batch(num_envs);
  config.episode.max_episode_steps = 60;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.random_world = true;
  config.bodies = {
      body_at({4, 6.5F, 1.4F}, {-0.5F, 0, 0}, BodyShape::box), body_at({3, 5, 1.2F}, {-0.1F, 0.5F, 0.05F}, BodyShape::sphere),
      body_at({2, 9, 1.5F}, {0.2F, -0.5F, 0}, BodyShape::capsule), body_at({6, 6, 1.5F}, {-0.9F, 0, 0}, BodyShape::cylinder)};
  config.max_bodies = 5;
  return config;
}

std::vector<std::int64_t> actions_of(std::size_t step, std::size_t num_envs) {
  std::vector<std::int64_t> actions(num_envs);
  for (std::size_t env = 0; env < num_envs; ++env) {
    actions[env] = static_cast<std::int64_t>(std::mt19937(static_cast<unsigned>(1000 * env + step))() % 6);
  }
  return actions;
}

TEST(Bodies, AStepAmongThemAllocatesNothing) {
  for (const int substeps : {1, 4}) {
    testing::NavigationBatch config = among_bodies(128);
    config.block_size = 16;
    config.episode.autoreset_mode = AutoresetMode::next_step;  // contacts stay until the next step
    config.clock.policy_hz = 10.0F;
    config.clock.physics_hz = 10.0F * static_cast<float>(substeps);
    Batch batch = config.make(five_playgrounds());
    batch.reset({});
    std::vector<std::vector<std::int64_t>> actions;
    for (std::size_t step = 0; step < 300; ++step) actions.push_back(actions_of(step, 128));
    for (std::size_t step = 0; step < 100; ++step) batch.step(std::span<const std::int64_t>(actions[step]));
    int met = 0;
    const std::uint64_t before = testing::allocations();
    for (std::size_t step = 100; step < actions.size(); ++step) {
      batch.step(std::span<const std::int64_t>(actions[step]));
      for (const std::int32_t body : batch.state().contact.body) met += body >= 0;
    }
    EXPECT_EQ(testing::allocations() - before, 0U);
    EXPECT_GT(met, 10) << "drones should meet bodies";
  }
}

TEST(Bodies, EnvsDoNotDependOnOthers) {
  testing::NavigationBatch few_config = among_bodies(20);
  few_config.block_size = 3;
  few_config.num_threads = 4;
  const Batch::Worlds worlds = five_playgrounds();
  Batch few = few_config.make(worlds);
  Batch many = among_bodies(200).make(worlds);
  few.reset({});
  many.reset({});
  for (std::size_t step = 0; step < 150; ++step) {
    few.step(std::span<const std::int64_t>(actions_of(step, 20)));
    many.step(std::span<const std::int64_t>(actions_of(step, 200)));
    for (std::size_t env = 0; env < 20; ++env) ASSERT_TRUE(testing::same_drone(few, env, many, env)) << "step " << step;
  }
}

TEST(Bodies, ManyMovesOfOneTickAreOneMoveOfManyTicks) {
  BatchConfig one;
  one.bodies = {body_at({1, 1, 0.75F}, {0.01F, 0, 0}, BodyShape::sphere)};
  one.clock.physics_hz = one.clock.policy_hz;
  BatchConfig many = one;
  many.clock.policy_hz = one.clock.policy_hz / 5.0F;
  const std::vector<float> at{1.9F, 1.0F, 0.75F};
  Batch a(one, {testing::closet()}), b(many, {testing::closet()});
  a.set_pose(at, {});
  b.set_pose(at, {});
  for (int i = 0; i < 5; ++i) a.move(at, {});
  b.move(at, {});
  EXPECT_TRUE(testing::same_bits(a.state().bodies.position, b.state().bodies.position));
  EXPECT_TRUE(testing::same_bits(a.state().bodies.quat_wxyz, b.state().bodies.quat_wxyz));
  EXPECT_TRUE(testing::same_bits(a.state().position, b.state().position));
}

// The drones of an env are pushed whether the call moves them or not.
TEST(Bodies, PushDronesThatACallDoesNotMove) {
  BatchConfig config;
  config.drones_per_env = 2;
  config.bodies = {body_at({1, 1, 0.75F}, {2, 0, 0}, BodyShape::sphere)};
  Batch batch(config, {testing::closet()});
  batch.set_pose(std::vector<float>{0.2F, 0.2F, 0.75F, 1.7F, 1.0F, 0.75F}, {});
  const float before = batch.state().position[3];
  batch.move({}, {}, std::vector<std::uint8_t>{1, 0});
  EXPECT_EQ(batch.state().contact.body[0], -1);
  EXPECT_EQ(batch.state().contact.body[1], 0);
  EXPECT_GT(batch.state().position[3], before);
}

}  // namespace
}  // namespace flockstep
