// Learner: proximal policy optimisation for small networks on the processor (J. Schulman, F. Wolski, P. Dhariwal, A. Radford, O.
// Klimov, "Proximal policy optimization algorithms", arXiv:1707.06347). Names, defaults and semantics are those of
// Stable-Baselines3's PPO.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Function after each hidden layer.
enum class Activation : std::uint8_t { tanh, relu };
template <>
struct EnumNames<Activation> {
  static constexpr std::array kNames{"tanh", "relu"};
};

// Fixed function from observations to the inputs of the networks; flockstep.sb3 has the same as features extractors.
enum class Features : std::uint8_t { flat, goal, blob, point };
template <>
struct EnumNames<Features> {
  static constexpr std::array kNames{"flat", "goal", "blob", "point"};
};

// Actor and critic: two networks of fully connected layers. The actor has the same inputs, or only the first ones.
struct NetworkConfig {
  int observation_size = 1;
  int action_size = 1;
  bool is_discrete = false;
  std::vector<int> actor_layers = {64, 64};
  std::vector<int> critic_layers = {64, 64};
  Activation activation = Activation::tanh;
  Features features = Features::flat;
  int critic_only = 0;

  static constexpr auto fields() {
    using C = NetworkConfig;
    return field_list(
        field("observation_size", &C::observation_size, {.about = "Numbers of an observation.", .limits = between(1, 65536)}),
        field("action_size", &C::action_size,
              {.about = "Numbers of an action, or discrete actions to choose from.", .limits = between(1, 4096)}),
        field("is_discrete", &C::is_discrete,
              {.about = "An action is an index with a categorical distribution, not numbers with a Gaussian one."}),
        field("actor_layers", &C::actor_layers, {.about = "Sizes of the actor's hidden layers.", .limits = between(1, 4096)}),
        field("critic_layers", &C::critic_layers, {.about = "Sizes of the critic's hidden layers.", .limits = between(1, 4096)}),
        field("activation", &C::activation, {.about = "Function after each hidden layer."}),
        field("features", &C::features,
              {.about = "Function from observations to inputs: ``\"flat\"`` for the observation itself, ``\"goal\"``, "
                        "``\"blob\"`` and ``\"point\"`` as `flockstep.sb3.GoalFeatures` and so on."}),
        field("critic_only", &C::critic_only,
              {.about = "Numbers at the end of an observation that only the critic gets, as they are, past the features. The "
                        "policy acts without them.",
               .limits = between(0, 4096)}));
  }

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API int input_size() const;  // inputs of the critic; the actor has critic_only fewer
};

// One update from a rollout.
struct UpdateConfig {
  double learning_rate = 3e-4;
  int batch_size = 64;
  int n_epochs = 10;
  double clip_range = 0.2;
  std::optional<double> clip_range_vf;
  bool normalize_advantage = true;
  double ent_coef = 0.0;
  double vf_coef = 0.5;
  double max_grad_norm = 0.5;
  std::optional<double> target_kl;

  static constexpr auto fields() {
    using C = UpdateConfig;
    return field_list(
        field("learning_rate", &C::learning_rate, {.about = "Step size of Adam.", .limits = at_least(0)}),
        field("batch_size", &C::batch_size,
              {.about = "Steps in a minibatch. A rollout has n_steps of each agent.", .limits = between(1, 1 << 30)}),
        field("n_epochs", &C::n_epochs, {.about = "Passes over the rollout.", .limits = between(1, 10'000)}),
        field("clip_range", &C::clip_range,
              {.about = "The ratio of probabilities is clipped to [1 - clip_range, 1 + clip_range].", .limits = at_least(0)}),
        field("clip_range_vf", &C::clip_range_vf,
              {.about = "Largest change of the value by an update, in the unit of the returns. None: not clipped.",
               .limits = at_least(0)}),
        field("normalize_advantage", &C::normalize_advantage,
              {.about = "Shift and scale the advantages of each minibatch to mean 0 and standard deviation 1."}),
        field("ent_coef", &C::ent_coef, {.about = "Weight of the entropy bonus."}),
        field("vf_coef", &C::vf_coef, {.about = "Weight of the squared error of the value."}),
        field("max_grad_norm", &C::max_grad_norm, {.about = "Greatest norm of the gradient.", .limits = above(0)}),
        field("target_kl", &C::target_kl,
              {.about = "An update stops when a minibatch's approximate KL divergence exceeds 1.5 times this. None: never.",
               .limits = above(0)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Means over the minibatches of an update, as Stable-Baselines3 logs them.
struct UpdateReport {
  double policy_gradient_loss = 0.0;
  double value_loss = 0.0;
  double entropy_loss = 0.0;
  double clip_fraction = 0.0;
  double approx_kl = 0.0;
  double loss = 0.0;
  double explained_variance = 0.0;
  double std = 0.0;
  int epochs = 0;
  bool stopped_early = false;
  bool is_finite = true;

  // flockstep.PPO logs each number of type double by its name.
  static constexpr auto fields() {
    using C = UpdateReport;
    return field_list(
        field("policy_gradient_loss", &C::policy_gradient_loss, {.about = "Clipped surrogate, negative."}),
        field("value_loss", &C::value_loss, {.about = "Mean squared error of the value."}),
        field("entropy_loss", &C::entropy_loss, {.about = "Negative entropy."}),
        field("clip_fraction", &C::clip_fraction, {.about = "Share of the steps whose ratio was clipped."}),
        field("approx_kl", &C::approx_kl, {.about = "Approximate KL divergence, over the last epoch."}),
        field("loss", &C::loss, {.about = "Loss of the last minibatch."}),
        field("explained_variance", &C::explained_variance,
              {.about = "Share of the variance of the returns that the values of the rollout explain."}),
        field("std", &C::std, {.about = "Mean standard deviation of the actions, after the update, 0 for discrete actions."}),
        field("epochs", &C::epochs, {.about = "Number of epochs begun."}),
        field("stopped_early", &C::stopped_early, {.about = "True if ``target_kl`` ended the update."}),
        field("is_finite", &C::is_finite,
              {.about = "False if the update stopped before a minibatch whose loss or gradient was not finite."}));
  }
};

// One update by the derivatives of the flight itself, along a window of steps.
struct GradientConfig {
  int horizon = 32;
  double learning_rate = 1e-2;
  double gamma = 0.99;
  double max_grad_norm = 1.0;
  int ticks = 1;

  static constexpr auto fields() {
    using C = GradientConfig;
    return field_list(
        field("horizon", &C::horizon,
              {.about = "Steps of each row between two updates, through which the loss is differentiated.",
               .limits = between(1, 10'000)}),
        field("learning_rate", &C::learning_rate, {.about = "Step size of Adam.", .limits = at_least(0)}),
        field("gamma", &C::gamma, {.about = "Discount factor of the loss per step of a window.", .limits = between(0, 1)}),
        field("max_grad_norm", &C::max_grad_norm, {.about = "Greatest norm of the gradient.", .limits = above(0)}),
        field("ticks", &C::ticks,
              {.about = "Ticks per step of the equations that are differentiated. The flight itself has more and shorter ones.",
               .limits = between(1, 1000)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Results of such an update.
struct GradientReport {
  double loss = 0.0;
  double gradient_norm = 0.0;
  std::int64_t episodes = 0;
  std::int64_t successes = 0;
  bool is_finite = true;

  // flockstep.APG logs each number of type double by its name.
  static constexpr auto fields() {
    using C = GradientReport;
    return field_list(
        field("loss", &C::loss, {.about = "Mean loss of a step."}),
        field("gradient_norm", &C::gradient_norm, {.about = "Norm of the gradient before it was limited."}),
        field("episodes", &C::episodes, {.about = "Episodes that ended in the window."}),
        field("successes", &C::successes, {.about = "Successful ones."}),
        field("is_finite", &C::is_finite, {.about = "False if the gradient was not finite: the parameters are then as before."}));
  }
};

// Name, shape and place of a weight or bias among the parameters. Names are those of Stable-Baselines3's policies.
struct ParameterInfo {
  std::string name;        // such as "action_net.weight"
  std::vector<int> shape;  // (out, in) or (out)
  std::size_t first;       // index of its first number
};

// The steps that are collected for one update.
struct RolloutConfig {
  int n_steps = 2048;
  double gamma = 0.99;
  double gae_lambda = 0.95;
  bool normalize_observations = false;
  bool normalize_rewards = false;

  static constexpr auto fields() {
    using C = RolloutConfig;
    return field_list(
        field("n_steps", &C::n_steps, {.about = "Steps of each row between two updates.", .limits = between(1, 1 << 24)}),
        field("gamma", &C::gamma, {.about = "Discount factor of rewards per step.", .limits = between(0, 1)}),
        field("gae_lambda", &C::gae_lambda,
              {.about = "Weight of long against short estimates of the advantage.", .limits = between(0, 1)}),
        field("normalize_observations", &C::normalize_observations,
              {.about = "Shift and scale each number of the observations to mean 0 and variance 1, both estimated from all "
                        "observations so far that were flown from, and clip the results to +-10, as `VecNormalize` of "
                        "Stable-Baselines3."}),
        field("normalize_rewards", &C::normalize_rewards,
              {.about = "Divide rewards by the standard deviation of the discounted returns so far and clip the results to "
                        "+-10, as `VecNormalize` of Stable-Baselines3."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Mean and variance of everything that was seen so far, per number.
struct RunningMoments {
  std::vector<double> mean;      // one per number
  std::vector<double> variance;  // one per number
  double count = 1e-4;           // as in Stable-Baselines3, whose variance begins at 1 with this weight
};

// Results of one step of all rows; what Learner::record() learns from.
struct StepResults {
  std::span<const float> reward;               // (R,)
  std::span<const std::uint8_t> terminated;    // (R,) the episode ended in a terminal state
  std::span<const std::uint8_t> truncated;     // (R,) the episode was cut off: the value of its final observation counts
  std::span<const float> final_observation;    // (R, observation_size); read where `truncated` is set and `terminated` is not
  std::span<const std::uint8_t> skipped = {};  // (R,) the step was not flown; nothing is learned from it
};

class Batch;

// Thrown if a reward, an observation or an action is NaN or infinite. The parameters are as before the call, and for a reward or
// an observation so are the running moments.
class FLOCKSTEP_API NotFiniteError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Networks, optimiser and the rollout that the next update learns from. Results have the same bits for any number of threads.
// All methods check sizes and throw std::invalid_argument. They throw std::runtime_error while another thread is in a call, and
// in a child of the process that made the learner.
class FLOCKSTEP_API Learner {
 public:
  // num_threads: 0 for one per physical core. seed: of initial weights, actions and minibatches.
  Learner(NetworkConfig config, int num_threads, std::uint64_t seed);
  ~Learner();
  Learner(const Learner&) = delete;
  Learner& operator=(const Learner&) = delete;

  const NetworkConfig& config() const;  // shape of the networks
  int num_threads() const;              // actual number of threads
  std::uint64_t seed() const;           // as given

  // --- state: everything that the next rollout and update depend on
  const std::vector<ParameterInfo>& parameter_infos() const;  // in the order of the parameters
  std::vector<float> parameters() const;                      // weights, biases and logarithms of standard deviations
  void set_parameters(std::span<const float> values);         // finite numbers in the order of parameters()
  std::vector<float> first_moments() const;                   // Adam's, in the order of the parameters
  std::vector<float> second_moments() const;                  // Adam's
  std::int64_t adam_steps() const;                            // number of minibatches that Adam has taken
  // Sets the moments of Adam and its number of steps.
  void set_adam(std::span<const float> adam_m, std::span<const float> adam_v, std::int64_t steps);
  std::uint64_t draws() const;                        // number of draws so far, which is the state of the random numbers
  void set_draws(std::uint64_t draws);                // sets the state of the random numbers
  const RunningMoments& observation_moments() const;  // moments of all observations that actions were drawn from
  const RunningMoments& return_moments() const;       // moments of all discounted returns
  // Sets both moments.
  void set_moments(RunningMoments observation, RunningMoments returns);
  // Discounted sum of the rewards of each row's episode so far, (R,); kept if the next rollout has as many rows.
  std::span<const double> discounted_returns() const;
  // Sets them. If there is a rollout, values has its number of rows.
  void set_discounted_returns(std::span<const double> values);

  // --- acting; observations (R, observation_size)
  // Writes the most probable actions: (R, action_size) numbers, or (R,) indices. Observations may be without critic_only.
  void predict(std::span<const float> observation, std::span<float> action) const;
  // Draws actions, in the same form, not limited to the bounds of the action.
  void sample(std::span<const float> observation, std::span<float> action);
  void values(std::span<const float> observation, std::span<float> value) const;  // (R,)

  // --- collecting
  void begin(const RolloutConfig& config, int rows);  // begins a rollout of R rows
  const RolloutConfig& rollout_config() const;        // configuration of the current rollout
  int rows() const;                                   // R
  // Draws the actions of step t, not limited to the bounds of the action. Returns (R, action_size) numbers or (R,) indices.
  // skipped: (R,) rows that will not fly in this step, whose observations the moments leave out; empty: all fly.
  std::span<const float> act(int t, std::span<const float> observation, std::span<const std::uint8_t> skipped = {});
  // Keeps the results of step t.
  void record(int t, const StepResults& results);
  // Does both with a batch: draws the actions within a step of it, on its threads, and limits them to the bounds of its task's
  // action. The task has one row per row of the rollout. Rewards are multiplied by reward_scale.
  void fly(int t, Batch& batch, float reward_scale = 1.0F);
  // Writes the observation of a batch as fly() reads it, (R, observation_size): its fields in the order of their names.
  void read_observation(const Batch& batch, std::span<float> observation) const;
  // Computes advantages and returns. observation: after the last step.
  void finish(std::span<const float> observation);
  // Arrays (n_steps, R) of the rollout.
  std::span<const float> advantages() const;
  std::span<const float> returns() const;         // which the values learn
  std::span<const float> rewards() const;         // normalised, with the value of the final observation where truncated
  std::span<const float> rollout_values() const;  // when the actions were drawn
  std::span<const float> log_probs() const;       // log probabilities of the actions when they were drawn
  std::span<const float> actions() const;         // (n_steps, R, action_size) or (n_steps, R)

  // --- learning
  // order: indices t * R + r of the rollout in the order of the minibatches, for each epoch; empty: drawn.
  UpdateReport update(const UpdateConfig& config, std::span<const std::int64_t> order = {});
  // Flies a window of steps with the likeliest actions and learns from the derivatives of the task's loss through the flight. The
  // task is a flight task of the engine that has such a loss.
  GradientReport learn_window(const GradientConfig& config, Batch& batch);
  // Throws std::invalid_argument that names what of a batch has no derivative, as learn_window() does.
  void require_derivatives(const GradientConfig& config, const Batch& batch) const;
  // The gradient of the last window, in the order of the parameters, not limited.
  std::vector<float> window_gradient() const;
  // Returns the gradient of the loss of one minibatch, not limited, in the order of the parameters.
  std::vector<float> gradient(const UpdateConfig& config, std::span<const std::int64_t> minibatch);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace flockstep
