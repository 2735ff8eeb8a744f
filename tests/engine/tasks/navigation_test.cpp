#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "batch_helpers.hpp"
#include "collide.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/tasks.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using testing::bytes_of;
using testing::closet;
using testing::make_world;
using testing::navigation_batch;
using testing::NavigationBatch;
using testing::primitive;
using testing::Random;
using testing::row;
using testing::same_bits;
using testing::same_drone;
using testing::same_drones;
using testing::values_of;

// Positions and steps that are exact in float32, so that radii are hit exactly.
constexpr float kStep = 0.125F;
const Vec3 kStart(5, 10, 5);
const Vec3 kFirst(7, 10, 5);
const Vec3 kSecond(7, 13, 5);
const Vec3 kGoal(10, 13, 5);

// An empty hall of 20 x 20 x 10 m. In its middle nothing is within the LiDAR's range of 3 m.
std::shared_ptr<const World> hall(std::vector<Vec3> waypoints = {kFirst, kSecond}, const Vec3& goal = kGoal) {
  return make_world({primitive(PrimitiveKind::room, {10, 10, 5}, {10, 10, 5})},
                    {.start = kStart, .waypoints = std::move(waypoints), .goal = goal});
}

NavigationBatch one_drone(const LidarConfig& lidar = {}) {
  NavigationBatch config = navigation_batch(1, lidar);
  config.navigation.step_m = kStep;
  config.episode.autoreset_mode = AutoresetMode::disabled;  // keeps the final state visible
  return config;
}

// The order of NavigationReward's weights.
enum Term { kDistance, kCrash, kFreeSpace, kStepNumber, kActionChange, kOvershoot, kNumTerms };
using Terms = std::array<float, kNumTerms>;

class Flight {
 public:
  explicit Flight(const NavigationBatch& config, const std::shared_ptr<const World>& world = hall())
      : batch(config.make({world})) {
    batch.reset({});
  }

  void put(const Vec3& position, const Quat& q = Quat::Identity()) {
    batch.set_pose(std::span(position.data(), 3), std::vector<float>{q.w(), q.x(), q.y(), q.z()});
  }
  // Takes a step and returns the terms of its reward.
  Terms step(std::int64_t action) {
    batch.step(std::span<const std::int64_t>(&action, 1));
    return terms();
  }
  Terms step(const std::vector<float>& action) {
    batch.step(std::span<const float>(action));
    return terms();
  }
  Vec3 position() const { return Vec3(batch.state().position.data()); }
  std::int32_t goal_index() const { return testing::task_array<std::int32_t>(batch, "goal_index")[0]; }
  std::vector<float> observation() const { return values_of(out().observation[0]); }
  const Outputs& out() const { return batch.outputs(); }

  Batch batch;

 private:
  Terms terms() const {
    Terms terms{};
    std::copy(out().reward_terms.begin(), out().reward_terms.end(), terms.begin());
    double sum = 0.0;
    for (const float term : terms) sum += static_cast<double>(term);
    EXPECT_NEAR(static_cast<double>(out().reward[0]), sum, 1e-6 * std::max(1.0, std::abs(sum)));
    return terms;
  }
};

void expect_flags(const Flight& flight, bool terminated, bool truncated, bool success, bool crashed) {
  EXPECT_EQ(flight.out().terminated[0], terminated);
  EXPECT_EQ(flight.out().truncated[0], truncated);
  EXPECT_EQ(flight.out().success[0], success);
  EXPECT_EQ(flight.out().crashed[0], crashed);
}

void expect_goal_direction(const Flight& flight, const Vec3& in_body) {
  const Vec3 seen(flight.observation().data());
  EXPECT_LT((seen - in_body.normalized()).norm(), 1e-6F) << seen.transpose();
}

// -- Reward.

TEST(NavigationReward, OfAFlightInTheOpenByHand) {
  Flight flight(one_drone());
  // From 2 m to 1.875 m before the first waypoint: 12.5 cm closer, all ranges 1, step number 0. The first action counts as a
  // change.
  auto terms = flight.step(0);
  EXPECT_EQ(terms, (Terms{12.5F, 0.0F, 1.0F, 0.0F, -1.0F, 0.0F}));
  EXPECT_EQ(flight.out().reward[0], 12.5F);
  // Same action: no change, step number 1.
  terms = flight.step(0);
  EXPECT_FLOAT_EQ(terms[kStepNumber], -1.0F / 3000.0F);
  EXPECT_EQ(terms[kActionChange], 0.0F);
  EXPECT_FLOAT_EQ(flight.out().reward[0], 13.5F - 1.0F / 3000.0F);
  // Sideways, from (1.75, 0) to (1.75, -0.125) m off: slightly farther.
  terms = flight.step(2);
  EXPECT_FLOAT_EQ(terms[kDistance], static_cast<float>(100.0 * (1.75 - std::hypot(1.75, 0.125))));
  EXPECT_FLOAT_EQ(terms[kStepNumber], -2.0F / 3000.0F);
  EXPECT_EQ(terms[kActionChange], -1.0F);
  // Straight back.
  terms = flight.step(1);
  EXPECT_FLOAT_EQ(terms[kDistance], static_cast<float>(100.0 * (std::hypot(1.75, 0.125) - std::hypot(1.875, 0.125))));
  expect_flags(flight, false, false, false, false);
}

TEST(NavigationReward, AWeightScalesOnlyItsTerm) {
  // The second step of a flight into a corner beyond the goal, where every term is nonzero.
  const auto terms_with = [](float NavigationReward::* weight, float value) {
    NavigationBatch config = one_drone();
    NavigationReward& reward = config.navigation.reward;
    reward = {.distance_weight = 0, .crash_weight = 0, .free_space_weight = 0, .step_weight = 0, .action_change_weight = 0};
    reward.*weight = value;
    Flight flight(config, hall({}, {15, 10, 5}));
    flight.step(0);
    flight.put({19.5F, 4, 5});
    return flight.step(3);
  };
  const std::vector<float NavigationReward::*> weights{
      &NavigationReward::distance_weight, &NavigationReward::crash_weight,         &NavigationReward::free_space_weight,
      &NavigationReward::step_weight,     &NavigationReward::action_change_weight, &NavigationReward::overshoot_weight};
  for (std::size_t k = 0; k < weights.size(); ++k) {
    SCOPED_TRACE(k);
    const auto once = terms_with(weights[k], 1.0F);
    const auto thrice = terms_with(weights[k], -3.0F);
    EXPECT_NE(once[k], 0.0F);
    for (std::size_t j = 0; j < weights.size(); ++j) {
      if (j == k) {
        EXPECT_FLOAT_EQ(thrice[j], -3.0F * once[j]);
      } else {
        EXPECT_EQ(once[j], 0.0F) << j;
        EXPECT_EQ(thrice[j], 0.0F) << j;
      }
    }
  }
}

TEST(NavigationReward, AWaypointIsReachedWithinTheRadius) {
  for (const bool carry_over_distance : {false, true}) {
    SCOPED_TRACE(carry_over_distance);
    NavigationBatch config = one_drone();
    config.navigation.reward.carry_over_distance = carry_over_distance;
    Flight flight(config);
    flight.put({6.25F, 10, 5});
    EXPECT_EQ(flight.step(0)[kDistance], 100.0F * (2.0F - 0.625F));  // at 0.625 m: not reached yet
    EXPECT_EQ(flight.goal_index(), 0);
    // At exactly 0.5 m the term is R * share / 2 waypoints, and the second waypoint becomes the target.
    EXPECT_FLOAT_EQ(flight.step(0)[kDistance], 500.0F);
    EXPECT_EQ(flight.goal_index(), 1);
    expect_flags(flight, false, false, false, false);
    expect_goal_direction(flight, {0.5F, 3, 0});
    const double last = carry_over_distance ? 0.5 : std::hypot(0.5, 3.0);
    EXPECT_FLOAT_EQ(flight.step(0)[kDistance], static_cast<float>(100.0 * (last - std::hypot(0.375, 3.0))));
    EXPECT_EQ(flight.goal_index(), 1);
  }
}

TEST(NavigationReward, TheGoalCountsAfterTheWaypoints) {
  Flight flight(one_drone());
  flight.put(kGoal);
  EXPECT_LT(flight.step(0)[kDistance], 0.0F);  // the waypoints come first: only the distance to the first one grows
  expect_flags(flight, false, false, false, false);
  for (const Vec3& waypoint : {kFirst, kSecond}) {
    flight.put(waypoint);
    flight.step(0);
  }
  EXPECT_EQ(flight.goal_index(), 2);
  expect_goal_direction(flight, {3 - kStep, 0, 0});
  flight.put(kGoal - Vec3(0.75F, 0, 0));
  EXPECT_FLOAT_EQ(flight.step(0)[kDistance], 100.0F * (3.0F - kStep - 0.625F));
  expect_flags(flight, false, false, false, false);
  EXPECT_EQ(flight.step(0)[kDistance], 10000.0F);
  expect_flags(flight, true, false, true, false);
  EXPECT_EQ(flight.goal_index(), 2);
}

TEST(NavigationReward, ACrashCostsWhatTheGoalEarnsAndIsNoSuccess) {
  Flight flight(one_drone());
  flight.put({19.5F, 10, 5});  // the nose is 0.465 m ahead of the centre, the wall at x = 20
  EXPECT_EQ(flight.step(0)[kCrash], -10000.0F);
  expect_flags(flight, true, false, false, true);
  EXPECT_LT(flight.position().x(), 20.0F - 0.465F);

  Flight arrived(one_drone(), hall({}, {19.75F, 10, 5}));
  arrived.put({19.5F, 10, 5});
  const auto terms = arrived.step(0);
  EXPECT_EQ(terms[kDistance], 10000.0F);
  EXPECT_EQ(terms[kCrash], -10000.0F);
  expect_flags(arrived, true, false, false, true);
}

TEST(NavigationReward, NearnessAndFreeSpaceByHandForAnyNearBeam) {
  // One beam hits a wall 0.5 m ahead, the others point sideways into the open: the ranges l are 1/6 and 1. M is 0.2.
  for (std::size_t beams = 1; beams <= 9; ++beams) {
    for (std::size_t near = 0; near < beams; ++near) {
      SCOPED_TRACE(std::to_string(near) + " of " + std::to_string(beams));
      LidarConfig lidar;
      lidar.azimuth_deg.assign(beams, 90.0F);
      lidar.elevation_deg.assign(beams, 0.0F);
      lidar.azimuth_deg[near] = 0.0F;
      Flight flight(one_drone(lidar));
      flight.put({19.5F, 10 - kStep, 5});
      const auto terms = flight.step(2);
      const double nearest = 0.5 / 3.0;
      const auto count = static_cast<double>(beams);
      EXPECT_FLOAT_EQ(terms[kCrash], static_cast<float>(nearest - 0.2));
      const double sum = (nearest / 0.2 - 1.0) + (count - 1.0) * (1.0 / 0.2 - 1.0);
      EXPECT_NEAR(terms[kFreeSpace], sum / (count / 0.2 - count), 1e-6);
      expect_flags(flight, false, false, false, false);
    }
  }
}

TEST(NavigationReward, ClearanceAtTheLimitCostsNothing) {
  LidarConfig lidar{.max_range_m = 4.0F, .azimuth_deg = {0}, .elevation_deg = {0}};
  NavigationBatch config = one_drone(lidar);
  config.navigation.reward.min_clearance = 0.25F;
  Flight flight(config);
  flight.put({19, 10, 5});
  EXPECT_EQ(flight.step(2)[kCrash], 0.0F);  // at 1 m of 4 m
  flight.put({18.875F, 10, 5});
  EXPECT_FLOAT_EQ(flight.step(0)[kCrash], 0.0F);
  EXPECT_FLOAT_EQ(flight.step(0)[kCrash], 0.875F / 4.0F - 0.25F);
}

TEST(NavigationReward, AnActionIsAChangeIfAnyComponentIs) {
  NavigationBatch config = one_drone();
  config.navigation.action = ActionKind::displacement_yaw;
  Flight flight(config);
  const std::vector<float> action{0.1F, 0.2F, 0.3F, 0.4F};
  EXPECT_EQ(flight.step(action)[kActionChange], -1.0F);
  EXPECT_EQ(flight.step(action)[kActionChange], 0.0F);
  for (std::size_t k = 0; k < 4; ++k) {
    std::vector<float> other = action;
    other[k] += 0.5F;
    EXPECT_EQ(flight.step(other)[kActionChange], -1.0F) << k;
    EXPECT_EQ(flight.step(action)[kActionChange], -1.0F) << k;
    EXPECT_EQ(flight.step(action)[kActionChange], 0.0F) << k;
  }
  flight.batch.reset({});
  EXPECT_EQ(flight.step(action)[kActionChange], -1.0F);  // first action of an episode
}

TEST(NavigationReward, OvershootingTheGoal) {
  for (const float weight : {1.0F, 0.0F, 0.5F}) {
    SCOPED_TRACE(weight);
    NavigationBatch config = one_drone();
    config.navigation.reward.overshoot_weight = weight;
    Flight flight(config);
    flight.put({7.375F, 15, 5});
    EXPECT_EQ(flight.step(0)[kOvershoot], 0.0F);  // x is 7.5, the waypoint's x plus the radius: not beyond it
    expect_flags(flight, false, false, false, false);
    EXPECT_EQ(flight.step(0)[kOvershoot], -1000.0F * weight);
    expect_flags(flight, weight != 0.0F, false, false, false);
  }
}

TEST(NavigationReward, ScalesAndSharesAreAsConfigured) {
  NavigationBatch config = one_drone();
  config.navigation.reward.goal_reward = 64.0F;
  config.navigation.reward.waypoint_share = 0.5F;
  config.navigation.reward.goal_radius_m = 1.0F;
  config.navigation.reward.step_scale = 8.0F;
  Flight flight(config);
  flight.step(0);
  EXPECT_EQ(flight.step(0)[kStepNumber], -0.125F);
  flight.put({6 - kStep, 10, 5});
  EXPECT_EQ(flight.step(0)[kDistance], 16.0F);
  flight.put({7, 12 - kStep, 5});
  EXPECT_EQ(flight.step(2)[kDistance], 16.0F);
  flight.put({9 - kStep, 13, 5});
  EXPECT_EQ(flight.step(0)[kDistance], 64.0F);
  expect_flags(flight, true, false, true, false);
}

// -- Actions.

TEST(NavigationAction, DiscreteOnesAreStepsAlongTheBodysAxes) {
  Flight flight(one_drone());
  // Rotated a quarter turn to the left: forward is +y, left is -x.
  const Quat left(Eigen::AngleAxisf(std::numbers::pi_v<float> / 2.0F, Vec3::UnitZ()));
  const std::array<Vec3, 6> along{Vec3(0, 1, 0), Vec3(0, -1, 0), Vec3(-1, 0, 0), Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, 0, -1)};
  for (std::size_t action = 0; action < 6; ++action) {
    flight.put(kStart, left);
    flight.step(static_cast<std::int64_t>(action));
    EXPECT_LT((flight.position() - kStart - kStep * along[action]).norm(), 1e-6F) << action;
  }
  expect_goal_direction(flight, left.conjugate() * (kFirst - flight.position()));
}

TEST(NavigationAction, DisplacementsAreClipped) {
  NavigationBatch config = one_drone();
  config.navigation.action = ActionKind::displacement;
  Flight flight(config);
  flight.step({0.5F, -0.25F, 1.0F});
  EXPECT_EQ(flight.position(), Vec3(5.0625F, 9.96875F, 5.125F));
  flight.put(kStart);
  flight.step({7.0F, -9.0F, 0.0F});
  EXPECT_EQ(flight.position(), Vec3(5 + kStep, 10 - kStep, 5));
}

TEST(NavigationAction, AYawTurnsAfterTheStep) {
  NavigationBatch config = one_drone();
  config.navigation.action = ActionKind::displacement_yaw;
  config.navigation.yaw_step_deg = 30.0F;
  Flight flight(config);
  const auto yaw_deg = [&] {
    const auto& q = flight.batch.state().quat_wxyz;
    return 2.0 * std::atan2(static_cast<double>(q[3]), static_cast<double>(q[0])) * 180.0 / std::numbers::pi;
  };
  flight.step({1, 0, 0, 1});
  EXPECT_EQ(flight.position(), Vec3(5 + kStep, 10, 5));
  EXPECT_NEAR(yaw_deg(), 30.0, 1e-4);
  flight.step({1, 0, 0, 5});  // clipped
  EXPECT_NEAR(flight.position().x(), 5.125 + 0.125 * std::cos(std::numbers::pi / 6.0), 1e-6);
  EXPECT_NEAR(flight.position().y(), 10.0 + 0.125 * 0.5, 1e-6);
  EXPECT_NEAR(yaw_deg(), 60.0, 1e-4);
  flight.step({0, 0, 0, -0.5F});
  EXPECT_NEAR(yaw_deg(), 45.0, 1e-4);
}

// -- Episodes.

TEST(NavigationEpisode, TruncationReturnAndLength) {
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
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
  // Actions are functions of (env, episode, step), so each env has the same episodes in every mode.
  constexpr std::size_t kDrones = 16;
  struct Row {
    std::vector<float> observation;
    float reward;
    std::uint8_t terminated, truncated;
    bool operator==(const Row&) const = default;
  };
  const auto live = [](AutoresetMode mode) {
    NavigationBatch config = lively(kDrones, mode);
    config.episode.random_world = true;
    Batch batch = config.make(lively_worlds());
    std::vector<std::uint64_t> seeds(kDrones);
    std::iota(seeds.begin(), seeds.end(), std::uint64_t{5});
    batch.reset(seeds);
    std::vector<std::vector<Row>> rows(kDrones);
    std::vector<std::uint64_t> episode(kDrones, 0);
    std::vector<std::uint64_t> step(kDrones, 0);
    std::vector<std::uint8_t> ended(kDrones, 0);
    std::vector<std::int64_t> actions(kDrones);
    const auto observe = [&](std::size_t i) {
      const auto seen = batch.outputs().observation[0].row<float>(i);
      rows[i].push_back({{seen.begin(), seen.end()}, 0.0F, 0, 0});
    };
    for (std::size_t i = 0; i < kDrones; ++i) observe(i);
    for (int time = 0; time < 150; ++time) {
      for (std::size_t i = 0; i < kDrones; ++i) {
        actions[i] = static_cast<std::int64_t>((i * 31 + episode[i] * 17 + step[i] * step[i] * 7 + step[i] / 3) % 6);
      }
      batch.step(std::span<const std::int64_t>(actions));
      const Outputs& out = batch.outputs();
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (mode == AutoresetMode::next_step && ended[i]) {  // reset row
          observe(i);
          ended[i] = 0;
          continue;
        }
        ended[i] = out.terminated[i] || out.truncated[i];
        const bool was_reset = ended[i] && mode == AutoresetMode::same_step;
        const auto seen = (was_reset ? out.final_observation : out.observation)[0].row<float>(i);
        rows[i].push_back({{seen.begin(), seen.end()}, out.reward[i], out.terminated[i], out.truncated[i]});
        ++step[i];
        if (!ended[i]) continue;
        ++episode[i];
        step[i] = 0;
        if (was_reset) observe(i);
      }
      if (mode != AutoresetMode::disabled) continue;
      if (std::find(ended.begin(), ended.end(), 1) == ended.end()) continue;
      batch.reset({}, ended);
      for (std::size_t i = 0; i < kDrones; ++i) {
        if (ended[i]) observe(i);
      }
    }
    return rows;
  };
  const auto next_step = live(AutoresetMode::next_step);
  for (const AutoresetMode mode : {AutoresetMode::same_step, AutoresetMode::disabled}) {
    const auto other = live(mode);
    for (std::size_t i = 0; i < kDrones; ++i) {
      const std::size_t count = std::min(next_step[i].size(), other[i].size());
      ASSERT_GT(count, 140U);
      const auto ends = std::count_if(other[i].begin(), other[i].end(), [](const Row& r) { return r.terminated || r.truncated; });
      EXPECT_GE(ends, 4);
      for (std::size_t k = 0; k < count; ++k) ASSERT_EQ(next_step[i][k], other[i][k]) << "env " << i << ", row " << k;
    }
  }
}

// -- Random worlds and starts.

TEST(NavigationRandom, WorldsAndStartsAreDrawnBySeed) {
  constexpr int kDrones = 300;
  const Batch::Worlds worlds{closet(), testing::playground("train-1"), testing::playground("train-2")};
  NavigationBatch config = lively(kDrones, AutoresetMode::same_step);
  config.episode.random_world = true;
  Batch batch = config.make(worlds);
  std::vector<std::uint64_t> seeds(kDrones);
  std::iota(seeds.begin(), seeds.end(), std::uint64_t{1000});
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
  constexpr std::size_t kDrones = 22;
  const Batch::Worlds worlds = lively_worlds();
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    for (const bool random_world : {false, true}) {
      SCOPED_TRACE("mode " + std::to_string(static_cast<int>(mode)) + (random_world ? ", random worlds" : ", own worlds"));
      NavigationBatch config = lively(kDrones, mode);
      config.episode.random_world = random_world;
      config.navigation.action = ActionKind::displacement_yaw;
      config.block_size = 4;
      config.num_threads = 2;
      Batch many = config.make(worlds);
      std::vector<std::uint64_t> seeds(kDrones);
      std::iota(seeds.begin(), seeds.end(), std::uint64_t{77});
      many.reset(seeds);
      config.num_envs = config.num_threads = 1;
      config.block_size = 64;
      std::vector<std::unique_ptr<Batch>> alone;
      for (std::size_t i = 0; i < kDrones; ++i) {
        const Batch::Worlds own = random_world ? worlds : Batch::Worlds{worlds[i % worlds.size()]};
        alone.push_back(std::make_unique<Batch>(config, own, make_task(config.navigation)));
        alone[i]->reset(std::span(seeds).subspan(i, 1));
      }
      Random random(2);
      std::vector<float> actions(4 * kDrones);
      std::map<std::string, int> ends;
      for (int step = 0; step < 200; ++step) {
        for (float& action : actions) action = random.within(-1.2F, 1.2F);
        many.step(std::span<const float>(actions));
        std::vector<std::uint8_t> mask(kDrones, 0);
        for (std::size_t i = 0; i < kDrones; ++i) {
          alone[i]->step(row(actions, i, 4));
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
        }
        for (std::size_t i = 0; i < kDrones; ++i) ASSERT_TRUE(same_drone(many, i, *alone[i], 0)) << "reset in step " << step;
      }
      for (const char* kind : {"crashed", "success", "truncated"}) EXPECT_GT(ends[kind], 0) << kind;
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
