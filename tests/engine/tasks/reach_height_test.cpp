// An external task, tests/tasks/reach_height.cpp, in a batch.
#include "../tasks/reach_height.cpp"

#include "episodes.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kEnvs = 10;

// Two shafts of different heights. A flight may end at any of their sides.
Batch::Worlds shafts() {
  static const Batch::Worlds worlds{
      make_world({primitive(PrimitiveKind::room, {0, 0, 2}, {1.5F, 1.5F, 2})}, {.start = Vec3(0, 0, 1)}),
      make_world({primitive(PrimitiveKind::room, {0, 0, 4}, {1.25F, 1.25F, 4})}, {.start = Vec3(0.25F, 0, 2)})};
  return worlds;
}

struct ReachHeightBatch : BatchConfig {
  Batch make(Batch::Worlds worlds = shafts()) const {
    return Batch(*this, std::move(worlds), std::unique_ptr<Task>(flockstep_make_task()));
  }
};

ReachHeightBatch config_of(std::size_t num_envs, AutoresetMode mode = AutoresetMode::disabled) {
  ReachHeightBatch config{{.num_envs = static_cast<int>(num_envs), .num_threads = 1}};
  config.episode.autoreset_mode = mode;
  return config;
}

// Mainly upwards, with random sideways motion.
std::vector<float> random_actions(Random& random, std::size_t num_envs) {
  std::vector<float> actions;
  for (std::size_t i = 0; i < num_envs; ++i) {
    actions.insert(actions.end(), {random.within(-1.2F, 1.2F), random.within(-1.2F, 1.2F), random.within(-0.5F, 1.2F)});
  }
  return actions;
}

TEST(ReachHeight, SaysWhatItIs) {
  const std::unique_ptr<Task> task(flockstep_make_task());
  EXPECT_EQ(task->spec().action.shape, (std::vector<std::int64_t>{3}));
  ASSERT_EQ(task->spec().observation.size(), 1U);
  EXPECT_EQ(task->spec().observation[0].name, "height");
  EXPECT_EQ(task->spec().reward_terms, (std::vector<std::string>{"closer", "arrived"}));
  EXPECT_EQ(task->defaults().worlds, "train");
  EXPECT_TRUE(task->defaults().batch.lidars.empty());
  EXPECT_TRUE(task->defaults().batch.cameras.empty());
  EXPECT_EQ(task->defaults().max_episode_steps, 200);
}

TEST(ReachHeight, ClimbingArrives) {
  Batch batch = config_of(1).make();
  batch.reset({});
  EXPECT_EQ(values_of(batch.outputs().observation[0]), (std::vector<float>{2, 1}));
  for (int step = 1; step <= 8; ++step) {
    EXPECT_FALSE(batch.outputs().terminated[0]);
    batch.step(std::vector<float>{0, 0, 1});
    const float risen = 0.25F * static_cast<float>(step);
    EXPECT_EQ(values_of(batch.outputs().observation[0]), (std::vector<float>{2 - risen, 1 + risen}));
    EXPECT_EQ(batch.outputs().reward_terms, (AlignedVector<float>{0.25F, step == 8 ? 1.0F : 0.0F}));
  }
  EXPECT_TRUE(batch.outputs().terminated[0]);
  EXPECT_TRUE(batch.outputs().success[0]);
  EXPECT_FALSE(batch.outputs().crashed[0]);
  EXPECT_EQ(batch.outputs().reward[0], 1.25F);
  EXPECT_EQ(batch.outputs().episode_return[0], 3.0);
  EXPECT_EQ(batch.outputs().episode_terms, (AlignedVector<double>{2.0, 1.0}));
}

TEST(ReachHeight, ATenthOfAMetreOffCounts) {
  for (const float off : {0.125F, 0.0625F, -0.0625F, -0.125F}) {
    Batch batch = config_of(1).make();
    batch.reset({});
    batch.set_pose(std::vector<float>{0, 0, 3.0F - off}, {});
    batch.step(std::vector<float>{0, 0, 0});
    EXPECT_EQ(batch.outputs().terminated[0], std::abs(off) < 0.1F);
    EXPECT_EQ(batch.outputs().success[0], std::abs(off) < 0.1F);
  }
}

TEST(ReachHeight, AContactEndsTheEpisode) {
  Batch batch = config_of(1).make();
  batch.reset({});
  for (int step = 1; step <= 6 && !batch.outputs().terminated[0]; ++step) batch.step(std::vector<float>{9, 0, 0});
  EXPECT_TRUE(batch.outputs().terminated[0]);
  EXPECT_TRUE(batch.outputs().crashed[0]);
  EXPECT_FALSE(batch.outputs().success[0]);
  EXPECT_EQ(batch.outputs().reward_terms[1], 0.0F);
  EXPECT_EQ(batch.outputs().episode_length[0], 5) << "1.5 m to the wall, 0.465 m to the nose";
}

TEST(ReachHeight, ItsLimitHoldsIfTheBatchSetsNone) {
  ReachHeightBatch config = config_of(1);
  const auto length_of = [&] {
    Batch batch = config.make();
    batch.reset({});
    while (!batch.outputs().truncated[0]) batch.step(std::vector<float>{0, 0, 0});
    return batch.outputs().episode_length[0];
  };
  EXPECT_EQ(length_of(), 200);
  config.episode.max_episode_steps = 7;
  EXPECT_EQ(length_of(), 7);
}

TEST(ReachHeight, IsResetInEveryMode) {
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    SCOPED_TRACE(static_cast<int>(mode));
    Batch batch = config_of(kEnvs, mode).make();
    batch.reset({});
    Random random(1);
    std::vector<std::uint8_t> ended(kEnvs);
    std::size_t arrived = 0;
    std::size_t crashed = 0;
    for (int step = 0; step < 300; ++step) {
      batch.step(random_actions(random, kEnvs));
      const Outputs& out = batch.outputs();
      const auto begins = [&](std::size_t env) {  // matches the first observation of an episode
        const auto seen = batch.outputs().observation[0].row<float>(env);
        const Vec3 start = *batch.worlds()[static_cast<std::size_t>(batch.state().world_index[env])]->markers().start;
        return seen[0] == 2.0F && seen[1] == start.z() && Vec3(&batch.state().position[3 * env]) == start;
      };
      for (std::size_t env = 0; env < kEnvs; ++env) {
        EXPECT_NEAR(out.reward[env], out.reward_terms[2 * env] + out.reward_terms[2 * env + 1], 1e-6);
        if (ended[env] && mode == AutoresetMode::next_step) {
          EXPECT_TRUE(begins(env));
          EXPECT_EQ(out.reward[env], 0.0F);
        }
        ended[env] = out.terminated[env] || out.truncated[env];
        arrived += out.success[env];
        crashed += out.crashed[env];
        if (ended[env] && mode == AutoresetMode::same_step) {
          EXPECT_TRUE(begins(env));
          EXPECT_NE(out.final_observation[0].row<float>(env)[0], 2.0F);
        }
        if (ended[env]) {
          EXPECT_NE(out.success[env], out.crashed[env]) << "there is no other end in time";
        }
      }
      if (mode != AutoresetMode::disabled) continue;
      batch.reset({}, ended);
      for (std::size_t env = 0; env < kEnvs; ++env) EXPECT_TRUE(!ended[env] || begins(env));
    }
    EXPECT_GT(arrived, kEnvs);
    EXPECT_GT(crashed, kEnvs);
  }
}

TEST(ReachHeight, AnEnvOfManyEqualsASingleEnv) {
  ReachHeightBatch config = config_of(kEnvs, AutoresetMode::same_step);
  config.pose_sensor.position_noise_std_m = 0.01F;
  config.episode.frame_skip = 2;
  config.episode.max_episode_steps = 40;
  config.clock.physics_hz = 3.0F * config.clock.policy_hz;
  const auto own = [](std::size_t env) { return Batch::Worlds{shafts()[env % 2]}; };
  expect_many_equal_single(config, shafts(), own, 100, [](Random& random) { return random_actions(random, kEnvs); });
}

TEST(ReachHeight, RestoredIsUninterrupted) {
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step}) {
    Batch one = config_of(kEnvs, mode).make();
    one.reset({});
    Random random(3);
    for (int step = 0; step < 23; ++step) one.step(random_actions(random, kEnvs));
    one.remove(std::vector<std::int64_t>{4});
    const std::string blob = one.snapshot();
    Batch other = config_of(kEnvs, mode).make();
    other.restore(blob);
    EXPECT_TRUE(other.snapshot() == blob);
    for (const char* array : {"target", "last"}) {
      ASSERT_EQ(task_array<float>(one, array).size(), kEnvs);
      EXPECT_TRUE(same_bits(task_array<float>(one, array), task_array<float>(other, array)));
    }
    for (int step = 0; step < 60; ++step) {
      const std::vector<float> actions = random_actions(random, kEnvs);
      for (Batch* batch : {&one, &other}) batch->step(actions);
      ASSERT_TRUE(same_drones(one, other)) << "step " << step;
    }
    one.restore(blob);
    EXPECT_TRUE(one.snapshot() == blob);
  }
}

TEST(ReachHeight, ASpawnedDroneRisesFromItsPosition) {
  Batch batch = config_of(3).make();
  batch.reset({});
  batch.remove(std::vector<std::int64_t>{1});
  EXPECT_EQ(batch.outputs().observation[0].row<float>(1)[0], 0.0F);
  batch.step(std::vector<float>(9, 0.5F));
  EXPECT_EQ(batch.outputs().observation[0].row<float>(1)[1], 0.0F) << "a removed one reads as absent";
  batch.spawn(std::vector<std::int64_t>{1}, std::vector<float>{0, 0, 3}, {}, {});
  EXPECT_EQ(batch.outputs().observation[0].row<float>(1)[0], 2.0F);
  EXPECT_EQ(batch.outputs().observation[0].row<float>(1)[1], 3.0F);
}

TEST(ReachHeight, InvalidInputIsRefused) {
  Batch batch = config_of(2).make();
  EXPECT_THROW(batch.step(std::vector<float>(6)), std::logic_error) << "before the first reset";
  batch.reset({});
  const std::string before = batch.snapshot();
  EXPECT_REFUSED(batch.step(std::vector<std::int64_t>{0, 1}), "actions: ... floating-point");
  EXPECT_REFUSED(batch.step(std::vector<float>(5)), "actions: ... 6 ... 5");
  EXPECT_REFUSED(batch.step(std::vector<float>{0, 0, 0, 0, std::nanf(""), 0}), "actions (row 1): ... numbers");
  EXPECT_REFUSED(batch.restore(Batch(config_of(2), shafts()).snapshot()), "one of a batch with the same configuration");
  EXPECT_TRUE(batch.snapshot() == before);
}

}  // namespace
}  // namespace flockstep
