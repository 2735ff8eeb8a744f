// Episodes, resets, random worlds and starts of the navigation task.
#include <set>

#include "collide.hpp"
#include "flockstep/generators.hpp"
#include "tasks/navigation_flight.hpp"

namespace flockstep {
namespace {

using namespace navigating;

// -- Episodes.

TEST(NavigationEpisode, TruncationReturnAndLength) {
  for (const AutoresetMode mode : kAutoresetModes) {
    SCOPED_TRACE(static_cast<int>(mode));
    NavigationBatch config = one_drone();
    config.episode.autoreset_mode = mode;
    config.episode.max_episode_steps = 4;
    Flight flight(config);
    for (int episode = 0; episode < 3; ++episode) {
      EXPECT_EQ(flight.batch.state().episode[0], episode);
      double sum = 0.0;
      for (int step = 1; step <= 4; ++step) {
        flight.step(step % 6);
        sum += static_cast<double>(flight.out().reward[0]);
        expect_flags(flight, false, step == 4, false, false);
        EXPECT_EQ(flight.out().episode_length[0], step);
        EXPECT_NEAR(flight.out().episode_return[0], sum, 1e-4);
      }
      if (mode == AutoresetMode::next_step) flight.step(0);
      if (mode == AutoresetMode::disabled) flight.batch.reset({});
      if (mode == AutoresetMode::same_step) continue;
      expect_flags(flight, false, false, false, false);
      EXPECT_EQ(flight.out().episode_length[0], 0);
      EXPECT_EQ(flight.out().episode_return[0], 0.0);
    }
  }
}

TEST(NavigationEpisode, ATerminationInTheLastStepIsNotATruncation) {
  NavigationBatch config = one_drone();
  config.episode.max_episode_steps = 2;
  Flight flight(config);
  flight.step(0);
  flight.put({19.5F, 10, 5});
  flight.step(0);
  expect_flags(flight, true, false, false, true);
}

TEST(NavigationEpisode, ZeroMeansNoLimit) {
  NavigationBatch config = one_drone();
  config.episode.max_episode_steps = 0;
  Flight flight(config);
  for (int step = 0; step < 5000; ++step) flight.step(4 + step % 2);
  expect_flags(flight, false, false, false, false);
  EXPECT_EQ(flight.out().episode_length[0], 5000);
}

TEST(NavigationEpisode, StaggeredLimitsApplyOnlyToTheFirstEpisode) {
  constexpr int kDrones = 300;
  constexpr int kLimit = 20;
  NavigationBatch config = one_drone();
  config.num_envs = kDrones;
  config.episode.autoreset_mode = AutoresetMode::same_step;
  config.episode.max_episode_steps = kLimit;
  config.episode.stagger_first_episode = true;
  const auto lengths = [&] {  // lengths of the first two episodes of each env
    Batch batch = config.make({hall()});
    batch.reset({});
    std::vector<std::vector<std::int64_t>> ended(kDrones);
    const std::vector<std::int64_t> up(kDrones, 4);
    const std::vector<std::int64_t> down(kDrones, 5);
    for (int step = 0; step < 2 * kLimit; ++step) {
      batch.step(std::span<const std::int64_t>(step % 2 == 0 ? up : down));
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (batch.outputs().truncated[i]) ended[i].push_back(batch.outputs().episode_length[i]);
      }
    }
    return ended;
  };
  const auto first = lengths();
  std::set<std::int64_t> seen;
  for (const auto& ended : first) {
    ASSERT_GE(ended.size(), 2U);
    seen.insert(ended[0]);
    EXPECT_EQ(ended[1], kLimit);
  }
  EXPECT_EQ(seen.size(), static_cast<std::size_t>(kLimit));  // all of 1 .. 20
  EXPECT_EQ(*seen.begin(), 1);
  EXPECT_EQ(*seen.rbegin(), kLimit);
  EXPECT_EQ(first, lengths());
}

// -- Autoreset.

NavigationBatch lively(int num_envs, AutoresetMode mode) {
  NavigationBatch config = navigation_batch(num_envs);
  config.pose_sensor = {.position_noise_std_m = 0.01F, .orientation_noise_std_deg = 0.5F};
  config.episode.max_episode_steps = 25;
  config.navigation.random_start = true;
  config.episode.stagger_first_episode = true;
  config.episode.autoreset_mode = mode;
  return config;
}

// Among 120 pillars rays go through Embree, in the other worlds they are traced directly.
Batch::Worlds lively_worlds() {
  static const auto one = flockstep::playground({.seed = 1, .pillars = 120});
  static const auto other = flockstep::playground({.seed = 2, .pillars = 120});
  return {closet(), one, hall(), other};
}

TEST(NavigationAutoreset, NextStepReturnsTheResetAndTakesNoAction) {
  NavigationBatch config = one_drone();
  config.episode.autoreset_mode = AutoresetMode::next_step;
  Flight flight(config);
  const std::vector<float> at_start = flight.observation();
  flight.put({19.5F, 10, 5});
  flight.step(0);
  expect_flags(flight, true, false, false, true);
  EXPECT_NE(flight.observation(), at_start);
  EXPECT_EQ(flight.observation(), values_of(flight.out().final_observation[0]));
  EXPECT_GT(flight.position().x(), 19.0F);
  flight.step(0);
  expect_flags(flight, false, false, false, false);
  EXPECT_EQ(flight.observation(), at_start);
  EXPECT_EQ(flight.out().reward[0], 0.0F);
  EXPECT_EQ(flight.out().reward_terms, AlignedVector<float>(kNumTerms, 0.0F));
  EXPECT_EQ(flight.position(), kStart);
  EXPECT_EQ(flight.batch.state().episode[0], 1);
  EXPECT_FALSE(flight.batch.state().contact.hit[0]);
}

TEST(NavigationAutoreset, SameStepReturnsTheResetAndKeepsTheLastObservation) {
  NavigationBatch config = one_drone();
  Flight disabled(config);
  config.episode.autoreset_mode = AutoresetMode::same_step;
  Flight flight(config);
  const std::vector<float> at_start = flight.observation();
  for (Flight* each : {&disabled, &flight}) {
    each->put({19.5F, 10, 5});
    each->step(0);
    expect_flags(*each, true, false, false, true);
  }
  EXPECT_EQ(flight.observation(), at_start);
  EXPECT_EQ(values_of(flight.out().final_observation[0]), disabled.observation());
  EXPECT_EQ(flight.out().reward, disabled.out().reward);
  EXPECT_EQ(flight.out().episode_length[0], 1);
  EXPECT_EQ(flight.position(), kStart);
  EXPECT_EQ(flight.batch.state().episode[0], 1);
  EXPECT_EQ(flight.step(0)[kStepNumber], 0.0F);  // the next step is the first of its episode
}

TEST(NavigationAutoreset, DisabledLeavesAFinishedEnvUnchanged) {
  constexpr std::size_t kDrones = 24;
  Batch batch = lively(kDrones, AutoresetMode::disabled).make(lively_worlds());
  batch.reset({});
  Random random(1);
  std::vector<std::int64_t> actions(kDrones);
  std::vector<std::vector<std::byte>> when_it_ended(kDrones);
  std::size_t held = 0;
  for (int step = 0; step < 200; ++step) {
    for (auto& action : actions) action = random.generator()() % 6;
    batch.step(std::span<const std::int64_t>(actions));
    Outputs& out = batch.outputs();
    for (std::size_t i = 0; i < kDrones; ++i) {
      if (!out.terminated[i] && !out.truncated[i]) continue;
      const auto terms = std::span(out.reward_terms).subspan(i * kNumTerms, kNumTerms);
      if (when_it_ended[i].empty()) {
        EXPECT_NE(out.reward[i], 0.0F);
        // Keep the row without its reward.
        const float reward = std::exchange(out.reward[i], 0.0F);
        const std::vector<float> kept(terms.begin(), terms.end());
        std::fill(terms.begin(), terms.end(), 0.0F);
        when_it_ended[i] = bytes_of(batch, i);
        out.reward[i] = reward;
        std::copy(kept.begin(), kept.end(), terms.begin());
        EXPECT_TRUE(same_bits(out.observation[0].row<float>(i), out.final_observation[0].row<float>(i)));
      } else {
        ++held;
        ASSERT_EQ(out.reward[i], 0.0F);
        ASSERT_TRUE(std::all_of(terms.begin(), terms.end(), [](float term) { return term == 0.0F; }));
        ASSERT_TRUE(bytes_of(batch, i) == when_it_ended[i]) << "env " << i << " changed after its end";
      }
    }
    // Occasionally reset some of the finished envs. The others must not change.
    if (step % 20 != 19) continue;
    std::vector<std::uint8_t> mask(kDrones, 0);
    for (std::size_t i = 0; i < kDrones; i += 2) mask[i] = !when_it_ended[i].empty();
    const std::vector<std::int64_t> episode = batch.state().episode;
    batch.reset({}, mask);
    for (std::size_t i = 0; i < kDrones; ++i) {
      EXPECT_EQ(batch.state().episode[i], episode[i] + mask[i]);
      if (mask[i]) {
        when_it_ended[i].clear();
        EXPECT_FALSE(batch.outputs().terminated[i] || batch.outputs().truncated[i]);
      } else if (!when_it_ended[i].empty()) {
        ASSERT_TRUE(bytes_of(batch, i) == when_it_ended[i]) << "env " << i;
      }
    }
  }
  EXPECT_GT(held, 500U);
}

TEST(NavigationAutoreset, ModesAgreeExceptInResetRows) {
  NavigationBatch config = lively(16, AutoresetMode::next_step);
  config.episode.random_world = true;
  expect_modes_agree(config, lively_worlds(), 150, [](std::uint64_t number) { return number % 6; }, 141, 4);
}

// -- Random worlds and starts.

TEST(NavigationRandom, WorldsAndStartsAreDrawnBySeed) {
  constexpr int kDrones = 300;
  const Batch::Worlds worlds{closet(), playground("train-1"), playground("train-2")};
  NavigationBatch config = lively(kDrones, AutoresetMode::same_step);
  config.episode.random_world = true;
  Batch batch = config.make(worlds);
  std::vector<std::uint64_t> seeds = seeds_from(1000, kDrones);
  batch.reset(seeds);
  const std::vector<std::int32_t> world_index = batch.state().world_index;
  const std::vector<float> position = batch.state().position;

  std::array<int, 3> visits{};
  for (std::size_t i = 0; i < kDrones; ++i) {
    const auto index = static_cast<std::size_t>(world_index[i]);
    ++visits[index];
    const Vec3 start(position.data() + 3 * i);
    const Aabb& box = worlds[index]->markers().spawn_box.value();
    EXPECT_TRUE((start.array() >= box.min.array()).all() && (start.array() <= box.max.array()).all()) << i;
    EXPECT_FALSE(testing::overlaps(*worlds[index], batch.drone(), {.position = start})) << i;
  }
  for (const int count : visits) EXPECT_NEAR(count, 100, 40);  // five standard deviations
  // The start is independent of the world: in each world, starts cover the whole box.
  for (std::int32_t world = 0; world < 3; ++world) {
    const Aabb& box = worlds[static_cast<std::size_t>(world)]->markers().spawn_box.value();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<Eigen::Index>(axis);
      if (box.max[k] <= box.min[k]) continue;
      float least = 1.0F;
      float greatest = 0.0F;
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (world_index[i] != world) continue;
        const float at = (position[3 * i + axis] - box.min[k]) / (box.max[k] - box.min[k]);
        least = std::min(least, at);
        greatest = std::max(greatest, at);
      }
      EXPECT_LT(least, 0.2F) << world << ' ' << axis;
      EXPECT_GT(greatest, 0.8F) << world << ' ' << axis;
    }
  }
  std::set<float> distinct;
  for (std::size_t i = 0; i < kDrones; ++i) distinct.insert(position[3 * i]);
  EXPECT_GT(distinct.size(), 290U);

  batch.reset({});  // advances to other episodes
  int stayed = 0;
  for (std::size_t i = 0; i < kDrones; ++i) stayed += position[3 * i] == batch.state().position[3 * i];
  EXPECT_LT(stayed, 10);
  EXPECT_NE(world_index, batch.state().world_index);
  const std::vector<float> second = batch.state().position;

  batch.reset(seeds);  // back to the first episodes
  EXPECT_EQ(world_index, batch.state().world_index);
  EXPECT_EQ(position, batch.state().position);
  batch.reset({});
  EXPECT_EQ(second, batch.state().position);

  Batch one_more = config.make(worlds);
  for (std::uint64_t& seed : seeds) ++seed;
  one_more.reset(seeds);
  EXPECT_TRUE(same_bits(std::span(one_more.state().position).first(3 * (kDrones - 1)), std::span(position).subspan(3)));
}

TEST(NavigationRandom, StartsTouchNothing) {
  // A pillar in the middle of the spawn box that takes about a tenth of it.
  const auto world =
      make_world({primitive(PrimitiveKind::room, {10, 10, 5}, {10, 10, 5}),
                  primitive(PrimitiveKind::cylinder, {10, 10, 5}, {0.25F, 0.25F, 5})},
                 {.start = kStart, .goal = kGoal, .spawn_box = Aabb{.min = Vec3(8.5F, 8.5F, 4), .max = Vec3(11.5F, 11.5F, 6)}});
  NavigationBatch config = one_drone();
  config.num_envs = 300;
  config.navigation.random_start = true;
  Batch batch = config.make({world});
  batch.reset({});
  for (std::size_t i = 0; i < 300; ++i) {
    const Vec3 start(batch.state().position.data() + 3 * i);
    EXPECT_FALSE(testing::overlaps(*world, batch.drone(), {.position = start})) << i;
    EXPECT_NE(start, kStart);
  }
}

TEST(NavigationRandom, WithoutABoxTheStartMarkerIsTaken) {
  NavigationBatch config = one_drone();
  config.navigation.random_start = true;
  Flight flight(config);
  EXPECT_EQ(flight.position(), kStart);
}

TEST(NavigationRandom, AnEnvOfManyEqualsASingleEnv) {
  const Batch::Worlds worlds = lively_worlds();
  for (const AutoresetMode mode : kAutoresetModes) {
    for (const bool random_world : {false, true}) {
      SCOPED_TRACE("mode " + std::to_string(static_cast<int>(mode)) + (random_world ? ", random worlds" : ", own worlds"));
      NavigationBatch config = lively(22, mode);
      config.episode.random_world = random_world;
      config.navigation.action = ActionKind::displacement_yaw;
      const auto own = [&](std::size_t env) { return random_world ? worlds : Batch::Worlds{worlds[env % worlds.size()]}; };
      expect_many_equal_single(config, worlds, own, 200, [](Random& random) {
        std::vector<float> actions(4 * 22);
        for (float& action : actions) action = random.within(-1.2F, 1.2F);
        return actions;
      });
    }
  }
}

// -- Worlds that are not navigable.

TEST(Navigation, RefusesAWorldWithoutMarkers) {
  const NavigationBatch config = one_drone();
  const std::vector<Primitive> room{primitive(PrimitiveKind::room, {10, 10, 5}, {10, 10, 5})};
  EXPECT_REFUSED(config.make({make_world(room, {.goal = kGoal})}), "start");
  EXPECT_REFUSED(config.make({make_world(room, {.start = kStart})}), "goal");
  EXPECT_REFUSED(config.make({hall(), make_world(room, {.start = Vec3(0.1F, 10, 5), .goal = kGoal})}), "start");
}

}  // namespace
}  // namespace flockstep
