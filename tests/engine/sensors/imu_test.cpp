#include "flockstep/sensors/imu.hpp"

#include "resting_drones.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr float kG = 9.81F;

BatchConfig with_imu(int num_drones, const ImuConfig& imu, Control control = Control::rotor_speeds) {
  BatchConfig config{.num_envs = num_drones, .num_threads = 1, .clock = {.policy_hz = 100.0F, .physics_hz = 500.0F}};
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = control;
  config.dynamics.body_drag = config.dynamics.rotor_drag = false;
  config.imus = {imu};
  return config;
}

Batch::Worlds open() { return {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5000, 5000, 5000})})}; }

// Makes a batch whose rotors can stop.
Batch make(const BatchConfig& config) {
  const DroneModel model = DroneModel::load("kingfisher");
  Airframe frame = *model.airframe();
  frame.min_speed_radps = 0.0;
  return Batch(config, open(), nullptr, DroneModel({model.hull().begin(), model.hull().end()}, frame));
}

Vec3 vector_at(std::span<const float> values, std::size_t drone) {
  return {values[3 * drone], values[3 * drone + 1], values[3 * drone + 2]};
}

std::vector<float> all(int num_drones, float value) {
  return std::vector<float>(4 * static_cast<std::size_t>(num_drones), value);
}

TEST(Imu, ReadsGravityUpwardsAtRestAndNothingInFreeFall) {
  Batch batch = make(with_imu(1, {}));
  const auto hovering = static_cast<float>(batch.drone().airframe()->hover_speed());
  batch.sense();
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().accelerometer, 0).isApprox(Vec3(0, 0, kG), 1e-5F)) << "before it flies";
  batch.fly(all(1, hovering));
  batch.sense();
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().accelerometer, 0).isApprox(Vec3(0, 0, kG), 1e-4F)) << "hovering";
  batch.set_velocity({}, {}, all(1, 0.0F));
  batch.fly(all(1, 0.0F));
  batch.sense();
  EXPECT_LT(vector_at(batch.readings<ImuReadings>().accelerometer, 0).norm(), 1e-4F) << "falling";
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().gyroscope, 0).isZero(1e-6F));
}

TEST(Imu, MeasuresInItsOwnFrame) {
  const Quat turned(Eigen::AngleAxisf(0.7F, Vec3(1, 2, 3).normalized()));
  const Quat mount(Eigen::AngleAxisf(-1.1F, Vec3(0, 1, 1).normalized()));
  Batch batch = make(with_imu(1, {.quat_wxyz = {mount.w(), mount.x(), mount.y(), mount.z()}}));
  batch.set_pose({}, std::vector<float>{turned.w(), turned.x(), turned.y(), turned.z()});
  batch.set_velocity({}, std::vector<float>{0, 0, 2}, {});
  batch.sense();  // before it flies, only its support accelerates it
  EXPECT_TRUE(
      vector_at(batch.readings<ImuReadings>().accelerometer, 0).isApprox((turned * mount).conjugate() * Vec3(0, 0, kG), 1e-5F));
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().gyroscope, 0).isApprox(mount.conjugate() * Vec3(0, 0, 2), 1e-5F));
}

// Two sensors on one body differ by the effect of rotation: w' x r + w x (w x r). The reference uses the sensor's positions.
TEST(Imu, OffTheCentreMeasuresTheRotation) {
  const Vec3 offset(0.3F, -0.2F, 0.1F);
  const BatchConfig config = with_imu(1, {.offset_m = {offset.x(), offset.y(), offset.z()}});
  Batch batch = make(config);
  batch.set_velocity(std::vector<float>{1, 2, 3}, std::vector<float>{1.0F, -2.0F, 3.0F}, {});
  std::vector<float> told = all(1, static_cast<float>(batch.drone().airframe()->hover_speed()));
  told[0] += 150.0F;
  std::vector<Eigen::Vector3d> places;
  Vec3 reading = Vec3::Zero();
  Quat rotation = Quat::Identity();
  for (int tick = 0; tick < 41; ++tick) {
    batch.fly(told, 1);
    const Pose pose = pose_of(batch.state(), DroneIndex(0));
    places.push_back((pose.position + pose.rotation * offset).cast<double>());
    if (tick == 20) {
      batch.sense();
      reading = vector_at(batch.readings<ImuReadings>().accelerometer, 0);
      rotation = pose.rotation;
    }
  }
  const double span = 20 * 0.002;
  const Eigen::Vector3d acceleration = (places[40] - 2.0 * places[20] + places[0]) / (span * span);
  const Vec3 expected = rotation.conjugate() * (acceleration.cast<float>() + Vec3(0, 0, kG));
  EXPECT_LT((reading - expected).norm(), 0.03F * expected.norm()) << reading.transpose() << " / " << expected.transpose();
}

// A million readings of drones at rest. White noise of density s has the variance s^2 / t in readings that are t apart. A bias
// that noise of density w drives has the variance w^2 T / 2 with a correlation time T, and otherwise grows by w^2 t.
TEST(Imu, HasTheNoiseAndBiasesOfItsDensities) {
  constexpr std::size_t kDrones = 1000, kReadings = 1000;
  constexpr double kWhite = 0.02, kWalk = 0.05, kTimeS = 2.0;
  BatchConfig config = resting(kDrones);
  config.imus = {{.accelerometer_noise_density = 0.02F,
                  .accelerometer_random_walk = 0.05F,
                  .accelerometer_bias_time_s = 2.0F,
                  .accelerometer_bias_std_mps2 = 0.05F,  // begins with the variance that it keeps
                  .gyroscope_noise_density = 0.02F,
                  .gyroscope_random_walk = 0.05F}};
  Batch batch = make_resting(config);
  std::vector<std::vector<double>> force, turn;  // errors of each reading
  for (std::size_t i = 0; i < kReadings; ++i) {
    i == 0 ? batch.sense() : read_next(batch);
    const ImuReadings& now = batch.readings<ImuReadings>();
    turn.emplace_back(now.gyroscope.begin(), now.gyroscope.end());
    force.emplace_back(now.accelerometer.begin(), now.accelerometer.end());
    for (std::size_t z = 2; z < 3 * kDrones; z += 3) force.back()[z] -= static_cast<double>(kG);
  }
  const double white = kWhite * kWhite / kReadingS, step = kWalk * kWalk * kReadingS;
  const auto covariance = [&](double lag) {
    return kWalk * kWalk * kTimeS / 2.0 * std::exp(-lag * kReadingS / kTimeS) + (lag == 0.0 ? white : 0.0);
  };
  for (const std::size_t reading : {0U, 40U, 999U}) {
    EXPECT_TRUE(has_mean(force[reading], 0.0)) << reading;
    EXPECT_TRUE(has_mean(turn[reading], 0.0)) << reading;
    EXPECT_TRUE(has_mean(products(turn[reading], turn[reading]), white + step * static_cast<double>(reading))) << reading;
  }
  for (const std::size_t lag : {0U, 1U, 40U, 80U}) {
    EXPECT_TRUE(has_mean(products(force[900], force[900 - lag]), covariance(static_cast<double>(lag)))) << lag;
  }
  expect_allan_of(force, covariance);
  expect_allan(turn, [&](std::size_t k) { return white / static_cast<double>(k) + allan_variance_of_walk(step, k); });
}

TEST(Imu, ACorrelatedBiasKeepsItsVariance) {
  constexpr int kDrones = 2000;
  const ImuConfig imu{.accelerometer_random_walk = 0.1F, .accelerometer_bias_time_s = 0.5F};
  Batch batch = make(with_imu(kDrones, imu));
  const std::vector<float> hover = all(kDrones, static_cast<float>(batch.drone().airframe()->hover_speed()));
  for (int i = 0; i < 400; ++i) {  // 4 s, eight correlation times
    batch.fly(hover);
    batch.sense();
  }
  std::vector<double> biases;
  for (std::size_t drone = 0; drone < kDrones; ++drone)
    biases.push_back(static_cast<double>(batch.readings<ImuReadings>().accelerometer[3 * drone]));
  const double expected = 0.1 * 0.1 * 0.5 / 2.0;
  EXPECT_NEAR(moments(biases).variance / expected, 1.0, 5.0 * std::sqrt(2.0 / kDrones));
}

// For any number of readings at any interval, regular or not, the bias has the variance of the elapsed time.
TEST(Imu, BiasWalksByTimeNotByReadings) {
  constexpr int kDrones = 4000;
  for (const std::optional<float> rate : {std::optional<float>(), std::optional<float>(250.0F)}) {
    for (const int readings : {1, 3, 50}) {  // within 0.1 s
      for (const float bias_time : {0.0F, 0.05F}) {
        SCOPED_TRACE(::testing::Message() << rate.value_or(0.0F) << " Hz, " << readings << " readings, time " << bias_time);
        Batch batch =
            make(with_imu(kDrones, {.gyroscope_random_walk = 0.1F, .gyroscope_bias_time_s = bias_time, .rate_hz = rate}));
        const std::vector<float> hover = all(kDrones, static_cast<float>(batch.drone().airframe()->hover_speed()));
        for (int tick = 0; tick < 50; ++tick) {
          if (tick % (50 / readings) == 0) batch.sense();
          batch.fly(hover, 1);
        }
        batch.sense();
        const std::vector<float> first(batch.readings<ImuReadings>().gyroscope.begin(),
                                       batch.readings<ImuReadings>().gyroscope.end());
        batch.sense();
        EXPECT_TRUE(same_bits(batch.readings<ImuReadings>().gyroscope, first)) << "no time has passed";
        std::vector<double> biases;
        for (std::size_t drone = 0; drone < kDrones; ++drone) biases.push_back(static_cast<double>(first[3 * drone]));
        const double t = static_cast<double>(bias_time);
        const double variance = 0.01 * (t > 0.0 ? 0.5 * t * (1.0 - std::exp(-2.0 * 0.1 / t)) : 0.1);
        EXPECT_NEAR(moments(biases).variance / variance, 1.0, 5.0 * std::sqrt(2.0 / kDrones));
      }
    }
  }
}

TEST(Imu, BiasOfAnEpisodeBeginsAtZero) {
  Batch batch = make(with_imu(1, {.gyroscope_random_walk = 0.1F}));
  const std::vector<float> hover = all(1, static_cast<float>(batch.drone().airframe()->hover_speed()));
  batch.fly(hover, 500);
  batch.sense();
  EXPECT_GT(vector_at(batch.readings<ImuReadings>().gyroscope, 0).norm(), 1e-3F);
  batch.begin_episode();
  batch.sense();
  EXPECT_LT(vector_at(batch.readings<ImuReadings>().gyroscope, 0).norm(), 1e-5F);
}

TEST(Imu, OfAnEnvIsTheSameInAnyBatchAndAfterARestore) {
  const ImuConfig imu{.accelerometer_noise_density = 0.02F,
                      .accelerometer_random_walk = 0.01F,
                      .gyroscope_noise_density = 0.003F,
                      .gyroscope_random_walk = 0.002F,
                      .rate_hz = 250.0F};
  BatchConfig config = with_imu(5, imu);
  config.dynamics.wind = {.mean_mps = {1, 2, 0}, .gusts = Gusts::dryden};
  config.dynamics.body_drag = true;
  Batch many = make(config);
  config.num_envs = 1;
  Batch alone = make(config);
  many.seed(std::vector<std::uint64_t>{7, 8, 9, 10, 11});
  alone.seed(std::vector<std::uint64_t>{9});
  const auto fly = [](Batch& batch) {
    batch.fly(all(batch.config().num_drones(), static_cast<float>(batch.drone().airframe()->hover_speed())));
    batch.sense();
  };
  for (int i = 0; i < 10; ++i) fly(many), fly(alone);
  const std::string blob = alone.snapshot();
  for (int i = 0; i < 10; ++i) fly(many), fly(alone);
  EXPECT_TRUE(same_bits(alone.readings<ImuReadings>().accelerometer,
                        std::span(many.readings<ImuReadings>().accelerometer).subspan(6, 3)));
  EXPECT_TRUE(
      same_bits(alone.readings<ImuReadings>().gyroscope, std::span(many.readings<ImuReadings>().gyroscope).subspan(6, 3)));
  EXPECT_TRUE(same_bits(alone.state().flight.wind, std::span(many.state().flight.wind).subspan(6, 3)));
  const std::vector<float> reading(alone.readings<ImuReadings>().accelerometer.begin(),
                                   alone.readings<ImuReadings>().accelerometer.end());
  alone.restore(blob);
  for (int i = 0; i < 10; ++i) fly(alone);
  EXPECT_TRUE(same_bits(alone.readings<ImuReadings>().accelerometer, reading));
}

// The readings of drones that hover level, (N, 3) at each tick.
struct Hovering {
  explicit Hovering(const ImuConfig& imu, int num_drones = 2000) : batch(make(with_imu(num_drones, imu))) {
    batch.sense();
    keep();
  }
  void fly(int ticks) {
    for (int tick = 0; tick < ticks; ++tick) {
      batch.fly(all(batch.config().num_drones(), static_cast<float>(batch.drone().airframe()->hover_speed())), 1);
      batch.sense();
      keep();
    }
  }
  void keep() {
    const ImuReadings& now = batch.readings<ImuReadings>();
    force.emplace_back(now.accelerometer.begin(), now.accelerometer.end());
    turn.emplace_back(now.gyroscope.begin(), now.gyroscope.end());
  }
  static std::vector<double> axis(const std::vector<double>& readings, std::size_t which) {
    std::vector<double> one;
    for (std::size_t i = which; i < readings.size(); i += 3) one.push_back(readings[i]);
    return one;
  }

  Batch batch;
  std::vector<std::vector<double>> force, turn;
};

TEST(Imu, BiasOfAnEpisodeBeginsWithItsDeviation) {
  Hovering drones({.accelerometer_random_walk = 0.5F, .accelerometer_bias_std_mps2 = 0.2F, .gyroscope_bias_std_radps = 0.03F});
  EXPECT_TRUE(has_mean(products(drones.turn[0], drones.turn[0]), 0.0009));
  const std::vector<double> x = Hovering::axis(drones.force[0], 0);
  EXPECT_TRUE(has_mean(products(x, x), 0.04));
  drones.fly(100);
  EXPECT_EQ(drones.turn[100], drones.turn[0]) << "without a walk it stays";
  const std::vector<double> later = Hovering::axis(drones.force[100], 0);
  EXPECT_TRUE(has_mean(products(later, later), 0.04 + 0.25 * 0.2));
  EXPECT_TRUE(has_mean(products(x, later), 0.04));
}

TEST(Imu, ScaleAndAxesErr) {
  Hovering drones({.scale_std = 0.02F, .misalignment_std_deg = 0.5F});
  const double scale = 0.02 * 9.81, angle = 0.5 * std::numbers::pi / 180.0 * 9.81;
  std::vector<double> z = Hovering::axis(drones.force[0], 2);
  for (double& value : z) value -= 9.81;
  EXPECT_TRUE(has_mean(products(z, z), scale * scale));
  for (const std::size_t level : {0U, 1U}) {
    const std::vector<double> axis = Hovering::axis(drones.force[0], level);
    EXPECT_TRUE(has_mean(products(axis, axis), angle * angle));
  }
  EXPECT_LT(moments(drones.turn[0]).variance, 1e-12) << "nothing turns";
  drones.batch.set_velocity({}, std::vector<float>(6000, 2.0F), {});
  drones.batch.sense();
  drones.keep();
  std::vector<double> turn = drones.turn.back();
  for (double& value : turn) value -= 2.0;
  EXPECT_TRUE(has_mean(products(turn, turn), 4.0 * (0.0004 + 2.0 * std::pow(0.5 * std::numbers::pi / 180.0, 2))));
}

TEST(Imu, Saturates) {
  Hovering drones({.accelerometer_noise_density = 0.5F, .accelerometer_range_mps2 = 9.0F, .gyroscope_range_radps = 1.5F}, 200);
  drones.batch.set_velocity({}, std::vector<float>(600, -2.0F), {});
  drones.batch.sense();
  drones.keep();
  for (const double value : drones.force.back()) EXPECT_LE(std::abs(value), 9.0);
  EXPECT_GT(std::ranges::count(drones.force.back(), 9.0), 60);
  EXPECT_EQ(std::ranges::count(drones.turn.back(), -1.5), 600);
}

// Each rotor adds a force that turns with it, at an angle of its own.
TEST(Imu, VibratesAtTheSpeedsOfTheRotors) {
  Hovering drones({.accelerometer_vibration_mps2 = 0.5F, .gyroscope_vibration_radps = 0.1F});
  const double speed = drones.batch.drone().airframe()->hover_speed(), squared = speed * speed * 1e-6;
  drones.fly(100);
  for (const std::size_t lag : {0U, 1U, 2U, 7U}) {
    const double kept = std::cos(speed * 0.002 * static_cast<double>(lag));
    for (const std::size_t axis : {0U, 1U}) {
      const auto product = [&](const std::vector<std::vector<double>>& readings) {
        return products(Hovering::axis(readings[90], axis), Hovering::axis(readings[90 + lag], axis));
      };
      EXPECT_TRUE(has_mean(product(drones.force), 4.0 * 0.5 * std::pow(0.5 * squared, 2) * kept)) << lag;
      EXPECT_TRUE(has_mean(product(drones.turn), 4.0 * 0.5 * std::pow(0.1 * squared, 2) * kept)) << lag;
    }
  }
  EXPECT_NEAR(moments(Hovering::axis(drones.force[90], 2)).mean, 9.81, 1e-3) << "in the plane of the rotors";
}

TEST(Imu, HasPresets) {
  EXPECT_EQ(ImuConfig::preset("bmi088").gyroscope_noise_density, 2.44e-4F);
  EXPECT_REFUSED(ImuConfig::preset("bmi"), "ImuConfig.preset: ... mpu-6000, bmi088, vn-100");
}

// A drone that flies a circle, and looks along it, accelerates towards the middle and turns at a constant rate.
TEST(Imu, DifferentiatesKinematicMotion) {
  constexpr double kRadiusM = 2.0, kRate = 1.5, kStepS = 0.02;
  BatchConfig config{.num_envs = 1, .num_threads = 1, .clock = {.policy_hz = 50.0F}};
  config.imus = {{.name = "centre"}, {.name = "inside", .offset_m = {0.0F, 0.5F, 0.0F}}};  // towards the middle
  Batch batch(config, open());
  const auto at = [&](double angle) {
    const auto half = static_cast<float>(angle / 2.0 + std::numbers::pi / 4.0);
    return std::pair(
        std::vector<float>{static_cast<float>(kRadiusM * std::cos(angle)), static_cast<float>(kRadiusM * std::sin(angle)), 1.0F},
        std::vector<float>{std::cos(half), 0.0F, 0.0F, std::sin(half)});
  };
  const auto [start, heading] = at(0.0);
  batch.set_pose(start, heading);
  batch.sense();
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().accelerometer, 0).isApprox(Vec3(0, 0, kG), 1e-6F)) << "at rest";
  for (int step = 1; step <= 100; ++step) {  // more than a turn: the quaternion changes its sign
    const auto [position, quat] = at(kRate * kStepS * step);
    batch.move(position, quat);
    batch.sense();
    if (step < 3) continue;  // the acceleration is the one of the last reading, a turn by 0.03 rad ago
    const Vec3 central(0.0F, static_cast<float>(kRadiusM * kRate * kRate), kG);
    const Vec3 inside(0.0F, static_cast<float>((kRadiusM - 0.5) * kRate * kRate), kG);
    EXPECT_LT((vector_at(batch.readings<ImuReadings>().accelerometer, 0) - central).norm(), 0.2F) << step;
    EXPECT_LT((vector_at(batch.readings<ImuReadings>(1).accelerometer, 0) - inside).norm(), 0.2F) << step;
    EXPECT_LT((vector_at(batch.readings<ImuReadings>().gyroscope, 0) - Vec3(0, 0, 1.5F)).norm(), 1e-3F) << step;
  }
  const std::vector<float> reading = batch.readings<ImuReadings>().accelerometer;
  batch.sense();
  EXPECT_EQ(batch.readings<ImuReadings>().accelerometer, reading) << "no time has passed";
  batch.begin_episode();
  batch.set_pose(start, heading);
  batch.sense();
  EXPECT_TRUE(vector_at(batch.readings<ImuReadings>().accelerometer, 0).isApprox(Vec3(0, 0, kG), 1e-6F)) << "at rest again";
}

TEST(Imu, RefusesWhatItsMotionLacks) {
  BatchConfig config = with_imu(1, {.gyroscope_vibration_radps = 0.1F});
  config.dynamics = {};
  EXPECT_REFUSED(config.validate(), "imu.gyroscope_vibration_radps: ... kinematic");
  EXPECT_REFUSED(ImuConfig{.gyroscope_noise_density = -1.0F}.validate(), "imu.gyroscope_noise_density");
  EXPECT_REFUSED(with_imu(1, {.rate_hz = 333.0F}).validate(), "imu.rate_hz: ... divides");
}

}  // namespace
}  // namespace flockstep
