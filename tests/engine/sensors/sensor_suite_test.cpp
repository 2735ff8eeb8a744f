#include "sensors/sensor_suite.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

using testing::same_bits;

BatchConfig flying(std::vector<ImuConfig> imus, std::vector<LidarConfig> lidars = {}) {
  BatchConfig config;
  config.num_envs = 3;
  config.num_threads = 1;
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  config.imus = std::move(imus);
  config.lidars = std::move(lidars);
  return config;
}

const ImuConfig kNoisy{.accelerometer_noise_density = 0.1F,
                       .accelerometer_random_walk = 0.1F,
                       .gyroscope_noise_density = 0.01F,
                       .gyroscope_random_walk = 0.01F};

ImuConfig named(ImuConfig config, const std::string& name) {
  config.name = name;
  return config;
}

std::vector<float> fly(Batch& batch) {
  std::vector<float> command;
  for (int drone = 0; drone < batch.config().num_drones(); ++drone) {
    command.insert(command.end(), {0.3F, -0.1F, 0.1F * static_cast<float>(drone), 0.5F});
  }
  for (int step = 0; step < 5; ++step) {
    batch.fly(command);
    batch.sense();
  }
  return command;
}

TEST(SensorSuite, ReadsSeveralLidarsLikeSingleOnes) {
  const LidarConfig ahead{.name = "ahead", .beams = 9, .hfov_deg = 90.0F, .max_range_m = 5.0F};
  const LidarConfig grid{.name = "grid", .channels = 8, .beams = 32, .hfov_deg = 180.0F, .vfov_deg = 60.0F, .max_range_m = 7.0F};
  const auto world = testing::closet();
  BatchConfig config = testing::lidar_batch(2, ahead);
  config.lidars.push_back(grid);
  Batch both(config, {world});
  both.sense();
  for (std::size_t i = 0; i < 2; ++i) {
    Batch one(testing::lidar_batch(2, config.lidars[i]), {world});
    one.sense();
    EXPECT_TRUE(same_bits(both.lidar_readings(i).ranges, one.lidar_readings().ranges));
    EXPECT_TRUE(std::ranges::any_of(one.lidar_readings().ranges, [](float range) { return std::isfinite(range); }));
  }
  EXPECT_EQ(both.lidar_index("grid"), 1U);
  EXPECT_EQ(both.lidar_index(""), 0U);
  EXPECT_THROW(both.lidar_index("back"), std::invalid_argument);
  const std::vector<float> before = both.lidar_readings(0).ranges;
  both.set_lidar({.max_range_m = 0.1F}, {}, 1);
  both.sense();
  EXPECT_TRUE(same_bits(both.lidar_readings(0).ranges, before));
  EXPECT_EQ(std::ranges::count(both.lidar_readings(1).max_range_m, 0.1F), 2);
}

TEST(SensorSuite, GivesEachImuItsOwnNoise) {
  Batch two(flying({named(kNoisy, "a"), named(kNoisy, "b")}), {testing::closet()});
  Batch one(flying({named(kNoisy, "only")}), {testing::closet()});
  fly(two);
  fly(one);
  EXPECT_TRUE(same_bits(two.imu_readings(0).accelerometer, one.imu_readings().accelerometer));
  EXPECT_TRUE(same_bits(two.imu_readings(0).gyroscope, one.imu_readings().gyroscope));
  for (std::size_t i = 0; i < two.imu_readings(0).gyroscope.size(); ++i) {
    EXPECT_NE(two.imu_readings(0).gyroscope[i], two.imu_readings(1).gyroscope[i]);
  }
}

TEST(SensorSuite, PublishesTheTruthItselfWithoutErrors) {
  const BatchConfig exact = flying({ImuConfig{}});
  const BatchConfig noisy = flying({kNoisy});
  sensors::Readings<ImuReadings> same, apart;
  same.allocate({.num_drones = 2}, false);
  apart.allocate({.num_drones = 2}, true);
  EXPECT_EQ(&same.truth(), &same.published());
  EXPECT_NE(&apart.truth(), &apart.published());
  Batch a(exact, {testing::closet()}), b(noisy, {testing::closet()});
  fly(a);
  fly(b);
  EXPECT_TRUE(same_bits(a.state().position, b.state().position));
  EXPECT_FALSE(same_bits(a.imu_readings().accelerometer, b.imu_readings().accelerometer));
}

TEST(SensorSuite, RestoresSeveralSensorsOfAKind) {
  BatchConfig config =
      flying({named(kNoisy, "a"), named(kNoisy, "b")}, {{.name = "low", .beams = 5}, {.name = "high", .beams = 6}});
  Batch batch(config, {testing::closet()});
  fly(batch);
  batch.set_lidar({.hfov_deg = 45.0F}, {}, 1);
  const std::string blob = batch.snapshot();
  fly(batch);
  const std::vector<float> accelerometer = batch.imu_readings(1).accelerometer, ranges = batch.lidar_readings(1).ranges;
  Batch other(config, {testing::closet()});
  other.restore(blob);
  EXPECT_EQ(other.lidar_config(0, 1).hfov_deg, 45.0F);
  EXPECT_EQ(other.lidar_config(0, 0).hfov_deg, 270.0F);
  fly(other);
  EXPECT_TRUE(same_bits(other.imu_readings(1).accelerometer, accelerometer));
  EXPECT_TRUE(same_bits(other.lidar_readings(1).ranges, ranges));
}

TEST(SensorSuite, RefusesTwoSensorsOfAKindWithOneName) {
  const auto expect_refused = [](const BatchConfig& config, const std::string& field) {
    try {
      const Batch batch(config, {testing::closet()});
      FAIL() << field;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).substr(0, field.size()), field);
    }
  };
  expect_refused(flying({ImuConfig{}, ImuConfig{}}), "imu.name: expected a name that no other imu has");
  expect_refused(flying({}, {LidarConfig{}, LidarConfig{}}), "lidar.name: expected a name that no other lidar has");
}

TEST(SensorSuite, ListsTheArraysOfASensorByItsName) {
  Batch batch(flying({named(kNoisy, "b")}, {{.name = "low", .channels = 2, .beams = 5}}), {testing::closet()});
  fly(batch);
  const std::vector<ArrayView> imu = batch.sensor_arrays("b"), lidar = batch.sensor_arrays("low");
  ASSERT_EQ(imu.size(), 2U);
  EXPECT_STREQ(imu[1].name, "gyroscope");
  EXPECT_EQ(imu[1].data, batch.imu_readings().gyroscope.data());
  EXPECT_EQ(lidar[0].data, batch.lidar_readings().ranges.data());
  EXPECT_EQ(lidar[0].items.sizes, (std::array<std::int64_t, 2>{2, 5}));
  EXPECT_EQ(batch.sensor_arrays("pose")[0].data, batch.pose_readings().position.data());
  EXPECT_THROW(batch.sensor_arrays("sonar"), std::invalid_argument);
  const Batch twins(flying({named(kNoisy, "same")}, {{.name = "same"}}), {testing::closet()});
  EXPECT_THROW(twins.sensor_arrays("same"), std::invalid_argument) << "of the LiDAR or of the IMU";
}

}  // namespace
}  // namespace flockstep
