// The race task: its crossings, its start rule and its curriculum, for any number of threads.

#include "batch_helpers.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/generators.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Two gates in a row, 4 m apart, along x.
std::shared_ptr<const World> lane(Visibility visibility = Visibility::full, GateShape shape = GateShape::square) {
  SceneDescription scene;
  scene.primitives = {{.kind = PrimitiveKind::room, .center = {0, 0, 5}, .half_extents = {30, 10, 5}}};
  for (const float x : {0.0F, 4.0F}) scene.gates.push_back({.shape = shape, .center = {x, 0, 5}, .visibility = visibility});
  return std::make_shared<const World>(std::move(scene));
}

BatchConfig race_batch(int num_envs, int num_threads = 1) {
  BatchConfig config = make_task(RaceConfig())->defaults().batch;
  config.num_envs = num_envs;
  config.num_threads = num_threads;
  return config;
}

const DroneModel& racer() {
  static const DroneModel model = DroneModel::load("racer5");
  return model;
}

std::unique_ptr<Batch> begun(const BatchConfig& config, const RaceConfig& race, Batch::Worlds worlds) {
  auto batch = std::make_unique<Batch>(config, std::move(worlds), make_task(race), racer());
  batch->reset({});
  return batch;
}

// One drone before the first gate of a lane, which it flies through at 10 m/s.
class Lane {
 public:
  explicit Lane(std::shared_ptr<const World> world, RaceConfig race = {})
      : batch_(begun(race_batch(1), race, {std::move(world)})) {
    // Episodes start behind a random gate: draw until the first is the next one.
    while (task_array<std::int32_t>(*batch_, "target")[0] != 0) batch_->reset({});
  }

  void place(const Vec3& position, const Vec3& velocity) {
    batch_->set_pose({position.data(), 3}, std::vector<float>{1, 0, 0, 0});
    batch_->set_velocity({velocity.data(), 3}, {}, {});
  }
  Batch& step() {
    batch_->step(std::vector<float>(4, 0.0F));
    return *batch_;
  }
  std::int64_t passed() const { return task_array<std::int64_t>(*batch_, "passed")[0]; }
  std::int32_t target() const { return task_array<std::int32_t>(*batch_, "target")[0]; }

 private:
  std::unique_ptr<Batch> batch_;
};

// Crosses the first gate in one step.
TEST(Race, GatesArePassedInTheirOpeningsAndMissedBesideThem) {
  constexpr auto kVisual = Visibility::visual, kFull = Visibility::full;
  constexpr auto kRing = GateShape::ring, kSquare = GateShape::square;
  constexpr auto kTask = EpisodeEnd::task, kContact = EpisodeEnd::contact, kNone = EpisodeEnd::none;
  struct Case {
    const char* what;
    Visibility visibility;
    GateShape shape;
    Vec3 position, velocity;
    std::int64_t passed;
    EpisodeEnd end;
  };
  for (const Case& one : std::vector<Case>{
           {"in the middle", kVisual, kSquare, {-0.1F, 0, 5}, {10, 0, 0}, 1, kNone},
           {"at the left end", kVisual, kSquare, {-0.1F, 0.7F, 5}, {10, 0, 0}, 1, kNone},
           {"at the right end", kVisual, kSquare, {-0.1F, -0.7F, 5}, {10, 0, 0}, 1, kNone},
           {"left of it", kVisual, kSquare, {-0.1F, 0.8F, 5}, {10, 0, 0}, 0, kTask},
           {"right of it", kVisual, kSquare, {-0.1F, -0.8F, 5}, {10, 0, 0}, 0, kTask},
           {"farther left", kVisual, kSquare, {-0.1F, 2.9F, 5}, {10, 0, 0}, 0, kTask},
           {"beyond miss_m", kVisual, kSquare, {-0.1F, 3.1F, 5}, {10, 0, 0}, 0, kNone},
           {"in a corner of a square", kVisual, kSquare, {-0.1F, 0.6F, 5.6F}, {10, 0, 0}, 1, kNone},
           {"outside of a ring, where a square has a corner", kVisual, kRing, {-0.1F, 0.6F, 5.6F}, {10, 0, 0}, 0, kTask},
           {"backwards", kVisual, kSquare, {0.1F, 0, 5}, {-10, 0, 0}, 0, kNone},
           {"backwards, beside it", kVisual, kSquare, {0.1F, 1, 5}, {-10, 0, 0}, 0, kNone},
           // At 60 m/s a step is 1.2 m long. The place of the crossing counts, and not that after the step.
           {"within, and on to a place beside it", kVisual, kSquare, {-0.1F, 0, 5}, {60, 60, 0}, 1, kNone},
           {"beside it, at y = 0.9, and on to y = 0", kVisual, kSquare, {-0.3F, 1.2F, 5}, {60, -60, 0}, 0, kTask},
           {"into a solid frame", kFull, kSquare, {-0.3F, 0.75F, 5}, {20, 0, 0}, 0, kContact},
           {"through a solid frame", kFull, kSquare, {-0.3F, 0, 5}, {20, 0, 0}, 1, kNone}}) {
    SCOPED_TRACE(one.what);
    Lane flight(lane(one.visibility, one.shape));
    flight.place(one.position, one.velocity);
    const Outputs& outputs = flight.step().outputs();
    EXPECT_EQ(flight.passed(), one.passed);
    EXPECT_EQ(outputs.terminated[0] != 0, one.end != kNone);
    EXPECT_EQ(static_cast<EpisodeEnd>(outputs.episode_end[0]), one.end);
  }
}

TEST(Race, LapsEndInSuccess) {
  Lane lap(lane(), {.laps = 1});
  lap.place({-0.1F, 0, 5}, {10, 0, 0});
  EXPECT_FALSE(lap.step().outputs().terminated[0]);
  EXPECT_EQ(lap.target(), 1);
  lap.place({3.9F, 0, 5}, {10, 0, 0});
  const Batch& batch = lap.step();
  EXPECT_TRUE(batch.outputs().terminated[0]);
  EXPECT_TRUE(batch.outputs().success[0]);
  EXPECT_EQ(batch.outputs().crashed[0], 0);
}

TEST(Race, ThePathHasThePositionsOfTheTicks) {
  // An env whose steps are single ticks flies the same commands, hovering, and so the same path.
  BatchConfig fine = race_batch(4);
  fine.clock.physics_hz = 500.0F;
  fine.episode.autoreset_mode = AutoresetMode::disabled;  // drones that touch something stay there
  BatchConfig ticks = fine;
  ticks.clock.policy_hz = 500.0F;
  for (const float x : {-2.0F, -0.2F}) {  // in the open, and next to a frame
    const auto all = begun(fine, {}, {lane()}), one = begun(ticks, {}, {lane()});
    Batch &whole = *all, &single = *one;
    std::vector<float> position, velocity;
    for (int i = 0; i < 4; ++i) {
      position.insert(position.end(), {x, 0.2F * static_cast<float>(i), 5});
      velocity.insert(velocity.end(), {i == 3 ? 4.0F : 1.0F, 0.5F, 0.0F});
    }
    for (Batch* const batch : {&whole, &single}) {
      batch->set_pose(position, std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0});
      batch->set_velocity(velocity, {}, {});
    }
    whole.step(std::vector<float>(16, 0.0F));
    const std::span<const float> path = whole.path();
    ASSERT_EQ(path.size(), 4U * 11U * 3U);
    for (std::size_t tick = 0; tick <= 10; ++tick) {
      for (std::size_t drone = 0; drone < 4; ++drone) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          EXPECT_NEAR(path[33 * drone + 3 * tick + axis], single.state().position[3 * drone + axis], 1e-5F) << tick;
        }
      }
      single.step(std::vector<float>(16, 0.0F));
    }
    for (std::size_t drone = 0; drone < 4; ++drone) {
      EXPECT_TRUE(same_bits(path.subspan(33 * drone + 30, 3), row(whole.state().position, drone, 3)));
      EXPECT_TRUE(same_bits(path.subspan(33 * drone, 3), std::span(position).subspan(3 * drone, 3)));
    }
  }
}

TEST(Race, WithoutATaskThatRecordsThePathThereIsNone) {
  Batch hover(race_batch(1), {lane()}, make_task(HoverConfig()), racer());
  hover.reset({});
  EXPECT_THROW(hover.path(), std::logic_error);
}

// Random flights that begin in front of gates. They pass gates, miss them and touch them.
struct RaceFlight {
  std::vector<float> observations;
  std::vector<float> rewards;
  std::string snapshot;
};

RaceFlight fly_race(Batch& batch, unsigned seed, int steps) {
  Random random(seed);
  RaceFlight flight;
  for (int step = 0; step < steps; ++step) {
    std::vector<float> actions;
    for (std::size_t i = 0; i < batch.state().active.size(); ++i) {
      actions.insert(actions.end(), {random.within(-0.5F, 0.7F), random.within(-1, 1), random.within(-1, 1), 0.1F});
    }
    batch.step(actions);
    const std::vector<float> seen = values_of(batch.outputs().observation[0]);
    flight.observations.insert(flight.observations.end(), seen.begin(), seen.end());
    flight.rewards.insert(flight.rewards.end(), batch.outputs().reward.begin(), batch.outputs().reward.end());
  }
  flight.snapshot = batch.snapshot();
  return flight;
}

RaceConfig lively() { return {.laps = 1, .start_speed_mps = 9.0F, .speed_cap_mps = {1.0F, 16.0F}, .cap_success = 0.0F}; }

TEST(Race, TheSameBitsForAnyNumberOfThreadsAndAfterARestore) {
  const Batch::Worlds worlds{race_track({.seed = 1}), lane(), race_track({.seed = 2, .gates = 5})};
  BatchConfig config = race_batch(100);
  config.episode.max_episode_steps = 40;
  config.block_size = 7;
  const auto first = begun(config, lively(), worlds);
  const RaceFlight flight = fly_race(*first, 1, 150);
  const auto caps = task_array<float>(*first, "speed_cap");
  EXPECT_GT(*std::ranges::max_element(caps), 1.0F) << "the curriculum has moved";
  for (const int threads : {2, 7}) {
    config.num_threads = threads;
    const auto other = begun(config, lively(), worlds);
    Batch& batch = *other;
    const RaceFlight same = fly_race(batch, 1, 150);
    EXPECT_TRUE(same_bits(same.observations, flight.observations));
    EXPECT_TRUE(same_bits(same.rewards, flight.rewards));
    EXPECT_EQ(same.snapshot, flight.snapshot);
    const RaceFlight on = fly_race(batch, 2, 50);
    batch.restore(flight.snapshot);
    const RaceFlight again = fly_race(batch, 2, 50);
    EXPECT_TRUE(same_bits(again.observations, on.observations));
    EXPECT_EQ(again.snapshot, on.snapshot);
  }
}

TEST(Race, WorldsAndConfigurationsThatCannotBeFlownAreRefused) {
  const auto refusal = [](std::shared_ptr<const World> world, const RaceConfig& race = {}) {
    return testing::refusal([&] { begun(race_batch(1), race, {std::move(world)}); });
  };
  EXPECT_EQ(refusal(lane()), "accepted");
  EXPECT_TRUE(names(refusal(closet()), R"(world "unnamed": gates: ... 2 ... 0)"));
  SceneDescription blocked;
  blocked.primitives = {{.kind = PrimitiveKind::box, .center = {5, 0, 2}, .half_extents = {0.1F, 0.1F, 0.1F}}};
  blocked.gates = {{.center = {0, 0, 2}}, {.center = {5, 0, 2}}};
  EXPECT_TRUE(refusal(std::make_shared<const World>(blocked)).find("gates[1]") != std::string::npos);
  EXPECT_TRUE(names(refusal(lane(), {.speed_cap_mps = {9.0F, 8.0F}}), "task.speed_cap_mps"));
  EXPECT_TRUE(names(refusal(lane(), {.laps = 0}), "task.laps: ... [1, 1000] ... 0"));
  BatchConfig config = race_batch(1);
  config.dynamics.control = Control::velocity;
  EXPECT_REFUSED(begun(config, {}, {lane()}), R"(control: ... "body_rates" ... "velocity")");
}

}  // namespace
}  // namespace flockstep
