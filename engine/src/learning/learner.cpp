#include "flockstep/learner.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/finite.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "learning/learner_parts.hpp"
#include "learning/network.hpp"

namespace flockstep {

using namespace learning;

namespace {

constexpr std::int64_t kMaxParameters = 1 << 24;  // actor and critic together

std::int64_t count_parameters(std::int64_t in, const std::vector<int>& hidden, std::int64_t out) {
  std::int64_t count = 0;
  for (const int size : hidden) {
    count += (in + 1) * size;
    in = size;
  }
  return count + (in + 1) * out;
}

// Calls choose(outputs of the policy, row, action) for each row of observations.
template <class Parts, class Choose>
void choose_actions(Parts& parts, std::span<const float> observation, std::span<float> action, const Choose& choose) {
  const std::size_t size = parts.action_size();
  const bool is_actors_part = observation.size() == action.size() / size * parts.actor_size;
  const std::size_t width = is_actors_part ? parts.actor_size : parts.observation_size;
  const std::size_t rows = rows_of(observation, width, "observation");
  require_size(action.size(), rows * size, "action");
  require_finite(observation, width, "observation");
  parts.for_observations(observation, rows, [&](auto& pass, std::size_t from, std::size_t count) {
    const float* const outputs = pass.forward_actor(parts.parameters.data(), parts.transposed.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      choose(outputs + i * padded(parts.distribution.outputs()), from + i, action.data() + (from + i) * size);
    }
  });
  require_finite(action, size, "action");
}

}  // namespace

namespace learning {

std::size_t rows_of(std::span<const float> values, std::size_t size, const char* name) {
  require(values.size() % size == 0, name, "rows of " + std::to_string(size) + " numbers",
          std::to_string(values.size()) + " numbers");
  return values.size() / size;
}

void require_size(std::size_t got, std::size_t expected, const char* name) {
  require(got == expected, name, std::to_string(expected) + " numbers", got);
}

void require_finite(std::span<const float> values, std::size_t size, const char* name, std::size_t first_row) {
  if (are_finite(values)) return;
  const auto is_bad = [](float value) { return !std::isfinite(value); };
  const auto bad = std::find_if(values.begin(), values.end(), is_bad);
  const std::size_t row = first_row + static_cast<std::size_t>(bad - values.begin()) / size;
  throw NotFiniteError(std::string(name) + ": expected finite numbers, got " + std::to_string(*bad) + " in row " +
                       std::to_string(row));
}

}  // namespace learning

void NetworkConfig::validate() const {
  check_fields(*this, "");
  const int least = features == Features::goal || features == Features::point ? 3 : features == Features::blob ? 2 : 1;
  require(observation_size >= least, "observation_size", "at least " + std::to_string(least) + " with these features",
          observation_size);
  require(observation_size - critic_only >= least, "critic_only",
          "at most " + std::to_string(observation_size - least) + ", which leaves the actor " + std::to_string(least) + " of " +
              std::to_string(observation_size) + " numbers",
          critic_only);
  const std::int64_t in = input_size();
  const std::int64_t count =
      count_parameters(in - critic_only, actor_layers, action_size) + count_parameters(in, critic_layers, 1);
  require(count <= kMaxParameters, "actor_layers, critic_layers", "at most " + std::to_string(kMaxParameters) + " parameters",
          count);
}

int NetworkConfig::input_size() const {
  return static_cast<int>(learning::input_size(features, static_cast<std::size_t>(observation_size)));
}

void UpdateConfig::validate() const {
  check_fields(*this, "");
  require(batch_size > 1 || !normalize_advantage, "batch_size", "at least 2 with normalize_advantage", batch_size);
}
void RolloutConfig::validate() const { check_fields(*this, ""); }

Learner::Parts::Parts(NetworkConfig new_config, int num_threads, std::uint64_t new_seed)
    : config((new_config.validate(), std::move(new_config))),
      observation_size(static_cast<std::size_t>(config.observation_size)),
      actor_size(observation_size - static_cast<std::size_t>(config.critic_only)),
      input_stride(padded(static_cast<std::size_t>(config.input_size()))),
      network(config),
      distribution(config),
      seed(new_seed),
      parameters(network.num_padded),
      adam_m(network.num_padded),
      adam_v(network.num_padded),
      transposed(network.num_transposed),
      observation_moments(initial_moments(observation_size)),
      return_moments(initial_moments(1)),
      workers(thread_count(num_threads)) {
  for (int i = 0; i < workers.num_threads(); ++i) passes.emplace_back(network);
  network.initialise(seed, parameters);
  prepare();
}

Learner::Parts::~Parts() = default;

void Learner::Parts::prepare() {
  network.transpose_all(parameters, transposed);
  distribution.set(parameters.data() + network.log_std);
}

void Learner::Parts::write_inputs(std::span<const float> observation, std::vector<float>& normalised, float* inputs) const {
  if (rollout.config.normalize_observations) {
    normalised.resize(observation.size());
    for (std::size_t i = 0; i < observation.size(); ++i) {
      const double value = (static_cast<double>(observation[i]) - observation_moments.mean[i]) /
                           std::sqrt(observation_moments.variance[i] + kMinVariance);
      normalised[i] = std::clamp(static_cast<float>(value), -kClip, kClip);
    }
    observation = normalised;
  }
  learning::write_inputs(config.features, observation.data(), actor_size, observation.size(), inputs);
}

void Learner::Parts::write_values(std::span<const float> observations, std::span<float> values) {
  for_observations(observations, values.size(), [&](Pass& pass, std::size_t from, std::size_t count) {
    const float* const outputs = pass.forward_critic(parameters.data(), transposed.data(), count);
    for (std::size_t i = 0; i < count; ++i) values[from + i] = outputs[i * kPad];
  });
}

Learner::Learner(NetworkConfig config, int num_threads, std::uint64_t seed) {
  require(num_threads >= 0 && num_threads <= 4096, "num_threads", "an integer in [0, 4096]", num_threads);
  parts_ = std::make_unique<Parts>(std::move(config), num_threads, seed);
}

Learner::~Learner() = default;

const NetworkConfig& Learner::config() const { return parts_->config; }
int Learner::num_threads() const { return parts_->workers.num_threads(); }
std::uint64_t Learner::seed() const { return parts_->seed; }
const std::vector<ParameterInfo>& Learner::parameter_infos() const { return parts_->network.infos; }
std::vector<float> Learner::parameters() const { return parts_->network.packed(parts_->idle().parameters); }
std::vector<float> Learner::first_moments() const { return parts_->network.packed(parts_->idle().adam_m); }
std::vector<float> Learner::second_moments() const { return parts_->network.packed(parts_->idle().adam_v); }
std::int64_t Learner::adam_steps() const { return parts_->idle().adam_steps; }
std::uint64_t Learner::draws() const { return parts_->idle().draws; }
void Learner::set_draws(std::uint64_t draws) {
  const SingleCaller::Call call(parts_->callers);
  parts_->draws = draws;
}
const RunningMoments& Learner::observation_moments() const { return parts_->idle().observation_moments; }
const RunningMoments& Learner::return_moments() const { return parts_->idle().return_moments; }
std::span<const double> Learner::discounted_returns() const { return parts_->idle().discounted; }
const RolloutConfig& Learner::rollout_config() const { return parts_->idle().rollout.config; }
int Learner::rows() const { return static_cast<int>(parts_->idle().rollout.rows); }
std::span<const float> Learner::advantages() const { return parts_->idle().rollout.advantages; }
std::span<const float> Learner::returns() const { return parts_->idle().rollout.returns; }
std::span<const float> Learner::rewards() const { return parts_->idle().rollout.rewards; }
std::span<const float> Learner::rollout_values() const { return parts_->idle().rollout.values; }
std::span<const float> Learner::log_probs() const { return parts_->idle().rollout.log_probs; }
std::span<const float> Learner::actions() const { return parts_->idle().rollout.actions; }

void Learner::set_parameters(std::span<const float> values) {
  const SingleCaller::Call call(parts_->callers);
  require_size(values.size(), parts_->network.num_parameters, "parameters");
  for (const float value : values) require(std::isfinite(value), "parameters", "finite numbers", value);
  parts_->network.unpack(values, parts_->parameters);
  parts_->prepare();
}

void Learner::set_adam(std::span<const float> adam_m, std::span<const float> adam_v, std::int64_t steps) {
  const SingleCaller::Call call(parts_->callers);
  require_size(adam_m.size(), parts_->network.num_parameters, "adam_m");
  require_size(adam_v.size(), parts_->network.num_parameters, "adam_v");
  for (const float value : adam_m) require(std::isfinite(value), "adam_m", "finite numbers", value);
  for (const float value : adam_v) require(std::isfinite(value) && value >= 0.0F, "adam_v", "finite numbers >= 0", value);
  require(steps >= 0, "steps", "an integer >= 0", steps);
  parts_->network.unpack(adam_m, parts_->adam_m);
  parts_->network.unpack(adam_v, parts_->adam_v);
  parts_->adam_steps = steps;
}

void Learner::set_moments(RunningMoments observation, RunningMoments returns) {
  const SingleCaller::Call call(parts_->callers);
  const auto check = [](const RunningMoments& moments, std::size_t size, const char* name) {
    require_size(moments.mean.size(), size, name);
    require_size(moments.variance.size(), size, name);
    const auto is_finite = [](double value) { return std::isfinite(value); };
    require(std::all_of(moments.mean.begin(), moments.mean.end(), is_finite), name, "finite means", "others");
    require(std::all_of(moments.variance.begin(), moments.variance.end(), [&](double v) { return is_finite(v) && v >= 0.0; }),
            name, "finite variances >= 0", "others");
    require(is_finite(moments.count) && moments.count > 0.0, name, "a finite count > 0", moments.count);
  };
  check(observation, parts_->observation_size, "observation moments");
  check(returns, 1, "return moments");
  parts_->observation_moments = std::move(observation);
  parts_->return_moments = std::move(returns);
}

void Learner::set_discounted_returns(std::span<const double> values) {
  const SingleCaller::Call call(parts_->callers);
  const std::size_t rows = parts_->rollout.rows;
  require(rows == 0 || values.size() == rows, "discounted_returns", std::to_string(rows) + " numbers", values.size());
  for (const double value : values) require(std::isfinite(value), "discounted_returns", "finite numbers", value);
  parts_->discounted.assign(values.begin(), values.end());
}

void Learner::predict(std::span<const float> observation, std::span<float> action) const {
  const SingleCaller::Call call(parts_->callers);
  choose_actions(*parts_, observation, action,
                 [this](const float* outputs, std::size_t, float* to) { parts_->distribution.mode(outputs, to); });
}

void Learner::sample(std::span<const float> observation, std::span<float> action) {
  const SingleCaller::Call call(parts_->callers);
  const std::uint64_t draws = parts_->draws + 1;
  choose_actions(*parts_, observation, action, [&](const float* outputs, std::size_t row, float* to) {
    parts_->distribution.draw(outputs, {parts_->seed, draws, static_cast<std::uint32_t>(row)}, to);
  });
  parts_->draws = draws;
}

void Learner::values(std::span<const float> observation, std::span<float> value) const {
  const SingleCaller::Call call(parts_->callers);
  const std::size_t rows = rows_of(observation, parts_->observation_size, "observation");
  require_size(value.size(), rows, "value");
  require_finite(observation, parts_->observation_size, "observation");
  parts_->write_values(observation, value);
}
}  // namespace flockstep
