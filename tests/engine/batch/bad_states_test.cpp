#include "batch/bad_states.hpp"

#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using namespace testing;

enum class What : std::uint8_t { nothing, position, rotation, reward, observation, first_observation, place };

// A single fault in one env, in a step of its first episode or at the start of its second.
struct Fault {
  What what = What::nothing;
  float value = kNan;
  std::uint32_t env = 1;
  std::int64_t step = 3;
};

// Drifts slowly in +x. Observes its position, and values that are infinite by declaration.
class Drift final : public Task {
 public:
  explicit Drift(const Fault& fault) : fault_(fault) {
    spec_.action = {.name = "action", .type = DType::int64, .low = {0.0}, .high = {1.0}};
    spec_.observation = {
        {.name = "x", .shape = {2}, .low = {-10.0}, .high = {10.0}},
        {.name = "far", .type = DType::float64, .shape = {2}, .low = {0.0, -kInfinity}, .high = {kInfinity, 0.0}}};
    spec_.reward_terms = {"one", "more"};
  }

  const TaskSpec& spec() const override { return spec_; }
  std::string identity() const override { return "drift"; }
  void setup(const TaskContext&) override {}
  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      Pose pose{Vec3(1, 1, 0.75F), Quat::Identity()};
      if (begins(What::place, block, drone)) pose.position.y() = fault_.value;
      block.context.place(drone, pose);
    }
  }
  void begin(const TaskBlock&) override {}
  void command(const TaskBlock& block, const Buffer&, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) {
      Pose& target = setpoints.target[drone] = pose_of(block.context.state(), drone);
      target.position.x() += 0.001F;
      if (hits(What::position, block, drone)) target.position.y() = fault_.value;
      if (hits(What::rotation, block, drone)) target.rotation.x() = fault_.value;
    }
  }
  void score(const TaskBlock& block, Score& score) override {
    for (const DroneIndex drone : block.drones) {
      score.terms_of(drone)[0] = 1.0;
      score.terms_of(drone)[1] = hits(What::reward, block, drone) ? fault_.value : 0.5;
      score.terminated[drone] = 0;
      score.success[drone] = 1;
    }
  }
  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const DroneIndex drone : block.drones) {
      const bool bad = hits(What::observation, block, drone) || begins(What::first_observation, block, drone);
      observation[0].row<float>(drone)[0] = position_of(block.context.state(), drone).x();
      observation[0].row<float>(drone)[1] = bad ? fault_.value : 1.0F;
      observation[1].row<double>(drone)[0] = kInfinity;
      observation[1].row<double>(drone)[1] = -kInfinity;
    }
  }
  void visit(ArrayVisitor&) override {}

 private:
  bool hits(What what, const TaskBlock& block, DroneIndex drone) const {
    return what == fault_.what && drone == fault_.env && block.context.state().episode[drone] == 0 &&
           block.context.episodes().steps[drone] == fault_.step;
  }
  bool begins(What what, const TaskBlock& block, DroneIndex drone) const {
    return what == fault_.what && drone == fault_.env && block.context.state().episode[drone] == 1 &&
           block.context.episodes().steps[drone] == 0;
  }

  Fault fault_;
  TaskSpec spec_;
};

std::unique_ptr<Batch> make(const Fault& fault, AutoresetMode mode, int max_steps = 5) {
  BatchConfig config{.num_envs = 3, .num_threads = 1};
  config.episode.autoreset_mode = mode;
  config.episode.max_episode_steps = max_steps;
  static const auto world = closet();  // one world for all, so that drones can be compared
  auto batch = std::make_unique<Batch>(config, Batch::Worlds{world}, std::make_unique<Drift>(fault));
  batch->reset(std::vector<std::uint64_t>{0, 1, 2});
  return batch;
}

void fly(Batch& batch) { batch.step(std::vector<std::int64_t>(3, 0)); }

bool all_declared(const std::vector<Buffer>& observation, std::size_t env) {
  const auto x = observation[0].row<float>(env);
  const auto far = observation[1].row<double>(env);
  return std::isfinite(x[0]) && std::isfinite(x[1]) && (far[0] == kInfinity || far[0] == 0.0);
}

TEST(BadStates, OneOfAFlownStepEndsItsEpisodeAndTouchesNoOther) {
  const std::vector<Fault> faults{
      {What::position, kNan},      {What::position, kInfinity},     {What::position, 2e6F},         {What::rotation, kNan},
      {What::rotation, kInfinity}, {What::rotation, 3.0F},          {What::reward, kNan},           {What::reward, -kInfinity},
      {What::observation, kNan},   {What::observation, -kNan},      {What::observation, kInfinity}, {What::observation, kNan, 0},
      {What::reward, kNan, 2, 5},  {What::observation, kNan, 2, 5},
  };
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    for (const Fault& fault : faults) {
      SCOPED_TRACE(std::to_string(static_cast<int>(fault.what)) + ' ' + std::to_string(fault.value) + " mode " +
                   std::to_string(static_cast<int>(mode)));
      const auto batch = make(fault, mode);
      const auto clean = make({}, mode);
      for (std::int64_t step = 1; step <= 12; ++step) {
        fly(*batch);
        fly(*clean);
        const Outputs& out = batch->outputs();
        for (std::uint32_t env = 0; env < 3; ++env) {
          EXPECT_TRUE(all_declared(out.observation, env));
          EXPECT_TRUE(all_declared(out.final_observation, env));
          EXPECT_TRUE(std::isfinite(out.reward[env]) && std::isfinite(out.episode_return[env]));
          if (env != fault.env || step < fault.step) {
            EXPECT_TRUE(same_drone(*batch, env, *clean, env)) << "env " << env << " step " << step;
          }
        }
        const bool is_due = step == fault.step || (mode == AutoresetMode::disabled && step > fault.step);
        EXPECT_EQ(out.bad_state[fault.env], is_due);
        EXPECT_EQ(batch->episodes().bad_states[fault.env], step >= fault.step);
        if (step == fault.step) {
          EXPECT_TRUE(out.terminated[fault.env]);
          EXPECT_FALSE(out.truncated[fault.env]);
          EXPECT_FALSE(out.success[fault.env]);
          EXPECT_FALSE(out.crashed[fault.env]);
          EXPECT_EQ(out.episode_length[fault.env], fault.step);
          EXPECT_EQ(out.reward[fault.env], fault.what == What::reward ? 1.0F : 1.5F);
          const auto& last = mode == AutoresetMode::same_step ? out.final_observation : out.observation;
          EXPECT_EQ(last[0].row<float>(fault.env)[1], fault.what == What::observation ? 0.0F : 1.0F);
          const bool stayed = fault.what == What::position || fault.what == What::rotation;
          EXPECT_NEAR(last[0].row<float>(fault.env)[0], 1.0F + 0.001F * static_cast<float>(step - stayed), 1e-5F);
        }
      }
      EXPECT_EQ(batch->state().episode[fault.env] > 0, mode != AutoresetMode::disabled) << "it was reset";
      EXPECT_EQ(clean->episodes().bad_states, std::vector<std::int64_t>(3, 0));
    }
  }
}

TEST(BadStates, OneAtTheBeginningOfAnEpisodeEndsItInItsFirstStep) {
  for (const What what : {What::first_observation, What::place}) {
    for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step}) {
      SCOPED_TRACE(std::to_string(static_cast<int>(what)) + " mode " + std::to_string(static_cast<int>(mode)));
      const auto batch = make({what, kNan, 1}, mode);
      bool seen = false;
      for (int step = 0; step < 22; ++step) {
        const bool first = batch->state().episode[1] == 1 && batch->episodes().steps[1] == 0;
        fly(*batch);
        const Outputs& out = batch->outputs();
        for (std::uint32_t env = 0; env < 3; ++env) EXPECT_TRUE(all_declared(out.observation, env));
        EXPECT_EQ(out.bad_state[1], first && !seen);
        if (first && !seen) {
          EXPECT_EQ(out.episode_length[1], 1);
        }
        seen = seen || first;
        EXPECT_FALSE(out.bad_state[0] || out.bad_state[2]);
      }
      EXPECT_TRUE(seen);
      EXPECT_EQ(batch->episodes().bad_states, (std::vector<std::int64_t>{0, 1, 0}));
      EXPECT_GT(batch->state().episode[1], batch->state().episode[0]);
    }
  }
}

TEST(BadStates, ASnapshotHoldsThem) {
  const auto batch = make({What::first_observation, kNan, 1}, AutoresetMode::same_step);
  for (int step = 0; step < 5; ++step) fly(*batch);  // env 1 is now in its second episode, which began with a fault
  const std::string blob = batch->snapshot();
  fly(*batch);
  EXPECT_TRUE(batch->outputs().bad_state[1]);
  const auto other = make({}, AutoresetMode::same_step);
  other->restore(blob);
  fly(*other);
  EXPECT_TRUE(other->outputs().bad_state[1]);
  EXPECT_EQ(other->episodes().bad_states, batch->episodes().bad_states);
}

TEST(BadStates, AFrameSkipEndsThere) {
  BatchConfig config{.num_envs = 3, .num_threads = 1};
  config.episode.frame_skip = 4;
  config.episode.max_episode_steps = 100;
  Batch batch(config, {closet()}, std::make_unique<Drift>(Fault{What::reward, kNan, 1, 2}));
  batch.reset(std::vector<std::uint64_t>{0, 1, 2});
  fly(batch);
  EXPECT_EQ(batch.outputs().bad_state, (FlagArray{0, 1, 0}));
  EXPECT_EQ(batch.outputs().reward, (AlignedVector<float>{6.0F, 2.5F, 6.0F}));
  EXPECT_EQ(batch.outputs().episode_length, (AlignedVector<std::int64_t>{4, 2, 4}));
}

}  // namespace
}  // namespace flockstep
