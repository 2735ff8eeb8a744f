#include "flockstep/learner.hpp"

#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr int kEnvs = 37;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Observes the last action, and the env and its steps in another field whose name comes first. Ends after 3 to 6 steps.
class Echo final : public Task {
 public:
  explicit Echo(bool is_infinite = false) : is_infinite_(is_infinite) {
    spec_.action = {.name = "action", .shape = {2}, .low = {-0.5, -1.0}, .high = {0.25, 2.0}};
    spec_.observation = {{.name = "z", .shape = {2}, .low = {-9.0}, .high = {9.0}},
                         {.name = "a", .type = DType::float64, .shape = {2}, .low = {0.0}, .high = {kInfinity}}};
    spec_.reward_terms = {"sum"};
  }

  const TaskSpec& spec() const override { return spec_; }
  std::string identity() const override { return "echo"; }
  void setup(const TaskContext& context) override { last_.resize(2 * context.num_drones()); }
  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) last_[2 * drone] = last_[2 * drone + 1] = 0.0F;
  }
  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) {
      const std::span<const float> action = actions.row<float>(drone);
      EXPECT_TRUE(action[0] >= -0.5F && action[0] <= 0.25F && action[1] >= -1.0F && action[1] <= 2.0F);
      last_[2 * drone] = action[0];
      last_[2 * drone + 1] = action[1];
      setpoints.target[drone] = pose_of(block.context.state(), drone);
    }
  }
  void score(const TaskBlock& block, Score& score) override {
    for (const DroneIndex drone : block.drones) {
      score.terms_of(drone)[0] = static_cast<double>(last_[2 * drone] + last_[2 * drone + 1]);
      const bool is_over = block.context.episodes().steps[drone] >= 3 + static_cast<std::int64_t>(drone % 4);
      score.terminated[drone] = is_over && drone % 2 == 0 ? 1 : 0;
      score.truncated[drone] = is_over && drone % 2 == 1 ? 1 : 0;
      score.success[drone] = 0;
    }
  }
  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const DroneIndex drone : block.drones) {
      for (std::size_t i = 0; i < 2; ++i) observation[0].row<float>(drone)[i] = last_[2 * drone + i];
      const auto steps = static_cast<double>(block.context.episodes().steps[drone]);
      observation[1].row<double>(drone)[0] = static_cast<double>(drone) / kEnvs;
      observation[1].row<double>(drone)[1] = is_infinite_ && drone == 20 && steps >= 1.0 ? kInfinity : steps;
    }
  }
  void visit(ArrayVisitor&) override {}

 private:
  bool is_infinite_;
  TaskSpec spec_;
  std::vector<float> last_;
};

std::unique_ptr<Batch> make_batch(int threads, AutoresetMode mode, bool is_infinite = false) {
  BatchConfig config{.num_envs = kEnvs, .num_threads = threads};
  config.episode.autoreset_mode = mode;
  auto batch = std::make_unique<Batch>(config, Batch::Worlds{closet()}, std::make_unique<Echo>(is_infinite));
  std::vector<std::uint64_t> seeds(kEnvs);
  for (std::size_t env = 0; env < seeds.size(); ++env) seeds[env] = env;
  batch->reset(seeds);
  return batch;
}

NetworkConfig network() { return {.observation_size = 4, .action_size = 2, .actor_layers = {9}, .critic_layers = {17, 5}}; }

// Flies two rollouts and learns from them. Returns the parameters.
std::vector<float> train(int threads, AutoresetMode mode, int critic_only = 0) {
  const auto batch = make_batch(threads, mode);
  NetworkConfig config_of_networks = network();
  config_of_networks.critic_only = critic_only;
  Learner learner(config_of_networks, 1, 3);  // the batch's threads may be more
  for (int rollout = 0; rollout < 2; ++rollout) {
    RolloutConfig config;
    config.n_steps = 20;
    config.normalize_observations = config.normalize_rewards = true;
    learner.begin(config, kEnvs);
    for (int t = 0; t < config.n_steps; ++t) learner.fly(t, *batch, 0.5F);
    std::vector<float> observation(4 * kEnvs);
    learner.read_observation(*batch, observation);
    learner.finish(observation);
    UpdateConfig update;
    update.batch_size = 300;
    const UpdateReport report = learner.update(update);
    EXPECT_TRUE(report.is_finite);
    EXPECT_EQ(report.epochs, 10);
  }
  return learner.parameters();
}

TEST(Learner, ThreadsDoNotChangeTheBits) {
  for (const AutoresetMode mode : {AutoresetMode::same_step, AutoresetMode::next_step}) {
    const std::vector<float> one = train(1, mode);
    EXPECT_NE(one, Learner(network(), 1, 3).parameters());
    for (const int threads : {2, 7}) EXPECT_EQ(train(threads, mode), one) << threads << " threads";
    EXPECT_EQ(train(1, mode, 3), train(7, mode, 3));
    EXPECT_EQ(train(1, mode, 3).size(), one.size() - 3 * 9);
  }
}

TEST(Learner, ActsWithoutTheNumbersOfTheCritic) {
  NetworkConfig config = network();
  config.critic_only = 3;
  Learner learner(config, 2, 0);
  std::vector<float> whole, part, values(70), others(70);
  for (int row = 0; row < 70; ++row) {
    part.push_back(0.1F * static_cast<float>(row));
    whole.insert(whole.end(), {part.back(), 1.0F, -2.0F, 3.0F});
  }
  std::vector<float> actions(2 * 70), same(2 * 70);
  learner.predict(whole, actions);
  learner.predict(part, same);
  EXPECT_EQ(actions, same);
  EXPECT_NE(actions[0], actions[2]);
  learner.values(whole, values);
  for (std::size_t i = 1; i < whole.size(); i += 4) whole[i] = 0.0F;
  learner.predict(whole, same);
  learner.values(whole, others);
  EXPECT_EQ(actions, same);
  EXPECT_NE(values, others);
  EXPECT_REFUSED(learner.values(part, values), "observation: ... 4 ... 70");
  EXPECT_REFUSED(learner.predict(std::span(part).first(69), actions), "observation: ... 4 ... 69");
  config.critic_only = 4;
  EXPECT_REFUSED(config.validate(), "critic_only: ... 3 ... 4");
}

TEST(Learner, ReadsFieldsInTheOrderOfTheirNames) {
  const auto batch = make_batch(2, AutoresetMode::same_step);
  Learner learner(network(), 2, 0);
  learner.begin({}, kEnvs);
  for (int t = 0; t < 5; ++t) learner.fly(t, *batch);
  std::vector<float> observation(4 * kEnvs);
  learner.read_observation(*batch, observation);
  const std::vector<Buffer>& fields = batch->outputs().observation;
  for (std::size_t row = 0; row < kEnvs; ++row) {
    EXPECT_EQ(observation[4 * row], static_cast<float>(static_cast<double>(row) / kEnvs));
    EXPECT_EQ(observation[4 * row + 1], static_cast<float>(fields[1].row<double>(row)[1]));
    EXPECT_EQ(observation[4 * row + 2], fields[0].row<float>(row)[0]);
    EXPECT_EQ(observation[4 * row + 3], fields[0].row<float>(row)[1]);
  }
}

template <class Call>
std::string bad_number(const Call& call) {
  return testing::refusal<NotFiniteError>(call);
}

TEST(Learner, RefusesInfiniteObservationsOfABatch) {
  for (const bool normalizes : {false, true}) {
    const auto batch = make_batch(2, AutoresetMode::same_step, true);
    Learner learner(network(), 2, 0);
    RolloutConfig config;
    config.normalize_observations = normalizes;
    learner.begin(config, kEnvs);
    learner.fly(0, *batch);
    const std::string message = bad_number([&] { learner.fly(1, *batch); });
    EXPECT_TRUE(testing::names(message, std::string("observation: ... ") + (normalizes ? "inf" : "others") + " in row 20"));
    for (const double mean : learner.observation_moments().mean) EXPECT_TRUE(std::isfinite(mean));
    batch->step(std::vector<float>(2 * kEnvs));  // which still flies
  }
}

TEST(Learner, RefusesOtherBatches) {
  const auto batch = make_batch(1, AutoresetMode::same_step);
  Learner learner(network(), 1, 0);
  EXPECT_NE(refusal([&] { learner.fly(0, *batch); }), "accepted");  // no rollout
  learner.begin({}, kEnvs - 1);
  EXPECT_REFUSED(learner.fly(0, *batch), "batch: ... 36 ... 37");
  NetworkConfig other = network();
  other.is_discrete = true;
  Learner discrete(other, 1, 0);
  discrete.begin({}, kEnvs);
  EXPECT_REFUSED(discrete.fly(0, *batch), "batch: ... discrete");
  other = network();
  other.observation_size = 5;
  Learner larger(other, 1, 0);
  larger.begin({}, kEnvs);
  EXPECT_REFUSED(larger.fly(0, *batch), "batch: ... 5 ... 4");
}

TEST(Learner, AdmitsOneThreadAtATime) {
  Learner learner(network(), 2, 0);
  std::atomic<int> admitted{0}, refused{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      const std::vector<float> observation(4 * 300);
      std::vector<float> action(2 * 300);
      for (int call = 0; call < 200; ++call) {
        try {
          learner.sample(observation, action);
          ++admitted;
        } catch (const std::runtime_error&) {
          ++refused;
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(admitted + refused, 800);
  EXPECT_EQ(learner.draws(), static_cast<std::uint64_t>(admitted));
}

}  // namespace
}  // namespace flockstep
