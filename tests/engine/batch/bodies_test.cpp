// Bodies in a batch: they move with the time of their env, and cost no allocation.
#include <random>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "flockstep/body.hpp"
#include "flockstep/generators.hpp"

namespace flockstep {
namespace {

using namespace testing;

BodyConfig body_at(const std::array<float, 3>& position, const std::array<float, 3>& velocity, BodyShape shape) {
  BodyConfig body{.shape = shape, .size_m = {0.5F, 0.5F, shape == BodyShape::sphere ? 0.5F : 1.5F}, .position_m = position};
  body.motion.velocity_mps = velocity;
  body.motion.turn_rate_dps = {0.0F, 20.0F, 45.0F};
  return body;
}

NavigationBatch among_bodies(int num_envs) {
  NavigationBatch config = navigation_batch(num_envs);
  config.episode.max_episode_steps = 60;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.random_world = true;
  config.bodies = {
      body_at({4, 6.5F, 1.4F}, {-0.5F, 0, 0}, BodyShape::box), body_at({3, 5, 1.2F}, {-0.1F, 0.5F, 0.05F}, BodyShape::sphere),
      body_at({2, 9, 1.5F}, {0.2F, -0.5F, 0}, BodyShape::capsule), body_at({6, 6, 1.5F}, {-0.9F, 0, 0}, BodyShape::cylinder)};
  config.max_bodies = 5;
  return config;
}

TEST(Bodies, AStepAmongThemAllocatesNothing) {
  for (const int substeps : {1, 4}) {
    NavigationBatch config = among_bodies(128);
    config.block_size = 16;
    config.episode.autoreset_mode = AutoresetMode::next_step;  // contacts stay until the next step
    config.clock.policy_hz = 10.0F;
    config.clock.physics_hz = 10.0F * static_cast<float>(substeps);
    Batch batch = config.make(training_playgrounds());
    batch.reset({});
    const auto actions = discrete_actions(300, 128);
    for (std::size_t step = 0; step < 100; ++step) batch.step(actions[step]);
    int met = 0;
    const std::uint64_t before = allocations();
    for (std::size_t step = 100; step < actions.size(); ++step) {
      batch.step(actions[step]);
      for (const std::int32_t body : batch.state().contact.body) met += body >= 0;
    }
    EXPECT_EQ(allocations() - before, 0U);
    EXPECT_GT(met, 10) << "drones should meet bodies";
  }
}

TEST(Bodies, EnvsDoNotDependOnOthers) { expect_envs_alone(among_bodies(200), training_playgrounds(), 20, 150); }

TEST(Bodies, ManyMovesOfOneTickAreOneMoveOfManyTicks) {
  BatchConfig one;
  one.bodies = {body_at({1, 1, 0.75F}, {0.01F, 0, 0}, BodyShape::sphere)};
  one.clock.physics_hz = one.clock.policy_hz;
  BatchConfig many = one;
  many.clock.policy_hz = one.clock.policy_hz / 5.0F;
  const std::vector<float> at{1.9F, 1.0F, 0.75F};
  Batch a(one, {closet()}), b(many, {closet()});
  a.set_pose(at, {});
  b.set_pose(at, {});
  for (int i = 0; i < 5; ++i) a.move(at, {});
  b.move(at, {});
  EXPECT_TRUE(same_bits(a.state().bodies.position, b.state().bodies.position));
  EXPECT_TRUE(same_bits(a.state().bodies.quat_wxyz, b.state().bodies.quat_wxyz));
  EXPECT_TRUE(same_bits(a.state().position, b.state().position));
}

// The drones of an env are pushed whether the call moves them or not.
TEST(Bodies, PushDronesThatACallDoesNotMove) {
  BatchConfig config{.drones_per_env = 2, .bodies = {body_at({1, 1, 0.75F}, {2, 0, 0}, BodyShape::sphere)}};
  Batch batch(config, {closet()});
  batch.set_pose(std::vector<float>{0.2F, 0.2F, 0.75F, 1.7F, 1.0F, 0.75F}, {});
  const float before = batch.state().position[3];
  batch.move({}, {}, std::vector<std::uint8_t>{1, 0});
  EXPECT_EQ(batch.state().contact.body[0], -1);
  EXPECT_EQ(batch.state().contact.body[1], 0);
  EXPECT_GT(batch.state().position[3], before);
}

// -- Models of the bodies that calls spawn: a batch keeps those that its slots hold.

BodyConfig ball_of(float diameter) { return {.shape = BodyShape::sphere, .size_m = {diameter, diameter, diameter}}; }

TEST(BodyModels, SpawningForeverDoesNotGrowTheSnapshot) {
  BatchConfig config{.num_envs = 2, .bodies = {ball_of(5.0F)}, .max_bodies = 4};
  Batch batch(config, {closet()});
  batch.bodies().spawn(ball_of(0.125F));  // stays in slot 1 of both envs
  std::size_t after_a_hundred = 0;
  for (int i = 0; i < 3000; ++i) {
    const float diameter = 0.2F + 1e-4F * static_cast<float>(i);
    const std::vector<std::int64_t> slots = batch.bodies().spawn(ball_of(diameter));
    ASSERT_EQ(slots, (std::vector<std::int64_t>{2, 2}));
    ASSERT_EQ(batch.bodies().config(EnvIndex(1), 0)->size_m[0], 5.0F);
    ASSERT_EQ(batch.bodies().config(EnvIndex(1), 1)->size_m[0], 0.125F);
    ASSERT_EQ(batch.bodies().config(EnvIndex(1), 2)->size_m[0], diameter);
    if (i == 2999) break;
    batch.bodies().remove(std::vector<std::uint8_t>{0, 0, 1, 0, 0, 0, 1, 0});
    if (i == 100) after_a_hundred = batch.snapshot().size();
  }
  const std::string blob = batch.snapshot();
  EXPECT_LT(blob.size(), 2 * after_a_hundred);
  Batch twin(config, {closet()});
  twin.restore(blob);
  EXPECT_EQ(twin.bodies().config(EnvIndex(0), 0)->size_m[0], 5.0F);
  EXPECT_EQ(twin.bodies().config(EnvIndex(0), 1)->size_m[0], 0.125F);
  EXPECT_EQ(twin.bodies().config(EnvIndex(1), 2)->size_m[0], 0.2F + 1e-4F * 2999.0F);
  EXPECT_EQ(twin.snapshot(), blob);
}

// -- Batches in worlds with bodies: steps allocate nothing, and no env depends on others.

// Worlds with 2, 3, ... bodies.
Batch::Worlds four_playgrounds() {
  Batch::Worlds worlds;
  for (int i = 0; i < 4; ++i) worlds.push_back(flockstep::playground({.seed = static_cast<std::uint64_t>(i), .movers = 2 + i}));
  return worlds;
}

NavigationBatch in_living_worlds(int num_envs) {
  NavigationBatch config = navigation_batch(num_envs);
  config.episode.max_episode_steps = 20;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.random_world = true;
  config.bodies = {BodyConfig()};
  config.bodies[0].position_m = {-50, 0, 0};  // outside of the room
  return config;
}

TEST(BatchInWorldsWithBodies, AStepAllocatesNothing) {
  Batch batch = in_living_worlds(64).make(four_playgrounds());
  EXPECT_EQ(batch.bodies().per_env(), 6U);
  batch.reset({});
  const auto actions = discrete_actions(150, 64);
  for (std::size_t i = 0; i < 50; ++i) batch.step(actions[i]);
  const std::uint64_t before = allocations();
  for (std::size_t i = 50; i < 150; ++i) batch.step(actions[i]);
  EXPECT_EQ(allocations() - before, 0U);
}

TEST(BatchInWorldsWithBodies, EveryEnvHasThoseOfItsWorldAndTheConfiguration) {
  Batch batch = in_living_worlds(64).make(four_playgrounds());
  batch.reset({});
  const auto actions = discrete_actions(60, 64);
  for (std::size_t i = 0; i < 60; ++i) {
    batch.step(actions[i]);
    for (std::size_t env = 0; env < 64; ++env) {
      const auto of_world = static_cast<std::size_t>(2 + batch.state().world_index[env]);
      for (std::size_t body = 0; body < 6; ++body) {
        ASSERT_EQ(batch.state().bodies.active[6 * env + body] != 0, body <= of_world) << "step " << i << ", env " << env;
      }
      ASSERT_EQ(batch.state().bodies.position[3 * (6 * env + of_world)], -50.0F);
    }
  }
}

TEST(BatchInWorldsWithBodies, EnvsDoNotDependOnOthers) { expect_envs_alone(in_living_worlds(50), four_playgrounds(), 10, 80); }

}  // namespace
}  // namespace flockstep
