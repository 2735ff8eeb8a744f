#include "batch_helpers.hpp"
#include "sensors/sensor.hpp"

namespace flockstep {
namespace {

using sensors::is_due;
using sensors::period_in_ticks;
using namespace testing;

// Returns a clock with ticks of dt_s and `substeps` ticks per step.
ClockConfig clock_of(float dt_s, int substeps) {
  const float ticks_hz = 1.0F / dt_s;
  return {.policy_hz = ticks_hz / static_cast<float>(substeps), .physics_hz = ticks_hz};
}

std::int64_t period(std::optional<float> rate_hz, float dt_s, int substeps = 1) {
  return period_in_ticks(rate_hz, clock_of(dt_s, substeps), "lidar.rate_hz");
}

TEST(Rate, ItsPeriodIsCountedInTicks) {
  EXPECT_EQ(period(std::nullopt, 0.1F), 0);
  EXPECT_EQ(period(10.0F, 0.1F), 1);
  EXPECT_EQ(period(5.0F, 0.1F), 2);
  EXPECT_EQ(period(10.0F / 3.0F, 0.1F), 3);
  EXPECT_EQ(period(2.5F, 0.1F), 4);
  EXPECT_EQ(period(0.01F, 0.1F), 1000);
  EXPECT_EQ(period(2.5F, 0.1F, 4), 4) << "ticks, not steps";
  EXPECT_EQ(period(1e5F, 1e-5F), 1);
  for (const float dt_s : {1e-5F, 0.001F, 1.0F / 240.0F, 0.02F, 0.1F, 1.0F, 10.0F}) {
    for (int ticks = 1; ticks <= 1000; ++ticks) {
      const auto rate_hz = static_cast<float>(1.0 / (static_cast<double>(ticks) * static_cast<double>(dt_s)));
      ASSERT_EQ(period(rate_hz, dt_s), ticks) << dt_s;
    }
  }
}

TEST(Rate, RefusesOneThatTheClockCannotKeep) {
  EXPECT_REFUSED(period(20.0F, 0.1F), "lidar.rate_hz: ... 10.000000 ... 20");
  EXPECT_REFUSED(period(3.0F, 0.1F), "lidar.rate_hz: ... divides");
  EXPECT_REFUSED(period(9.99F, 0.1F), "lidar.rate_hz: ... divides");
  EXPECT_REFUSED(period(15.0F, 0.1F, 4), "lidar.rate_hz: ... divides");
  EXPECT_REFUSED(period(1e-12F, 0.1F), "lidar.rate_hz: ... divides");
  for (const float nonsense : {0.0F, -5.0F, std::numeric_limits<float>::infinity(), kNan}) {
    EXPECT_REFUSED(period(nonsense, 0.1F), "lidar.rate_hz: ... 0");
  }
}

TEST(Clock, RefusesRatesThatDoNotDivide) {
  const auto clock = [](float policy, std::optional<float> physics, std::optional<float> controller) {
    return ClockConfig{.policy_hz = policy, .physics_hz = physics, .controller_hz = controller};
  };
  EXPECT_NO_THROW(clock(50.0F, 500.0F, 100.0F).validate());
  EXPECT_NO_THROW(clock(1.0F / 3.0F, 1000.0F / 3.0F, std::nullopt).validate());
  EXPECT_REFUSED(clock(60.0F, 500.0F, std::nullopt).validate(), "physics_hz: ... (60 Hz) ... 1000 ... 500 Hz");
  EXPECT_REFUSED(clock(50.0F, 25.0F, std::nullopt).validate(), "physics_hz");
  EXPECT_REFUSED(clock(1.0F, 1001.0F, std::nullopt).validate(), "physics_hz");
  EXPECT_REFUSED(clock(50.0F, 500.0F, 200.0F).validate(), "controller_hz: ... (500 Hz) ... 200 Hz");
  EXPECT_REFUSED(clock(100.0F, 500.0F, 250.0F).validate(), "controller_hz: ... (100 Hz) ... 250 Hz");
  EXPECT_REFUSED(clock(50.0F, 500.0F, 25.0F).validate(), "controller_hz");
  for (const float nonsense : {0.0F, -5.0F, std::numeric_limits<float>::infinity(), kNan}) {
    EXPECT_REFUSED(clock(nonsense, std::nullopt, std::nullopt).validate(), "policy_hz");
    EXPECT_REFUSED(clock(50.0F, nonsense, std::nullopt).validate(), "physics_hz");
    EXPECT_REFUSED(clock(50.0F, 500.0F, nonsense).validate(), "controller_hz");
  }
}

TEST(Rate, OfABatchIsCheckedForEverySensor) {
  const Batch::Worlds worlds{closet()};
  BatchConfig config = lidar_batch(1, {.rate_hz = 3.0F});
  EXPECT_REFUSED(Batch(config, worlds), "lidar.rate_hz");
  config.clock.policy_hz = 3.0F;
  EXPECT_NO_THROW(Batch(config, worlds));
  config = {};
  config.pose_sensor.rate_hz = 3.0F;
  EXPECT_REFUSED(Batch(config, worlds), "pose_sensor.rate_hz");
  config = {};
  config.cameras = {{.rate_hz = 3.0F}};
  EXPECT_REFUSED(Batch(config, worlds), "camera.rate_hz");
}

TEST(Rate, IsDueAfterItsPeriodOrAfterEachStep) {
  for (std::int64_t tick = 0; tick < 20; ++tick) {
    for (const bool step_is_over : {false, true}) {
      EXPECT_EQ(is_due(0, tick, step_is_over), step_is_over);
      EXPECT_TRUE(is_due(1, tick, step_is_over));
      EXPECT_EQ(is_due(5, tick, step_is_over), tick == 0 || tick == 5 || tick == 10 || tick == 15);
    }
  }
}

// -- A batch that flies in +x, 0.5 m per step of 4 ticks, with a sensor that is due every few ticks.

constexpr int kSubsteps = 4;
const Vec3 kStart(4, 10, 5);

std::shared_ptr<const World> open_hall() {
  return make_world({primitive(PrimitiveKind::room, {10, 10, 5}, {10, 10, 5})}, {.start = kStart, .goal = Vec3(10, 2, 5)});
}

NavigationBatch flying() {
  NavigationBatch config = navigation_batch(1, {.max_range_m = 30.0F});
  config.navigation.step_m = 0.5F;
  config.clock = clock_of(0.1F, kSubsteps);
  return config;
}

float rate_of(int ticks) { return 10.0F / static_cast<float>(ticks); }

// Returns the drone's position after some ticks. Its x is exact in float32.
std::vector<float> place_after(std::int64_t ticks) {
  return {kStart.x() + 0.125F * static_cast<float>(ticks), kStart.y(), kStart.z()};
}

void step(Batch& batch) {
  const std::int64_t forward = 0;
  batch.step(std::span(&forward, 1));
}

TEST(Rate, ALidarHoldsItsReadingsBetweenScans) {
  for (const int ticks : {1, 2, 3, 4, 8, 12, 7}) {
    SCOPED_TRACE("every " + std::to_string(ticks) + " ticks");
    NavigationBatch config = flying();
    config.lidars[0].rate_hz = rate_of(ticks);
    Batch batch = config.make({open_hall()});
    Batch by_hand(lidar_batch(1, flying().lidars[0]), {open_hall()});
    const auto read = [&](std::int64_t tick) {
      by_hand.set_pose(place_after(tick), {});
      by_hand.sense();
      return by_hand.lidar().readings().ranges;
    };
    batch.reset({});
    EXPECT_TRUE(same_bits(batch.lidar().readings().ranges, read(0))) << "the first moment of an episode is always read";
    int held = 0;
    for (int steps = 1; steps <= 13; ++steps) {
      step(batch);
      const std::int64_t tick = kSubsteps * steps;
      ASSERT_EQ(batch.state().tick[0], tick);
      ASSERT_EQ(batch.state().position, place_after(tick));
      const std::int64_t last = tick - tick % ticks;
      EXPECT_TRUE(same_bits(batch.lidar().readings().ranges, read(last))) << "after step " << steps;
      held += last < tick && !same_bits(batch.lidar().readings().ranges, read(tick));
    }
    EXPECT_EQ(held > 0, kSubsteps % ticks != 0);
    // The next episode starts with a new reading.
    batch.reset({});
    EXPECT_EQ(batch.state().tick[0], 0);
    EXPECT_TRUE(same_bits(batch.lidar().readings().ranges, read(0)));
  }
}

TEST(Rate, ALidarWithoutOneReadsAfterEveryStep) {
  Batch batch = flying().make({open_hall()});
  Batch by_hand(lidar_batch(1, flying().lidars[0]), {open_hall()});
  batch.reset({});
  for (int steps = 1; steps <= 5; ++steps) {
    step(batch);
    by_hand.set_pose(place_after(kSubsteps * steps), {});
    by_hand.sense();
    EXPECT_TRUE(same_bits(batch.lidar().readings().ranges, by_hand.lidar().readings().ranges));
  }
}

TEST(Rate, ThePoseSensorHoldsItsReadings) {
  for (const int ticks : {2, 3, 8}) {
    NavigationBatch config = flying();
    config.pose_sensor.rate_hz = rate_of(ticks);
    Batch batch = config.make({open_hall()});
    batch.reset({});
    EXPECT_EQ(batch.pose_readings().position, place_after(0));
    for (int steps = 1; steps <= 13; ++steps) {
      step(batch);
      const std::int64_t tick = kSubsteps * steps;
      EXPECT_EQ(batch.pose_readings().position, place_after(tick - tick % ticks));
    }
  }
}

// Every reading has independent noise, even if a step has several readings. Held readings do not change.
TEST(Rate, NoiseIsOfTheReading) {
  NavigationBatch config = flying();
  config.pose_sensor = {.position_noise_std_m = 0.1F, .rate_hz = rate_of(8)};
  Batch batch = config.make({open_hall()});
  batch.reset({});
  std::vector<float> last = batch.pose_readings().position;
  for (int steps = 1; steps <= 12; ++steps) {
    step(batch);
    EXPECT_EQ(batch.pose_readings().position == last, steps % 2 == 1);
    last = batch.pose_readings().position;
  }
}

TEST(Rate, ACameraTakesAFrameAtTheEndOfAStepInWhichOneIsDue) {
  for (const int ticks : {1, 4, 6, 8, 20}) {
    SCOPED_TRACE("every " + std::to_string(ticks) + " ticks");
    NavigationBatch config = flying();
    config.cameras = {{.width_px = 1, .height_px = 1, .outputs = {.rgb = false, .depth = true}, .rate_hz = rate_of(ticks)}};
    Batch batch = config.make({open_hall()});
    batch.reset({});
    std::int64_t frame = 0;
    for (int steps = 0; steps <= 13; ++steps) {
      if (steps > 0) step(batch);
      const std::int64_t tick = kSubsteps * steps;
      if (tick / ticks != kSubsteps * frame / ticks) frame = steps;
      EXPECT_EQ(batch.camera(0).images().frame_step[0], frame);
      EXPECT_FLOAT_EQ(batch.camera(0).images().depth[0], 20.0F - place_after(kSubsteps * frame)[0]);
    }
  }
}

// sense() and capture() request a reading now, at any rate.
TEST(Rate, ByHandASensorReadsAtOnce) {
  BatchConfig config = lidar_batch(1, {.max_range_m = 30.0F, .azimuth_deg = {0}, .elevation_deg = {0}, .rate_hz = 0.5F});
  config.pose_sensor.rate_hz = 0.5F;
  Batch batch(config, {open_hall()});
  for (int i = 0; i < 5; ++i) {
    batch.move(place_after(i), {});
    batch.sense();
    EXPECT_EQ(batch.pose_readings().position, place_after(i));
    EXPECT_FLOAT_EQ(batch.lidar().readings().ranges[0], 20.0F - place_after(i)[0]);
  }
}

// -- Substeps.

TEST(Substeps, EndWhereOneStepEnds) {
  for (const int substeps : {2, 3, 4, 10}) {
    NavigationBatch config = navigation_batch(1);
    config.navigation.action = ActionKind::displacement_yaw;
    config.navigation.step_m = 0.3F;
    config.episode.autoreset_mode = AutoresetMode::disabled;
    Batch whole = config.make({open_hall()});
    config.clock = clock_of(0.1F, substeps);
    Batch parts = config.make({open_hall()});
    for (Batch* batch : {&whole, &parts}) batch->reset({});
    for (int i = 0; i < 20; ++i) {
      const std::vector<float> action{0.7F, -0.4F, 0.1F * static_cast<float>(i % 3), 0.5F};
      for (Batch* batch : {&whole, &parts}) batch->step(std::span<const float>(action));
      ASSERT_EQ(parts.state().position, whole.state().position) << "a free flight ends at its target";
      ASSERT_EQ(parts.state().quat_wxyz, whole.state().quat_wxyz);
    }
  }
}

TEST(Substeps, AnObstacleStopsTheDroneUntilTheNextStep) {
  NavigationBatch config = navigation_batch(1);
  config.navigation.step_m = 0.5F;
  config.episode.autoreset_mode = AutoresetMode::disabled;
  Batch whole = config.make({open_hall()});
  config.clock = clock_of(0.1F, kSubsteps);
  Batch parts = config.make({open_hall()});
  for (Batch* batch : {&whole, &parts}) {
    batch->reset({});
    batch->set_pose(std::vector<float>{19.25F, 10, 5}, {});  // the nose is 0.465 m ahead, the wall at 20: hit in the third tick
    step(*batch);
    EXPECT_TRUE(batch->state().contact.hit[0]);
    EXPECT_TRUE(batch->outputs().crashed[0]);
  }
  EXPECT_NEAR(parts.state().position[0], whole.state().position[0], 1e-3);
  EXPECT_LT(parts.state().position[0], 20.0F - 0.465F);
  EXPECT_EQ(parts.state().tick[0], kSubsteps) << "time passes all the same";
}

}  // namespace
}  // namespace flockstep
