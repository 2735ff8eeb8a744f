#include "flockstep/learner.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/finite.hpp"
#include "base/flush_denormals.hpp"
#include "base/interrupt.hpp"
#include "base/philox.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "base/workers.hpp"
#include "flockstep/batch.hpp"
#include "learning/distribution.hpp"
#include "learning/features.hpp"
#include "learning/network.hpp"
#include "learning/pass.hpp"
#include "learning/rollout.hpp"
#include "learning/running_moments.hpp"
#include "learning/single_caller.hpp"

namespace flockstep {
namespace {

using namespace learning;

constexpr float kClip = 10.0F;           // of normalised observations and rewards
constexpr double kLeastVariance = 1e-8;  // added to variances
constexpr std::size_t kChunk = 256;      // steps whose gradient is summed before that of other chunks is added
constexpr std::size_t kMostChunks = 64;
constexpr std::uint32_t kOrderStream = 0x6F726465U;
constexpr std::int64_t kMostParameters = 1 << 24;  // of actor and critic together
constexpr std::int64_t kMostSteps = 1 << 28;       // of a rollout, all rows together

// Means over the steps of a minibatch, as sums of its chunks.
struct Sums {
  double policy = 0.0, value = 0.0, entropy = 0.0, clipped = 0.0, kl = 0.0;

  Sums& operator+=(const Sums& other) {
    policy += other.policy;
    value += other.value;
    entropy += other.entropy;
    clipped += other.clipped;
    kl += other.kl;
    return *this;
  }
};

std::size_t rows_of(std::span<const float> values, std::size_t size, const char* name) {
  require(values.size() % size == 0, name, "rows of " + std::to_string(size) + " numbers",
          std::to_string(values.size()) + " numbers");
  return values.size() / size;
}

void require_size(std::size_t got, std::size_t expected, const char* name) {
  require(got == expected, name, std::to_string(expected) + " numbers", got);
}

std::int64_t count_parameters(std::int64_t in, const std::vector<int>& hidden, std::int64_t out) {
  std::int64_t count = 0;
  for (const int size : hidden) {
    count += (in + 1) * size;
    in = size;
  }
  return count + (in + 1) * out;
}

// Throws NotFiniteError that names the row, of `size` values each, with the first value that is NaN or infinite. The first row
// has the given number.
void require_finite(std::span<const float> values, std::size_t size, const char* name, std::size_t first_row = 0) {
  if (are_finite(values)) return;
  const auto is_bad = [](float value) { return !std::isfinite(value); };
  const auto bad = std::find_if(values.begin(), values.end(), is_bad);
  const std::size_t row = first_row + static_cast<std::size_t>(bad - values.begin()) / size;
  throw NotFiniteError(std::string(name) + ": expected finite numbers, got " + std::to_string(*bad) + " in row " +
                       std::to_string(row));
}

}  // namespace

void NetworkConfig::validate() const {
  check_fields(*this, "");
  const int least = features == Features::goal || features == Features::point ? 3 : features == Features::blob ? 2 : 1;
  require(observation_size >= least, "observation_size", "at least " + std::to_string(least) + " with these features",
          observation_size);
  const std::int64_t in = input_size();
  const std::int64_t count = count_parameters(in, actor_layers, action_size) + count_parameters(in, critic_layers, 1);
  require(count <= kMostParameters, "actor_layers, critic_layers", "at most " + std::to_string(kMostParameters) + " parameters",
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

struct Learner::Parts {
  Parts(NetworkConfig new_config, int num_threads, std::uint64_t new_seed)
      : config((new_config.validate(), std::move(new_config))),
        observation_size(static_cast<std::size_t>(config.observation_size)),
        input_stride(padded(static_cast<std::size_t>(config.input_size()))),
        network(config),
        distribution(config),
        seed(new_seed),
        parameters(network.num_padded),
        first(network.num_padded),
        second(network.num_padded),
        transposed(network.num_transposed),
        observation_moments(initial_moments(observation_size)),
        return_moments(initial_moments(1)),
        workers(num_threads > 0 ? num_threads : physical_cores()) {
    for (int i = 0; i < workers.num_threads(); ++i) passes.emplace_back(network);
    network.initialise(seed, parameters);
    prepare();
  }

  // Returns *this. Throws if another thread is in a call.
  const Parts& idle() const {
    const SingleCaller::Call call(callers);
    return *this;
  }

  std::size_t size() const { return rollout.steps * rollout.rows; }
  std::size_t action_size() const { return distribution.action_size(); }

  // Call it after the parameters have changed.
  void prepare() {
    network.transpose_all(parameters, transposed);
    distribution.set(parameters.data() + network.log_std);
  }

  // Writes the inputs of a network for one observation.
  void write_inputs(const float* observation, std::vector<float>& normalised, float* inputs) const {
    if (rollout.config.normalize_observations) {
      normalised.resize(observation_size);
      for (std::size_t i = 0; i < observation_size; ++i) {
        const double value = (static_cast<double>(observation[i]) - observation_moments.mean[i]) /
                             std::sqrt(observation_moments.variance[i] + kLeastVariance);
        normalised[i] = std::clamp(static_cast<float>(value), -kClip, kClip);
      }
      observation = normalised.data();
    }
    learning::write_inputs(config.features, observation, observation_size, inputs);
  }

  // Calls f(pass, first row, rows) for all rows, a few at a time, on all threads; the inputs of the pass are those of the rows.
  template <class F>
  void for_observations(const float* observations, std::size_t rows, const F& f) {
    workers.run((rows + Pass::kRows - 1) / Pass::kRows, [&](std::size_t part, std::size_t thread) {
      Pass& pass = passes[thread];
      std::vector<float> normalised;
      const std::size_t from = part * Pass::kRows, count = std::min(Pass::kRows, rows - from);
      for (std::size_t i = 0; i < count; ++i) {
        write_inputs(observations + (from + i) * observation_size, normalised, pass.inputs() + i * input_stride);
      }
      f(pass, from, count);
    });
  }

  void write_values(const float* observations, std::size_t rows, float* values) {
    for_observations(observations, rows, [&](Pass& pass, std::size_t from, std::size_t count) {
      const float* const outputs = pass.judge(parameters.data(), transposed.data(), count);
      for (std::size_t i = 0; i < count; ++i) values[from + i] = outputs[i * kPad];
    });
  }

  // Draws the minibatches of an epoch: all steps that count, in random order.
  void draw_order() {
    order.clear();
    for (std::size_t i = 0; i < size(); ++i) {
      if (rollout.skipped[i] == 0) order.push_back(static_cast<std::int64_t>(i));
    }
    ++draws;
    std::array<std::uint32_t, 4> bits{};
    for (std::size_t i = order.size(); i > 1; --i) {
      const std::size_t k = (order.size() - i) % 4;
      if (k == 0) {
        bits = philox4x32({static_cast<std::uint32_t>(i), kOrderStream, static_cast<std::uint32_t>(draws),
                           static_cast<std::uint32_t>(draws >> 32U)},
                          {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U)});
      }
      std::swap(order[i - 1], order[static_cast<std::size_t>((std::uint64_t{bits[k]} * i) >> 32U)]);
    }
  }

  // Draws the actions of rows of step t, whose inputs are those of the pass, and keeps what the update needs.
  void draw_actions(Pass& pass, std::size_t t, std::size_t from, std::size_t count);
  // Throws if fly() cannot step the batch.
  void require_fits(const Batch& batch) const;
  class StepPilot;

  // Fills gradients[0] with the gradient of a minibatch.
  Sums add_gradients(const UpdateConfig& update, std::span<const std::int64_t> minibatch);
  Sums add_chunk(const UpdateConfig& update, std::span<const std::int64_t> chunk, std::size_t of, Pass& pass,
                 AlignedVector<float>& gradient);

  const NetworkConfig config;
  const std::size_t observation_size, input_stride;
  const Network network;
  Distribution distribution;
  const std::uint64_t seed;
  AlignedVector<float> parameters, first, second, transposed;
  std::int64_t adam_steps = 0;
  std::uint64_t draws = 0;
  RunningMoments observation_moments, return_moments;
  std::vector<double> discounted;  // (R,) return so far of each row, for normalised rewards

  Rollout rollout;
  int next = 0;  // step that act() or record() takes next
  std::vector<std::int64_t> order;
  std::vector<AlignedVector<float>> gradients;         // of the chunks
  double advantage_mean = 0.0, advantage_scale = 1.0;  // of the minibatch
  Workers workers;
  std::vector<Pass> passes;      // one per thread
  mutable SingleCaller callers;  // of the learner
};

Sums Learner::Parts::add_chunk(const UpdateConfig& update, std::span<const std::int64_t> chunk, std::size_t of, Pass& pass,
                               AlignedVector<float>& gradient) {
  Sums sums;
  std::vector<float> work(distribution.outputs());
  const auto mean = static_cast<float>(advantage_mean), scale = static_cast<float>(advantage_scale);
  const auto clip = static_cast<float>(update.clip_range), share = 1.0F / static_cast<float>(of);
  const auto value_slope = static_cast<float>(2.0 * update.vf_coef) * share;
  const auto entropy_slope = -static_cast<float>(update.ent_coef) * share;
  const std::size_t output_stride = padded(distribution.outputs());
  float* const by_log_std = gradient.data() + network.log_std;
  for (std::size_t from = 0; from < chunk.size(); from += Pass::kRows) {
    const auto steps = chunk.subspan(from, std::min(Pass::kRows, chunk.size() - from));
    for (std::size_t i = 0; i < steps.size(); ++i) {
      std::copy_n(rollout.inputs.data() + static_cast<std::size_t>(steps[i]) * input_stride, input_stride,
                  pass.inputs() + i * input_stride);
    }
    const float* const outputs = pass.act(parameters.data(), transposed.data(), steps.size());
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const auto step = static_cast<std::size_t>(steps[i]);
      const float* const action = rollout.actions.data() + step * action_size();
      const Distribution::Terms terms = distribution.evaluate(outputs + i * output_stride, action, work.data());
      const float log_ratio = terms.log_prob - rollout.log_probs[step], ratio = std::exp(log_ratio);
      const float advantage = (rollout.advantages[step] - mean) * scale;
      const float clipped = std::clamp(ratio, 1.0F - clip, 1.0F + clip);
      const bool is_clipped = clipped * advantage < ratio * advantage;
      sums.policy -= std::min(ratio * advantage, clipped * advantage);
      sums.entropy -= terms.entropy;
      sums.clipped += std::abs(ratio - 1.0F) > clip ? 1.0 : 0.0;
      sums.kl += static_cast<double>(ratio - 1.0F - log_ratio);
      const Distribution::Terms slopes{.log_prob = is_clipped ? 0.0F : -ratio * advantage * share, .entropy = entropy_slope};
      distribution.gradient(action, terms, slopes, work.data(), pass.act_slopes() + i * output_stride, by_log_std);
    }
    pass.act_back(parameters.data(), steps.size(), gradient.data());

    const float* const values = pass.judge(parameters.data(), transposed.data(), steps.size());
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const auto step = static_cast<std::size_t>(steps[i]);
      float value = values[i * kPad];
      bool moves = true;
      if (update.clip_range_vf) {
        const auto most = static_cast<float>(*update.clip_range_vf);
        const float change = value - rollout.values[step];
        moves = std::abs(change) <= most;
        value = rollout.values[step] + std::clamp(change, -most, most);
      }
      const float error = value - rollout.returns[step];
      sums.value += static_cast<double>(error) * static_cast<double>(error);
      pass.judge_slopes()[i * kPad] = moves ? value_slope * error : 0.0F;
    }
    pass.judge_back(parameters.data(), steps.size(), gradient.data());
  }
  return sums;
}

Sums Learner::Parts::add_gradients(const UpdateConfig& update, std::span<const std::int64_t> minibatch) {
  advantage_mean = 0.0;
  advantage_scale = 1.0;
  if (update.normalize_advantage && minibatch.size() > 1) {
    const auto count = static_cast<double>(minibatch.size());
    for (const std::int64_t step : minibatch) advantage_mean += rollout.advantages[static_cast<std::size_t>(step)];
    advantage_mean /= count;
    double squares = 0.0;
    for (const std::int64_t step : minibatch) {
      const double difference = rollout.advantages[static_cast<std::size_t>(step)] - advantage_mean;
      squares += difference * difference;
    }
    advantage_scale = 1.0 / (std::sqrt(squares / (count - 1.0)) + 1e-8);
  }
  // The chunks depend on the size of the minibatch, never on the number of threads.
  const std::size_t least = (minibatch.size() + kMostChunks - 1) / kMostChunks;
  const std::size_t chunk = std::max(kChunk, (least + Pass::kRows - 1) / Pass::kRows * Pass::kRows);
  const std::size_t count = (minibatch.size() + chunk - 1) / chunk;
  while (gradients.size() < count) gradients.emplace_back(network.num_padded);
  std::vector<Sums> sums(count);
  workers.run(count, [&](std::size_t i, std::size_t thread) {
    std::fill(gradients[i].begin(), gradients[i].end(), 0.0F);
    const auto steps = minibatch.subspan(i * chunk, std::min(chunk, minibatch.size() - i * chunk));
    sums[i] = add_chunk(update, steps, minibatch.size(), passes[thread], gradients[i]);
  });
  for (std::size_t i = 1; i < count; ++i) {
    sums[0] += sums[i];
    add(gradients[i].data(), network.num_padded, gradients[0].data());
  }
  distribution.entropy_gradient(-static_cast<float>(update.ent_coef), gradients[0].data() + network.log_std);
  return sums[0];
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
std::vector<float> Learner::first_moments() const { return parts_->network.packed(parts_->idle().first); }
std::vector<float> Learner::second_moments() const { return parts_->network.packed(parts_->idle().second); }
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

void Learner::set_adam(std::span<const float> first, std::span<const float> second, std::int64_t steps) {
  const SingleCaller::Call call(parts_->callers);
  require_size(first.size(), parts_->network.num_parameters, "first");
  require_size(second.size(), parts_->network.num_parameters, "second");
  for (const float value : first) require(std::isfinite(value), "first", "finite numbers", value);
  for (const float value : second) require(std::isfinite(value) && value >= 0.0F, "second", "finite numbers >= 0", value);
  require(steps >= 0, "steps", "an integer >= 0", steps);
  parts_->network.unpack(first, parts_->first);
  parts_->network.unpack(second, parts_->second);
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
  Parts& parts = *parts_;
  const std::size_t rows = rows_of(observation, parts.observation_size, "observation"), size = parts.action_size();
  require_size(action.size(), rows * size, "action");
  require_finite(observation, parts.observation_size, "observation");
  parts.for_observations(observation.data(), rows, [&](Pass& pass, std::size_t from, std::size_t count) {
    const float* const outputs = pass.act(parts.parameters.data(), parts.transposed.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      parts.distribution.mode(outputs + i * padded(parts.distribution.outputs()), action.data() + (from + i) * size);
    }
  });
  require_finite(action, size, "action");
}

void Learner::sample(std::span<const float> observation, std::span<float> action) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  const std::size_t rows = rows_of(observation, parts.observation_size, "observation"), size = parts.action_size();
  require_size(action.size(), rows * size, "action");
  require_finite(observation, parts.observation_size, "observation");
  ++parts.draws;
  parts.for_observations(observation.data(), rows, [&](Pass& pass, std::size_t from, std::size_t count) {
    const float* const outputs = pass.act(parts.parameters.data(), parts.transposed.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      parts.distribution.draw(outputs + i * padded(parts.distribution.outputs()),
                              {parts.seed, parts.draws, static_cast<std::uint32_t>(from + i)}, action.data() + (from + i) * size);
    }
  });
  require_finite(action, size, "action");
}

void Learner::values(std::span<const float> observation, std::span<float> value) const {
  const SingleCaller::Call call(parts_->callers);
  const std::size_t rows = rows_of(observation, parts_->observation_size, "observation");
  require_size(value.size(), rows, "value");
  require_finite(observation, parts_->observation_size, "observation");
  parts_->write_values(observation.data(), rows, value.data());
}

void Learner::begin(const RolloutConfig& config, int rows) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  config.validate();
  require(rows >= 1 && rows <= 1 << 24, "rows", "an integer in [1, 16777216]", rows);
  require(std::int64_t{config.n_steps} * rows <= kMostSteps, "n_steps",
          "at most " + std::to_string(kMostSteps) + " steps of all rows", std::int64_t{config.n_steps} * rows);
  const auto count = static_cast<std::size_t>(rows);
  parts.next = 0;
  parts.rollout.rows = parts.rollout.steps = 0;  // if there is not enough memory, the learner has no rollout
  if (parts.discounted.size() != count) parts.discounted.assign(count, 0.0);
  parts.rollout.resize(config, count, parts.input_stride, parts.action_size());
}

void Learner::Parts::draw_actions(Pass& pass, std::size_t t, std::size_t from, std::size_t count) {
  const std::size_t first = t * rollout.rows + from, size = action_size(), stride = padded(distribution.outputs());
  std::copy_n(pass.inputs(), count * input_stride, rollout.inputs.data() + first * input_stride);
  const float* const outputs = pass.act(parameters.data(), transposed.data(), count);
  std::vector<float> work(distribution.outputs());
  for (std::size_t i = 0; i < count; ++i) {
    float* const action = rollout.actions.data() + (first + i) * size;
    distribution.draw(outputs + i * stride, {seed, draws, static_cast<std::uint32_t>(from + i)}, action);
    rollout.log_probs[first + i] = distribution.evaluate(outputs + i * stride, action, work.data()).log_prob;
  }
  const float* const values = pass.judge(parameters.data(), transposed.data(), count);
  for (std::size_t i = 0; i < count; ++i) rollout.values[first + i] = values[i * kPad];
}

std::span<const float> Learner::act(int t, std::span<const float> observation) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  Rollout& rollout = parts.rollout;
  require(t == parts.next && t < rollout.config.n_steps, "t", "step " + std::to_string(parts.next), t);
  require_size(observation.size(), rollout.rows * parts.observation_size, "observation");
  require_finite(observation, parts.observation_size, "observation");
  if (rollout.config.normalize_observations) take(parts.observation_moments, observation.data(), rollout.rows);
  ++parts.draws;
  const auto step = static_cast<std::size_t>(t);
  parts.for_observations(observation.data(), rollout.rows,
                         [&](Pass& pass, std::size_t from, std::size_t count) { parts.draw_actions(pass, step, from, count); });
  const std::size_t size = rollout.rows * parts.action_size();
  const std::span<const float> actions = std::span(rollout.actions).subspan(step * size, size);
  require_finite(actions, parts.action_size(), "action");
  return actions;
}

namespace {

template <class T>
void append_as_floats(std::span<const T> values, float*& to) {
  for (const T value : values) *to++ = static_cast<float>(value);
}

// Appends a row of a field, as numbers.
void append_row(const Buffer& field, std::size_t row, float*& to) {
  switch (field.type()) {
    case DType::float32:
      to = std::copy_n(field.row<float>(row).data(), field.columns(), to);
      return;
    case DType::float64:
      return append_as_floats(field.row<double>(row), to);
    case DType::int32:
      return append_as_floats(field.row<std::int32_t>(row), to);
    case DType::int64:
      return append_as_floats(field.row<std::int64_t>(row), to);
    case DType::boolean:
    case DType::uint8:
      return append_as_floats(field.row<std::uint8_t>(row), to);
  }
}

// Writes the fields of a row in the given order.
void write_row(const std::vector<Buffer>& observation, const std::vector<std::size_t>& fields, std::size_t row, float* to) {
  for (const std::size_t field : fields) append_row(observation[field], row, to);
}

// Returns the fields in the order of their names, which is that of Gymnasium's dict spaces.
std::vector<std::size_t> by_name(const std::vector<Field>& fields) {
  std::vector<std::size_t> order(fields.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return fields[a].name < fields[b].name; });
  return order;
}

}  // namespace

// Draws the actions of a step within a step of a batch.
class Learner::Parts::StepPilot : public Pilot {
 public:
  StepPilot(Parts& parts, std::size_t t, const TaskSpec& spec, const std::vector<std::size_t>& fields)
      : parts_(parts), t_(t), fields_(fields), low_(spec.action.low), high_(spec.action.high) {}

  void act(const PilotedRows& rows, Buffer& actions) override {
    Pass& pass = parts_.passes[rows.thread];
    std::vector<float> observation(parts_.observation_size), normalised;
    for (std::size_t from = rows.first; from < rows.first + rows.count; from += Pass::kRows) {
      const std::size_t count = std::min(Pass::kRows, rows.first + rows.count - from);
      for (std::size_t i = 0; i < count; ++i) {
        write_row(rows.observation, fields_, from + i, observation.data());
        if (!are_finite(observation)) {
          note_bad(from + i);
          std::fill(observation.begin(), observation.end(), 0.0F);
        }
        parts_.write_inputs(observation.data(), normalised, pass.inputs() + i * parts_.input_stride);
      }
      parts_.draw_actions(pass, t_, from, count);
      for (std::size_t i = 0; i < count; ++i) write_action(from + i, actions);
    }
  }

  // Throws NotFiniteError if an observation was not finite; its row then flew the action for zeros.
  void require_finite_observations() const {
    if (bad_row_ == kNoRow) return;
    throw NotFiniteError("observation: expected finite numbers, got others in row " + std::to_string(bad_row_));
  }

 private:
  static constexpr std::size_t kNoRow = SIZE_MAX;

  // Keeps the lowest row whose observation is not finite.
  void note_bad(std::size_t row) {
    std::size_t known = bad_row_.load();
    while (row < known && !bad_row_.compare_exchange_weak(known, row)) {
    }
  }

  void write_action(std::size_t row, Buffer& actions) const {
    const std::size_t size = parts_.action_size();
    const float* const drawn = parts_.rollout.actions.data() + (t_ * parts_.rollout.rows + row) * size;
    switch (actions.type()) {
      case DType::float32:
        return limit(drawn, actions.row<float>(row));
      case DType::float64:
        return limit(drawn, actions.row<double>(row));
      case DType::int32:
        actions.row<std::int32_t>(row)[0] = static_cast<std::int32_t>(low_[0] + static_cast<double>(*drawn));
        return;
      default:
        actions.row<std::int64_t>(row)[0] = static_cast<std::int64_t>(low_[0] + static_cast<double>(*drawn));
    }
  }

  // Writes an action, limited to the bounds. NaN becomes the lower bound; fly() refuses it after the step.
  template <class T>
  void limit(const float* drawn, std::span<T> action) const {
    for (std::size_t i = 0; i < action.size(); ++i) {
      const T low = static_cast<T>(low_[low_.size() == 1 ? 0 : i]), high = static_cast<T>(high_[high_.size() == 1 ? 0 : i]);
      const T value = static_cast<T>(drawn[i]);
      action[i] = value > low ? std::min(value, high) : low;
    }
  }

  Parts& parts_;
  std::size_t t_;
  std::atomic<std::size_t> bad_row_{kNoRow};
  const std::vector<std::size_t>& fields_;  // of the observation, in the order of their names
  const std::vector<double>&low_, &high_;   // bounds: one for an action, or one for each of its values
};

void Learner::read_observation(const Batch& batch, std::span<float> observation) const {
  const SingleCaller::Call call(parts_->callers);
  parts_->require_fits(batch);
  require_size(observation.size(), parts_->rollout.rows * parts_->observation_size, "observation");
  const std::vector<std::size_t> fields = by_name(batch.task()->spec().observation);
  for (std::size_t row = 0; row < parts_->rollout.rows; ++row) {
    write_row(batch.outputs().observation, fields, row, observation.data() + row * parts_->observation_size);
  }
}

void Learner::fly(int t, Batch& batch, float reward_scale) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  Rollout& rollout = parts.rollout;
  require(t == parts.next && t < rollout.config.n_steps, "t", "step " + std::to_string(parts.next), t);
  parts.require_fits(batch);
  require(std::isfinite(reward_scale), "reward_scale", "a finite number", reward_scale);
  const TaskSpec& spec = batch.task()->spec();
  const std::vector<std::size_t> fields = by_name(spec.observation);
  while (parts.passes.size() < static_cast<std::size_t>(batch.num_threads())) parts.passes.emplace_back(parts.network);
  if (rollout.config.normalize_observations) {
    std::vector<float> observation(rollout.rows * parts.observation_size);
    read_observation(batch, observation);
    require_finite(observation, parts.observation_size, "observation");
    take(parts.observation_moments, observation.data(), rollout.rows);
  }
  // Under next-step autoreset, envs whose episodes are over only reset.
  std::vector<std::uint8_t> skipped;
  if (batch.config().episode.autoreset_mode != AutoresetMode::same_step) {
    const Outputs& before = batch.outputs();
    for (std::size_t row = 0; row < rollout.rows; ++row) skipped.push_back(before.terminated[row] | before.truncated[row]);
  }
  ++parts.draws;
  Parts::StepPilot pilot(parts, static_cast<std::size_t>(t), spec, fields);
  batch.step(pilot);
  pilot.require_finite_observations();
  const std::size_t size = rollout.rows * parts.action_size();
  require_finite(std::span(rollout.actions).subspan(static_cast<std::size_t>(t) * size, size), parts.action_size(), "action");
  const Outputs& after = batch.outputs();
  std::vector<float> reward(after.reward.begin(), after.reward.end());
  for (float& value : reward) value *= reward_scale;
  const auto is_cut = [&](std::size_t row) { return after.truncated[row] != 0 && after.terminated[row] == 0; };
  std::vector<float> final_observation;
  for (std::size_t row = 0; row < rollout.rows; ++row) {
    if (!is_cut(row)) continue;
    final_observation.resize(rollout.rows * parts.observation_size);
    write_row(after.final_observation, fields, row, final_observation.data() + row * parts.observation_size);
  }
  record(t, {.reward = reward,
             .terminated = after.terminated,
             .truncated = after.truncated,
             .final_observation = final_observation,
             .skipped = skipped});
}

void Learner::Parts::require_fits(const Batch& batch) const {
  require(batch.task() != nullptr, "batch", "a batch with a task", "one without");
  const TaskSpec& spec = batch.task()->spec();
  const Outputs& outputs = batch.outputs();
  require(outputs.reward.size() == rollout.rows, "batch", std::to_string(rollout.rows) + " rows", outputs.reward.size());
  std::size_t size = 0;
  for (const Field& field : spec.observation) size += field.size();
  require(size == observation_size, "batch", "observations of " + std::to_string(observation_size) + " numbers", size);
  const bool is_discrete = !is_floating(spec.action.type);
  require(is_discrete == config.is_discrete, "batch", config.is_discrete ? "discrete actions" : "actions of numbers",
          is_discrete ? "discrete actions" : "actions of numbers");
  const auto actions =
      is_discrete ? static_cast<std::size_t>(spec.action.high.at(0) - spec.action.low.at(0)) + 1 : spec.action.size();
  require(actions == distribution.outputs(), "batch", "actions of size " + std::to_string(distribution.outputs()), actions);
}

void Learner::record(int t, const StepResults& results) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  Rollout& rollout = parts.rollout;
  const std::size_t rows = rollout.rows, size = parts.observation_size;
  require(t == parts.next && t < rollout.config.n_steps, "t", "step " + std::to_string(parts.next), t);
  require_size(results.reward.size(), rows, "reward");
  require_size(results.terminated.size(), rows, "terminated");
  require_size(results.truncated.size(), rows, "truncated");
  require(results.final_observation.empty() || results.final_observation.size() == rows * size, "final_observation",
          std::to_string(rows * size) + " numbers", results.final_observation.size());
  require(results.skipped.empty() || results.skipped.size() == rows, "skipped", std::to_string(rows) + " flags",
          results.skipped.size());
  require_finite(results.reward, 1, "reward");
  const auto is_skipped = [&](std::size_t r) { return !results.skipped.empty() && results.skipped[r] != 0; };
  const auto is_cut = [&](std::size_t r) { return results.truncated[r] != 0 && results.terminated[r] == 0 && !is_skipped(r); };
  for (std::size_t r = 0; r < rows; ++r) {
    if (!is_cut(r)) continue;
    require(!results.final_observation.empty(), "final_observation", "the observations of truncated episodes", "none");
    require_finite(results.final_observation.subspan(r * size, size), size, "final_observation", r);
  }
  const std::size_t first = static_cast<std::size_t>(t) * rows;
  std::copy(results.reward.begin(), results.reward.end(), rollout.rewards.begin() + static_cast<std::ptrdiff_t>(first));
  if (rollout.config.normalize_rewards) {
    std::vector<double> discounted;  // of the rows that count
    for (std::size_t r = 0; r < rows; ++r) {
      if (is_skipped(r)) continue;
      parts.discounted[r] = parts.discounted[r] * rollout.config.gamma + static_cast<double>(results.reward[r]);
      discounted.push_back(parts.discounted[r]);
    }
    take(parts.return_moments, discounted.data(), discounted.size());
    const double scale = 1.0 / std::sqrt(parts.return_moments.variance[0] + kLeastVariance);
    for (std::size_t r = 0; r < rows; ++r) {
      rollout.rewards[first + r] = std::clamp(static_cast<float>(results.reward[r] * scale), -kClip, kClip);
    }
  }
  std::vector<std::size_t> cut;  // rows that were only truncated
  for (std::size_t r = 0; r < rows; ++r) {
    const bool is_done = results.terminated[r] != 0 || results.truncated[r] != 0;
    rollout.done[first + r] = is_done ? 1 : 0;
    rollout.skipped[first + r] = is_skipped(r) ? 1 : 0;
    if (is_done && !is_skipped(r)) parts.discounted[r] = 0.0;
    if (is_cut(r)) cut.push_back(r);
  }
  if (!cut.empty()) {
    std::vector<float> observations(cut.size() * size), values(cut.size());
    for (std::size_t i = 0; i < cut.size(); ++i) {
      std::copy_n(results.final_observation.data() + cut[i] * size, size, observations.data() + i * size);
    }
    parts.write_values(observations.data(), cut.size(), values.data());
    const auto gamma = static_cast<float>(rollout.config.gamma);
    for (std::size_t i = 0; i < cut.size(); ++i) rollout.rewards[first + cut[i]] += gamma * values[i];
  }
  ++parts.next;
}

void Learner::finish(std::span<const float> observation) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  require(parts.next == parts.rollout.config.n_steps && parts.rollout.rows > 0, "finish",
          "a rollout of " + std::to_string(parts.rollout.config.n_steps) + " steps", parts.next);
  require_size(observation.size(), parts.rollout.rows * parts.observation_size, "observation");
  require_finite(observation, parts.observation_size, "observation");
  std::vector<float> values(parts.rollout.rows);
  parts.write_values(observation.data(), parts.rollout.rows, values.data());
  parts.rollout.estimate_advantages(values.data());
}

UpdateReport Learner::update(const UpdateConfig& config, std::span<const std::int64_t> order) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  config.validate();
  const std::size_t steps = parts.size();
  require(steps > 0 && parts.next == parts.rollout.config.n_steps, "update", "a finished rollout", parts.next);
  const auto epochs = static_cast<std::size_t>(config.n_epochs);
  require(order.size() % epochs == 0, "order", "the same number of steps for each epoch", order.size());
  for (const std::int64_t step : order) {
    require(step >= 0 && static_cast<std::size_t>(step) < steps, "order", "indices in [0, " + std::to_string(steps) + ")", step);
  }
  const FlushDenormals flush;
  UpdateReport report{.explained_variance = parts.rollout.explained_variance(), .is_finite = true};
  double minibatches = 0.0;
  for (std::size_t epoch = 0; epoch < epochs; ++epoch) {
    ++report.epochs;
    std::span<const std::int64_t> steps_of_epoch = order.subspan(epoch * (order.size() / epochs), order.size() / epochs);
    if (order.empty()) {
      parts.draw_order();
      steps_of_epoch = parts.order;
    }
    double kl = 0.0, kl_minibatches = 0.0;
    for (std::size_t from = 0; from < steps_of_epoch.size(); from += static_cast<std::size_t>(config.batch_size)) {
      Interrupt::poll();
      const auto minibatch =
          steps_of_epoch.subspan(from, std::min(static_cast<std::size_t>(config.batch_size), steps_of_epoch.size() - from));
      const Sums sums = parts.add_gradients(config, minibatch);
      const auto count = static_cast<double>(minibatch.size());
      AlignedVector<float>& gradient = parts.gradients[0];
      double squares = 0.0;
      for (const float value : gradient) squares += static_cast<double>(value) * static_cast<double>(value);
      minibatches += 1.0;
      kl_minibatches += 1.0;
      kl += sums.kl / count;
      report.policy_gradient_loss += sums.policy / count;
      report.value_loss += sums.value / count;
      report.entropy_loss += sums.entropy / count;
      report.clip_fraction += sums.clipped / count;
      report.loss = (sums.policy + config.ent_coef * sums.entropy + config.vf_coef * sums.value) / count;
      report.is_finite = std::isfinite(report.loss) && std::isfinite(squares);
      if (!report.is_finite) break;
      if (config.target_kl && sums.kl / count > 1.5 * *config.target_kl) {
        report.stopped_early = true;
        break;
      }
      const double norm = std::sqrt(squares), time = static_cast<double>(++parts.adam_steps);
      const AdamStep step{.step_size = static_cast<float>(config.learning_rate / (1.0 - std::pow(0.9, time))),
                          .root_of_bias_2 = static_cast<float>(std::sqrt(1.0 - std::pow(0.999, time))),
                          .scale = static_cast<float>(std::min(1.0, config.max_grad_norm / (norm + 1e-6)))};
      adam(step, gradient.data(), gradient.size(), parts.parameters.data(), parts.first.data(), parts.second.data());
      parts.prepare();
    }
    report.approx_kl = kl / std::max(kl_minibatches, 1.0);
    if (!report.is_finite || report.stopped_early) break;
  }
  for (double* const sum : {&report.policy_gradient_loss, &report.value_loss, &report.entropy_loss, &report.clip_fraction}) {
    *sum /= std::max(minibatches, 1.0);
  }
  report.std = parts.distribution.mean_std();
  return report;
}

std::vector<float> Learner::gradient(const UpdateConfig& config, std::span<const std::int64_t> minibatch) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  config.validate();
  require(!minibatch.empty(), "minibatch", "at least one step", 0);
  for (const std::int64_t step : minibatch) {
    require(step >= 0 && static_cast<std::size_t>(step) < parts.size(), "minibatch",
            "indices in [0, " + std::to_string(parts.size()) + ")", step);
  }
  parts.add_gradients(config, minibatch);
  return parts.network.packed(parts.gradients[0]);
}

}  // namespace flockstep
