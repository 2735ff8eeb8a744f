// The pose sensor as an estimate: drifts of position and yaw, and a velocity.
#include "flockstep/sensors/pose_sensor.hpp"
#include "resting_drones.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kEstimates = 1000;
constexpr std::size_t kEstimateSteps = 1000;

// The errors of the position's axes of all drones, one after another, at each reading.
std::vector<std::vector<double>> errors_of(const PoseSensorConfig& sensor) {
  BatchConfig config = resting(kEstimates);
  config.pose_sensor = sensor;
  Batch batch = make_resting(config);
  std::vector<std::vector<double>> errors;
  for (std::size_t step = 0; step <= kEstimateSteps; ++step) {
    step == 0 ? batch.sense() : read_next(batch);
    std::vector<double>& now = errors.emplace_back();
    for (std::size_t i = 0; i < 3 * kEstimates; ++i) {
      now.push_back(static_cast<double>(batch.pose_readings().position[i]) - static_cast<double>(batch.state().position[i]));
    }
  }
  return errors;
}

TEST(PoseDrift, WalksFromZero) {
  constexpr double kWalk = 0.2;
  const auto errors = errors_of({.position_random_walk = static_cast<float>(kWalk)});
  EXPECT_EQ(std::ranges::count(errors[0], 0.0), std::ssize(errors[0]));
  for (const std::size_t step : {1U, 100U, 1000U}) {
    EXPECT_TRUE(has_mean(errors[step], 0.0)) << step;
    const double variance = kWalk * kWalk * kReadingS * static_cast<double>(step);
    EXPECT_TRUE(has_mean(products(errors[step], errors[step]), variance)) << step;
  }
  EXPECT_TRUE(has_mean(products(errors[100], errors[1000]), kWalk * kWalk * kReadingS * 100.0)) << "the steps are independent";
  expect_allan(errors, [](std::size_t k) { return allan_variance_of_walk(kWalk * kWalk * kReadingS, k); });
}

TEST(PoseDrift, ApproachesTheGaussMarkovProcess) {
  constexpr double kStd = 0.5, kTimeS = 2.0;
  const auto errors = errors_of({.drift_std_m = 0.5F, .drift_time_s = 2.0F});
  EXPECT_EQ(std::ranges::count(errors[0], 0.0), std::ssize(errors[0]));
  const auto covariance = [](double readings) { return kStd * kStd * std::exp(-readings * kReadingS / kTimeS); };
  for (const std::size_t step : {10U, 40U, 1000U}) {
    EXPECT_TRUE(has_mean(errors[step], 0.0)) << step;
    EXPECT_TRUE(has_mean(products(errors[step], errors[step]), covariance(0) - covariance(2.0 * static_cast<double>(step))))
        << step;
  }
  for (const std::size_t lag : {0U, 1U, 40U, 200U}) {
    std::vector<double> found(errors[0].size());  // of each axis, over many times
    for (std::size_t step = 300; step + lag <= kEstimateSteps; ++step) {
      const double share = 1.0 / static_cast<double>(kEstimateSteps - lag - 299);
      for (std::size_t i = 0; i < found.size(); ++i) found[i] += share * errors[step][i] * errors[step + lag][i];
    }
    EXPECT_TRUE(has_mean(found, covariance(static_cast<double>(lag)))) << lag;
  }
  expect_allan_of(std::span(errors).subspan(300), covariance);
}

TEST(PoseDrift, IsIndependentOfTheNoise) {
  const PoseSensorConfig noise{.position_noise_std_m = 0.1F, .orientation_noise_std_deg = 2.0F};
  PoseSensorConfig both = noise;
  both.position_random_walk = 0.2F;
  both.drift_std_m = 0.3F;
  both.yaw_random_walk = 1.0F;
  BatchConfig config = resting(20);
  config.pose_sensor = noise;
  Batch noisy = make_resting(config);
  config.pose_sensor = both;
  Batch drifting = make_resting(config);
  noisy.sense();
  drifting.sense();
  EXPECT_EQ(noisy.pose_readings().position, drifting.pose_readings().position) << "drifts begin at 0";
  EXPECT_EQ(noisy.pose_readings().quat_wxyz, drifting.pose_readings().quat_wxyz);
  read_next(noisy);
  read_next(drifting);
  std::vector<double> difference;
  for (std::size_t i = 0; i < 60; ++i) {
    difference.push_back(static_cast<double>(noisy.pose_readings().position[i]) -
                         static_cast<double>(drifting.pose_readings().position[i]));
    EXPECT_NE(difference.back(), 0.0);
  }
  const double variance = 0.04 * kReadingS + 0.09 * (1.0 - std::exp(-2.0 * kReadingS / 30.0));
  EXPECT_TRUE(has_mean(products(difference, difference), variance));
  drifting.begin_episode();
  noisy.begin_episode();
  drifting.sense();
  noisy.sense();
  EXPECT_EQ(noisy.pose_readings().position, drifting.pose_readings().position) << "also in the next episode";
}

TEST(PoseDrift, OfTheYawTurnsOrientationAndVelocity) {
  constexpr double kWalkDeg = 2.0;
  const DroneModel drone = DroneModel::load("crazyflie");
  BatchConfig config{.num_envs = kEstimates, .num_threads = 1, .clock = {.policy_hz = 50.0F}};
  config.dynamics = {.motion = Motion::rotors, .control = Control::rotor_speeds};
  config.pose_sensor = {.velocity_noise_std_mps = 0.0F, .yaw_random_walk = static_cast<float>(kWalkDeg)};
  Batch batch(config, {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5000, 5000, 5000})})}, nullptr, drone);
  std::vector<float> velocity;
  for (std::size_t i = 0; i < kEstimates; ++i) velocity.insert(velocity.end(), {3.0F, -1.0F, 0.5F});
  batch.set_velocity(velocity, {}, {});
  batch.sense();
  EXPECT_EQ(batch.pose_readings().velocity, batch.state().flight.velocity);
  batch.fly(std::vector<float>(4 * kEstimates, static_cast<float>(drone.airframe()->hover_speed())), 100);
  batch.sense();
  std::vector<double> yaws;
  for (std::size_t i = 0; i < kEstimates; ++i) {
    const float* const q = batch.pose_readings().quat_wxyz.data() + 4 * i;
    const Quat turn = Quat(q[0], q[1], q[2], q[3]) * pose_of(batch.state(), DroneIndex(i)).rotation.conjugate();
    EXPECT_LT(std::abs(turn.x()) + std::abs(turn.y()), 1e-5F) << "only about the vertical";
    yaws.push_back(2.0 * std::atan2(static_cast<double>(turn.z()), static_cast<double>(turn.w())) * 180.0 / std::numbers::pi);
    const Vec3 truth = Vec3::Map(batch.state().flight.velocity.data() + 3 * i);
    EXPECT_LT((Vec3::Map(batch.pose_readings().velocity.data() + 3 * i) - turn * truth).norm(), 1e-5F);
  }
  EXPECT_TRUE(has_mean(yaws, 0.0));
  EXPECT_TRUE(has_mean(products(yaws, yaws), kWalkDeg * kWalkDeg * 100.0 * batch.config().clock.dt_s()));
}

TEST(PoseDrift, VelocityHasNoiseOfItsOwn) {
  BatchConfig config{.num_envs = kEstimates, .num_threads = 1, .clock = {.policy_hz = 50.0F}};
  config.dynamics = {.motion = Motion::rotors, .control = Control::rotor_speeds};
  config.pose_sensor = {.velocity_noise_std_mps = 0.25F};
  Batch batch(config, {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {50, 50, 50})})}, nullptr,
              DroneModel::load("crazyflie"));
  std::vector<std::vector<double>> errors;
  for (int reading = 0; reading < 2; ++reading) {
    batch.sense();
    const std::vector<float>& velocity = batch.pose_readings().velocity;
    errors.emplace_back(velocity.begin(), velocity.end());  // the drones are at rest
    EXPECT_TRUE(has_mean(errors.back(), 0.0));
    EXPECT_TRUE(has_mean(products(errors.back(), errors.back()), 0.0625));
  }
  EXPECT_TRUE(has_mean(products(errors[0], errors[1]), 0.0));
  EXPECT_EQ(batch.pose_readings().position, batch.state().position);
}

TEST(PoseDrift, RefusesTheVelocityOfKinematicMotion) {
  BatchConfig config = resting(1);
  EXPECT_TRUE(make_resting(config).pose_readings().velocity.empty());
  config.pose_sensor.velocity_noise_std_mps = 0.1F;
  EXPECT_REFUSED(config.validate(), "pose_sensor.velocity_noise_std_mps: ... kinematic");
}

}  // namespace
}  // namespace flockstep
