// The observations that learning differentiates are the tasks' own, and the gradient of a window predicts how its loss changes.
#include "tasks/flight_gradient.hpp"

#include "batch_helpers.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/learner.hpp"

namespace flockstep {
namespace {

using namespace testing;

// A task that compares each of its observations with the differentiated formula.
class Watched final : public Task {
 public:
  explicit Watched(std::unique_ptr<Task> task)
      : task_(std::move(task)), gradient_(dynamic_cast<task::FlightGradient*>(task_.get())) {}

  const TaskSpec& spec() const override { return task_->spec(); }
  std::string identity() const override { return task_->identity(); }
  void setup(const TaskContext& context) override { task_->setup(context); }
  void place(const TaskBlock& block) override { task_->place(block); }
  void begin(const TaskBlock& block) override { task_->begin(block); }
  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    task_->command(block, actions, setpoints);
  }
  void score(const TaskBlock& block, Score& score) override { task_->score(block, score); }
  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    task_->observe(block, observation);
    for (std::size_t first = 0; first < block.drones.size(); first += dynamics::kLanes) {
      compare(block.context, block.drones.subspan(first, std::min(dynamics::kLanes, block.drones.size() - first)),
              observation[0]);
    }
  }
  void visit(ArrayVisitor& visitor) override { task_->visit(visitor); }
  bool takes(Control control) const override { return task_->takes(control); }

  static inline long compared;

 private:
  void compare(const TaskContext& context, std::span<const DroneIndex> drones, Buffer& observation) {
    task::GradientStep step{};
    step.constants.resize(gradient_->num_constants());
    dynamics::LaneDrones lanes;
    for (std::size_t lane = 0; lane < dynamics::kLanes; ++lane) {
      lanes[lane] = drones[std::min(lane, drones.size() - 1)];
      std::vector<float> constants(step.constants.size());
      gradient_->write_constants(context, lanes[lane], constants.data());
      for (std::size_t i = 0; i < constants.size(); ++i) step.constants[i][lane] = constants[i];
      for (std::size_t i = 0; i < 4; ++i) step.action_before[i][lane] = gradient_->last_actions()[4 * lanes[lane] + i];
    }
    dynamics::StepGradient::read(context.state(), lanes, step.start.flown);
    AlignedVector<dynamics::Lane> found(observation.row<float>(drones[0]).size());
    TapeMemory<float> memory;
    task::observe(gradient_->terms(), step, memory, found);
    for (std::size_t lane = 0; lane < drones.size(); ++lane) {
      const std::span<const float> expected = observation.row<float>(drones[lane]);
      for (std::size_t i = 0; i < expected.size(); ++i) {
        ASSERT_NEAR(found[i][lane], expected[i], 1e-5F * std::max(1.0F, std::abs(expected[i]))) << "number " << i;
      }
      ++compared;
    }
  }

  std::unique_ptr<Task> task_;
  task::FlightGradient* gradient_;
};

std::shared_ptr<const World> arena() { return make_world({primitive(PrimitiveKind::room, {0, 0, 5}, {8, 8, 5})}); }

template <class Config>
BatchConfig flights(const Config& task, int num_envs, Control control) {
  BatchConfig config = make_task(task)->defaults().batch;
  config.num_envs = num_envs;
  config.num_threads = 1;
  config.dynamics.control = control;
  return config;
}

template <class Config>
void expect_same_observations(const Config& task, const Batch::Worlds& worlds, const char* drone, Control control) {
  BatchConfig config = flights(task, 19, control);
  config.episode.max_episode_steps = 30;
  Batch batch(config, worlds, std::make_unique<Watched>(make_task(task)), DroneModel::load(drone));
  batch.reset({});
  Random random(3);
  std::vector<float> actions(4 * 19);
  Watched::compared = 0;
  for (int step = 0; step < 100; ++step) {
    for (float& action : actions) action = random.within(-1.2F, 1.2F);
    batch.step(actions);
  }
  EXPECT_GE(Watched::compared, 19 * 100);
}

TEST(FlightGradient, ObservesWhatTasksObserve) {
  expect_same_observations(HoverConfig(), {arena()}, "crazyflie", Control::rotor_thrusts);
  expect_same_observations(HoverConfig(), {arena()}, "x500", Control::velocity);
  for (const TrackPath path : {TrackPath::figure8, TrackPath::random}) {
    for (const TrackYaw yaw : {TrackYaw::fixed, TrackYaw::along}) {
      for (const int points : {1, 5, 20}) {
        expect_same_observations(TrackConfig{.path = path, .yaw = yaw, .points = points}, {arena()}, "crazyflie",
                                 Control::body_rates);
      }
    }
  }
  for (const int gates : {1, 3}) {
    expect_same_observations(RaceConfig{.gates_ahead = gates}, {race_track({.seed = 1}), race_track({.seed = 2, .gates = 5})},
                             "racer5", Control::body_rates);
  }
}

// Changes the parameters along the gradient, and compares the change of the loss with what the gradient says.
template <class Config>
void expect_predicted_loss(const Config& task, const Batch::Worlds& worlds, const char* drone, Control control,
                           const std::vector<Variation>& variations = {}) {
  constexpr int kEnvs = 64;
  GradientConfig window{.horizon = 12, .learning_rate = 0.0, .ticks = 2};
  BatchConfig config = flights(task, kEnvs, control);
  config.dynamics.integrator = Integrator::midpoint;
  config.clock.physics_hz = config.clock.policy_hz * static_cast<float>(window.ticks);
  config.clock.controller_hz = {};
  config.variations = variations;
  Batch batch(config, worlds, make_task(task), DroneModel::load(drone));
  batch.reset(seeds_from(7, kEnvs));
  const std::size_t size = batch.spec().observation[0].size();
  Learner learner({.observation_size = static_cast<int>(size), .action_size = 4, .actor_layers = {16}}, 1, 5);
  const std::string start = batch.snapshot();
  const auto loss_at = [&](const std::vector<float>& parameters) {
    batch.restore(start);
    learner.set_parameters(parameters);
    return learner.learn_window(window, batch).loss;
  };
  const std::vector<float> parameters = learner.parameters();
  loss_at(parameters);
  const std::vector<float> gradient = learner.window_gradient();
  double squares = 0.0;
  for (const float each : gradient) squares += static_cast<double>(each) * static_cast<double>(each);
  ASSERT_GT(squares, 0.0);
  const double step = 2e-3 / std::sqrt(squares);
  std::vector<float> ahead = parameters, behind = parameters;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    ahead[i] += static_cast<float>(step * static_cast<double>(gradient[i]));
    behind[i] -= static_cast<float>(step * static_cast<double>(gradient[i]));
  }
  EXPECT_NEAR((loss_at(ahead) - loss_at(behind)) / (2.0 * step * squares), 1.0, 0.02);
}

TEST(FlightGradient, PredictsTheChangeOfALoss) {
  expect_predicted_loss(HoverConfig(), {arena()}, "crazyflie", Control::rotor_thrusts);
  expect_predicted_loss(HoverConfig(), {arena()}, "hummingbird", Control::body_rates);
  expect_predicted_loss(TrackConfig(), {arena()}, "crazyflie", Control::body_rates);
  expect_predicted_loss(RaceConfig(), {race_track({.seed = 1})}, "racer5", Control::body_rates);
}

TEST(FlightGradient, PredictsTheChangeOfALossIfCommandsAreLate) {
  std::vector<Variation> late;
  for (const char* name : {"action_delay_s", "action_jitter_s"}) {
    late.push_back({.parameter = name, .low = 0.0F, .high = 0.06F});
  }
  late.push_back({.parameter = "action_loss", .low = 0.0F, .high = 0.3F});
  expect_predicted_loss(HoverConfig(), {arena()}, "crazyflie", Control::rotor_thrusts, late);
  expect_predicted_loss(TrackConfig(), {arena()}, "crazyflie", Control::body_rates, late);
  expect_predicted_loss(RaceConfig(), {race_track({.seed = 1})}, "racer5", Control::body_rates, late);
}

}  // namespace
}  // namespace flockstep
