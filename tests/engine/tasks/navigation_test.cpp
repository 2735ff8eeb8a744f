#include "tasks/navigation_flight.hpp"

namespace flockstep {
namespace {

using namespace navigating;

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

}  // namespace
}  // namespace flockstep
