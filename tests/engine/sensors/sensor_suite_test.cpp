#include "sensors/sensor_suite.hpp"

#include "batch_helpers.hpp"
#include "sensors/pose_sensor.hpp"

namespace flockstep {
namespace {

using namespace testing;

BatchConfig flying(std::vector<ImuConfig> imus, std::vector<LidarConfig> lidars = {}) {
  BatchConfig config{.num_envs = 3, .num_threads = 1};
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
  const auto world = closet();
  BatchConfig config = lidar_batch(2, ahead);
  config.lidars.push_back(grid);
  Batch both(config, {world});
  both.sense();
  for (std::size_t i = 0; i < 2; ++i) {
    Batch one(lidar_batch(2, config.lidars[i]), {world});
    one.sense();
    EXPECT_TRUE(same_bits(both.lidar(i).readings().ranges, one.lidar().readings().ranges));
    EXPECT_TRUE(std::ranges::any_of(one.lidar().readings().ranges, [](float range) { return std::isfinite(range); }));
  }
  EXPECT_EQ(both.lidar("grid").index(), 1U);
  EXPECT_EQ(both.lidar("").index(), 0U);
  EXPECT_THROW(both.lidar("back").index(), std::invalid_argument);
  const std::vector<float> before = both.lidar(0).readings().ranges;
  both.lidar(1).set({.max_range_m = 0.1F});
  both.sense();
  EXPECT_TRUE(same_bits(both.lidar(0).readings().ranges, before));
  EXPECT_EQ(std::ranges::count(both.lidar(1).readings().max_range_m, 0.1F), 2);
}

TEST(SensorSuite, GivesEachImuItsOwnNoise) {
  Batch two(flying({named(kNoisy, "a"), named(kNoisy, "b")}), {closet()});
  Batch one(flying({named(kNoisy, "only")}), {closet()});
  fly(two);
  fly(one);
  EXPECT_TRUE(same_bits(two.readings<ImuReadings>(0).accelerometer, one.readings<ImuReadings>().accelerometer));
  EXPECT_TRUE(same_bits(two.readings<ImuReadings>(0).gyroscope, one.readings<ImuReadings>().gyroscope));
  for (std::size_t i = 0; i < two.readings<ImuReadings>(0).gyroscope.size(); ++i) {
    EXPECT_NE(two.readings<ImuReadings>(0).gyroscope[i], two.readings<ImuReadings>(1).gyroscope[i]);
  }
}

TEST(SensorSuite, PublishesTheTruthItselfWithoutErrors) {
  const BatchConfig exact = flying({ImuConfig{}});
  const BatchConfig noisy = flying({kNoisy});
  sensors::Readings<ImuReadings> same, apart;
  const auto cleared = allocated<ImuReadings>({.num_drones = 2});
  same.allocate(cleared, false, false);
  apart.allocate(cleared, true, false);
  EXPECT_EQ(&same.truth(), &same.published());
  EXPECT_NE(&apart.truth(), &apart.published());
  Batch a(exact, {closet()}), b(noisy, {closet()});
  fly(a);
  fly(b);
  EXPECT_TRUE(same_bits(a.state().position, b.state().position));
  EXPECT_FALSE(same_bits(a.readings<ImuReadings>().accelerometer, b.readings<ImuReadings>().accelerometer));
}

TEST(SensorSuite, RestoresSeveralSensorsOfAKind) {
  BatchConfig config =
      flying({named(kNoisy, "a"), named(kNoisy, "b")}, {{.name = "low", .beams = 5}, {.name = "high", .beams = 6}});
  Batch batch(config, {closet()});
  fly(batch);
  batch.lidar(1).set({.hfov_deg = 45.0F});
  const std::string blob = batch.snapshot();
  fly(batch);
  const std::vector<float> accelerometer = batch.readings<ImuReadings>(1).accelerometer,
                           ranges = batch.lidar(1).readings().ranges;
  Batch other(config, {closet()});
  other.restore(blob);
  EXPECT_EQ(other.lidar(1).config(DroneIndex(0)).hfov_deg, 45.0F);
  EXPECT_EQ(other.lidar(0).config(DroneIndex(0)).hfov_deg, 270.0F);
  fly(other);
  EXPECT_TRUE(same_bits(other.readings<ImuReadings>(1).accelerometer, accelerometer));
  EXPECT_TRUE(same_bits(other.lidar(1).readings().ranges, ranges));
}

TEST(SensorSuite, RefusesTwoSensorsOfAKindWithOneName) {
  EXPECT_REFUSED(Batch(flying({ImuConfig{}, ImuConfig{}}), {closet()}), "imu.name: ... other");
  EXPECT_REFUSED(Batch(flying({}, {LidarConfig{}, LidarConfig{}}), {closet()}), "lidar.name: ... other");
}

TEST(SensorSuite, ListsTheArraysOfASensorByItsName) {
  Batch batch(flying({named(kNoisy, "b")}, {{.name = "low", .channels = 2, .beams = 5}}), {closet()});
  fly(batch);
  const std::vector<ArrayView> imu = batch.sensor_arrays("b"), lidar = batch.sensor_arrays("low");
  ASSERT_EQ(imu.size(), 3U);
  EXPECT_STREQ(imu[1].name, "gyroscope");
  EXPECT_EQ(imu[1].data, batch.readings<ImuReadings>().gyroscope.data());
  EXPECT_EQ(lidar[0].data, batch.lidar().readings().ranges.data());
  EXPECT_EQ(lidar[0].items.sizes, (std::array<std::int64_t, 2>{2, 5}));
  EXPECT_EQ(batch.sensor_arrays("pose")[0].data, batch.pose_readings().position.data());
  EXPECT_THROW(batch.sensor_arrays("sonar"), std::invalid_argument);
  const Batch twins(flying({named(kNoisy, "same")}, {{.name = "same"}}), {closet()});
  EXPECT_REFUSED(twins.sensor_arrays("same"), "sensor: ... same");  // of the LiDAR or of the IMU
  EXPECT_EQ(twins.sensor_arrays("lidar.same")[0].data, twins.lidar().readings().ranges.data());
  EXPECT_EQ(twins.sensor_arrays("imu.same")[1].data, twins.readings<ImuReadings>().gyroscope.data());
}

constexpr int kDrones = 4000;

BatchConfig noisy(int num_drones, float position_std_m, float orientation_std_deg) {
  BatchConfig config;
  config.num_envs = num_drones;
  config.num_threads = 1;
  config.pose_sensor = {.position_noise_std_m = position_std_m, .orientation_noise_std_deg = orientation_std_deg};
  return config;
}

Batch::Worlds hall() { return {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {10, 10, 10})})}; }

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0) / static_cast<double>(a.size());
}

// Returns the errors of a scan, divided by their standard deviation: three axes of the position, three of the rotation vector.
std::array<std::vector<double>, 6> errors_of(const Batch& batch, const Quat& rotation) {
  std::array<std::vector<double>, 6> errors;
  const State& state = batch.state();
  const double tilt_rad = static_cast<double>(batch.config().pose_sensor.orientation_noise_std_deg) * std::numbers::pi / 180.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(batch.config().num_drones()); ++i) {
    const float* const q = batch.pose_readings().quat_wxyz.data() + 4 * i;
    const Eigen::AngleAxisd turn(rotation.conjugate().cast<double>() * Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double off =
          static_cast<double>(batch.pose_readings().position[3 * i + axis]) - static_cast<double>(state.position[3 * i + axis]);
      errors[axis].push_back(off / static_cast<double>(batch.config().pose_sensor.position_noise_std_m));
      errors[3 + axis].push_back(turn.angle() * turn.axis()[static_cast<Eigen::Index>(axis)] / tilt_rad);
    }
  }
  return errors;
}

TEST(PoseSensor, IsExactWithoutNoise) {
  Batch batch(noisy(3, 0.0F, 0.0F), hall());
  batch.set_pose(std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8, 9}, {});
  batch.sense();
  EXPECT_EQ(batch.pose_readings().position, batch.state().position);
  EXPECT_EQ(batch.pose_readings().quat_wxyz, batch.state().quat_wxyz);
}

TEST(PoseSensor, NoiseIsNormalAndIndependentInEveryAxisAndScan) {
  Batch batch(noisy(kDrones, 0.125F, 5.0F), hall());
  const Quat rotation(0.5F, 0.5F, -0.5F, 0.5F);
  std::vector<float> quats;
  for (int i = 0; i < kDrones; ++i) quats.insert(quats.end(), {0.5F, 0.5F, -0.5F, 0.5F});
  batch.set_pose({}, quats);
  batch.sense();
  const auto first = errors_of(batch, rotation);
  batch.sense();
  const auto second = errors_of(batch, rotation);
  const double bound = 5.0 / std::sqrt(kDrones);  // five standard deviations
  for (std::size_t a = 0; a < 6; ++a) {
    SCOPED_TRACE(a);
    EXPECT_NEAR(std::accumulate(first[a].begin(), first[a].end(), 0.0) / kDrones, 0.0, bound);
    EXPECT_NEAR(correlation(first[a], first[a]), 1.0, std::sqrt(2.0) * bound);  // variance
    for (std::size_t b = 0; b < 6; ++b) {
      EXPECT_NEAR(correlation(first[a], second[b]), 0.0, bound) << b;
      if (a != b) {
        EXPECT_NEAR(correlation(first[a], first[b]), 0.0, bound) << b;
      }
    }
  }
}

}  // namespace
}  // namespace flockstep
