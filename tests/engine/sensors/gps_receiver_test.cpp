#include "flockstep/sensors/gps_receiver.hpp"

#include "resting_drones.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kReceivers = 1000;
constexpr std::size_t kFixes = 1000;

Batch with_receiver(const GpsReceiverConfig& receiver, std::size_t num_drones = kReceivers) {
  BatchConfig config = resting(static_cast<int>(num_drones));
  config.gps_receivers = {receiver};
  return make_resting(config);
}

const GpsReceiverReadings& receiver_of(const Batch& batch) { return batch.readings<GpsReceiverReadings>(); }

TEST(GpsReceiver, IsExactWithoutErrors) {
  Batch batch = with_receiver({}, 2);
  batch.set_pose(std::vector<float>{1, 2, 3, 4, 5, 6}, {});
  batch.sense();
  EXPECT_EQ(receiver_of(batch).position, batch.state().position);
  EXPECT_EQ(std::ranges::count(receiver_of(batch).fix, 1), 2);
  EXPECT_TRUE(receiver_of(batch).velocity.empty()) << "kinematic drones have none";
}

TEST(GpsReceiver, HasTheErrorsOfItsConfiguration) {
  constexpr double kStd = 1.5, kTimeS = 4.0, kNoise = 0.5;
  Batch batch = with_receiver({.noise_std_m = 0.5F, .drift_std_m = 1.5F, .drift_time_s = 4.0F, .vertical_factor = 2.0F});
  std::vector<std::vector<double>> level, upward;  // of each reading
  for (std::size_t reading = 0; reading < kFixes; ++reading) {
    reading == 0 ? batch.sense() : read_next(batch);
    level.emplace_back();
    upward.emplace_back();
    for (std::size_t i = 0; i < 3 * kReceivers; ++i) {
      const double error = static_cast<double>(receiver_of(batch).position[i]) - static_cast<double>(batch.state().position[i]);
      (i % 3 == 2 ? upward : level).back().push_back(error);
    }
  }
  const auto covariance = [](double lag) {
    return kStd * kStd * std::exp(-lag * kReadingS / kTimeS) + (lag == 0.0 ? kNoise * kNoise : 0.0);
  };
  for (const std::size_t reading : {0U, 1U, 999U}) {
    EXPECT_TRUE(has_mean(level[reading], 0.0)) << reading;
    EXPECT_TRUE(has_mean(products(level[reading], level[reading]), covariance(0))) << reading;
    EXPECT_TRUE(has_mean(products(upward[reading], upward[reading]), 4.0 * covariance(0))) << reading;
  }
  for (const std::size_t lag : {1U, 80U, 400U}) {
    EXPECT_TRUE(has_mean(products(level[0], level[lag]), covariance(static_cast<double>(lag)))) << lag;
  }
  expect_allan_of(level, covariance);
}

// The times with and without a fix end in each tick with a constant probability.
TEST(GpsReceiver, LosesItsFixForATime) {
  constexpr double kOutageS = 0.4, kPerS = 0.5;
  Batch batch = with_receiver({.noise_std_m = 0.5F, .outages_per_s = 0.5F, .outage_s = 0.4F});
  std::vector<std::vector<double>> lost(kReceivers);
  std::vector<float> before;
  for (std::size_t reading = 0; reading < kFixes; ++reading) {
    reading == 0 ? batch.sense() : read_next(batch);
    const GpsReceiverReadings& now = receiver_of(batch);
    for (std::size_t drone = 0; drone < kReceivers; ++drone) {
      lost[drone].push_back(1.0 - now.fix[drone]);
      if (reading == 0) {
        EXPECT_EQ(now.fix[drone], 1);
      } else {
        EXPECT_EQ(same_bits(row(now.position, drone, 3), row(before, drone, 3)), now.fix[drone] == 0) << "it holds its last one";
      }
    }
    before = now.position;
  }
  const double loses = 1.0 - std::exp(-kPerS * kReadingS), returns = 1.0 - std::exp(-kReadingS / kOutageS);
  std::vector<double> shares, lengths;
  for (const std::vector<double>& of_drone : lost) {
    shares.push_back(std::accumulate(of_drone.begin() + 100, of_drone.end(), 0.0) / static_cast<double>(kFixes - 100));
    std::size_t length = 0;
    for (std::size_t i = 0; i < 900; ++i) {  // later ones may not have ended
      if (of_drone[i] == 0.0) continue;
      for (length = 0; i < kFixes && of_drone[i] == 1.0; ++i) ++length;
      lengths.push_back(static_cast<double>(length));
    }
  }
  EXPECT_TRUE(has_mean(shares, loses / (loses + returns)));
  EXPECT_TRUE(has_mean(lengths, 1.0 / returns));
  EXPECT_GT(lengths.size(), 10000U);
}

TEST(GpsReceiver, ArrivesLate) {
  Batch batch = with_receiver({.latency_s = 0.2F}, 1);
  batch.sense();
  for (int i = 0; i < 10; ++i) {
    batch.move(std::vector<float>{0.1F * static_cast<float>(i), 0.0F, 0.0F}, {});
    batch.sense();
    if (i < 4) continue;
    EXPECT_FLOAT_EQ(receiver_of(batch).position[0], 0.1F * static_cast<float>(i - 4));
    EXPECT_FLOAT_EQ(receiver_of(batch).age_s[0], 0.2F);
  }
}

TEST(GpsReceiver, MeasuresTheVelocityOfRotors) {
  BatchConfig config{.num_envs = kReceivers, .num_threads = 1};
  config.dynamics = {.motion = Motion::rotors, .control = Control::velocity};
  config.gps_receivers = {{.velocity_noise_std_mps = 0.2F, .vertical_factor = 3.0F}};
  Batch batch(config, {closet()});
  batch.sense();  // at rest
  std::vector<double> level, upward;
  for (std::size_t i = 0; i < 3 * kReceivers; ++i) {
    (i % 3 == 2 ? upward : level).push_back(static_cast<double>(receiver_of(batch).velocity[i]));
  }
  EXPECT_TRUE(has_mean(products(level, level), 0.04));
  EXPECT_TRUE(has_mean(products(upward, upward), 0.36));
  EXPECT_EQ(receiver_of(batch).position, batch.state().position);
}

TEST(GpsReceiver, StaysItselfWithAbsurdOutages) {
  for (const auto& [per_s, outage_s] : {std::pair{1e-45F, 0.01F}, {10.0F, 1e6F}, {10.0F, 0.01F}}) {
    Batch batch = with_receiver({.outages_per_s = per_s, .outage_s = outage_s}, 3);
    for (int i = 0; i < 50; ++i) read_next(batch);
    if (per_s < 1.0F) {
      EXPECT_EQ(std::ranges::count(receiver_of(batch).fix, 1), 3);
    } else if (outage_s > 1.0F) {
      EXPECT_EQ(std::ranges::count(receiver_of(batch).fix, 0), 3);
    }
  }
  EXPECT_REFUSED(GpsReceiverConfig{.outage_s = 0.0F}.validate(), "gps_receiver.outage_s");
  EXPECT_REFUSED(GpsReceiverConfig{.outages_per_s = kNan}.validate(), "gps_receiver.outages_per_s");
}

TEST(GpsReceiver, HasPresets) {
  EXPECT_EQ(GpsReceiverConfig::preset("consumer").drift_std_m, 1.0F);
  EXPECT_REFUSED(GpsReceiverConfig::preset("rtk"), "GpsReceiverConfig.preset: ... px4-sih, consumer");
}

}  // namespace
}  // namespace flockstep
