// A Learner collects a rollout, step by step or within the steps of a batch.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "base/dtype.hpp"
#include "base/finite.hpp"
#include "base/require.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/pilot.hpp"
#include "learning/learner_parts.hpp"
#include "learning/step_pilot.hpp"

namespace flockstep {

using namespace learning;

namespace {

constexpr std::int64_t kMaxSteps = 1 << 28;  // in a rollout, all rows together

}  // namespace

void Learner::begin(const RolloutConfig& config, int rows) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  config.validate();
  require(rows >= 1 && rows <= 1 << 24, "rows", "an integer in [1, 16777216]", rows);
  require(std::int64_t{config.n_steps} * rows <= kMaxSteps, "n_steps",
          "at most " + std::to_string(kMaxSteps) + " steps of all rows", std::int64_t{config.n_steps} * rows);
  const auto count = static_cast<std::size_t>(rows);
  parts.next = 0;
  parts.is_finished = false;
  parts.rollout.rows = parts.rollout.steps = 0;
  if (parts.discounted.size() != count) parts.discounted.assign(count, 0.0);
  parts.rollout.resize(config, count, parts.input_stride, parts.action_size());
}

void Learner::Parts::draw_actions(Pass& pass, std::size_t t, std::size_t from, std::size_t count) {
  const std::size_t first = t * rollout.rows + from, size = action_size(), stride = padded(distribution.outputs());
  std::copy_n(pass.inputs(), count * input_stride, rollout.inputs.data() + first * input_stride);
  const float* const outputs = pass.forward_actor(parameters.data(), transposed.data(), count);
  std::vector<float> work(distribution.outputs());
  for (std::size_t i = 0; i < count; ++i) {
    float* const action = rollout.actions.data() + (first + i) * size;
    distribution.draw(outputs + i * stride, {seed, draws, static_cast<std::uint32_t>(from + i)}, action);
    rollout.log_probs[first + i] = distribution.evaluate(outputs + i * stride, action, work.data()).log_prob;
  }
  const float* const values = pass.forward_critic(parameters.data(), transposed.data(), count);
  for (std::size_t i = 0; i < count; ++i) rollout.values[first + i] = values[i * kPad];
}

void Learner::Parts::take_observations(std::span<const float> observations, std::span<const std::uint8_t> skipped) {
  if (!rollout.config.normalize_observations) return;
  if (skipped.empty()) return take(observation_moments, observations.data(), rollout.rows);
  std::vector<float> flown;
  flown.reserve(observations.size());
  for (std::size_t r = 0; r < rollout.rows; ++r) {
    const std::span<const float> row = observations.subspan(r * observation_size, observation_size);
    if (skipped[r] == 0) flown.insert(flown.end(), row.begin(), row.end());
  }
  take(observation_moments, flown.data(), flown.size() / observation_size);
}

std::span<const float> Learner::act(int t, std::span<const float> observation, std::span<const std::uint8_t> skipped) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  Rollout& rollout = parts.rollout;
  require(t == parts.next && t < rollout.config.n_steps, "t", "step " + std::to_string(parts.next), t);
  require_size(observation.size(), rollout.rows * parts.observation_size, "observation");
  require_finite(observation, parts.observation_size, "observation");
  require(skipped.empty() || skipped.size() == rollout.rows, "skipped", std::to_string(rollout.rows) + " flags", skipped.size());
  parts.take_observations(observation, skipped);
  ++parts.draws;
  const auto step = static_cast<std::size_t>(t);
  parts.for_observations(observation, rollout.rows,
                         [&](Pass& pass, std::size_t from, std::size_t count) { parts.draw_actions(pass, step, from, count); });
  const std::size_t size = rollout.rows * parts.action_size();
  const std::span<const float> actions = std::span(rollout.actions).subspan(step * size, size);
  require_finite(actions, parts.action_size(), "action");
  return actions;
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
    std::vector<double> discounted;  // returns so far, of the rows that count
    for (std::size_t r = 0; r < rows; ++r) {
      if (is_skipped(r)) continue;
      parts.discounted[r] = parts.discounted[r] * rollout.config.gamma + static_cast<double>(results.reward[r]);
      discounted.push_back(parts.discounted[r]);
    }
    take(parts.return_moments, discounted.data(), discounted.size());
    const double scale = 1.0 / std::sqrt(parts.return_moments.variance[0] + kMinVariance);
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
    parts.write_values(observations, values);
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
  parts.write_values(observation, values);
  parts.rollout.estimate_advantages(values.data());
  parts.is_finished = true;
}

void Learner::read_observation(const Batch& batch, std::span<float> observation) const {
  const SingleCaller::Call call(parts_->callers);
  parts_->require_fits(batch, parts_->rollout.rows);
  require_size(observation.size(), parts_->rollout.rows * parts_->observation_size, "observation");
  const std::vector<std::size_t> fields = by_name(batch.spec().observation);
  for (std::size_t row = 0; row < parts_->rollout.rows; ++row) {
    write_row(batch.outputs().observation, fields, row, observation.data() + row * parts_->observation_size);
  }
}

void Learner::fly(int t, Batch& batch, float reward_scale) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  Rollout& rollout = parts.rollout;
  require(t == parts.next && t < rollout.config.n_steps, "t", "step " + std::to_string(parts.next), t);
  parts.require_fits(batch, rollout.rows);
  require(std::isfinite(reward_scale), "reward_scale", "a finite number", reward_scale);
  const TaskSpec& spec = batch.spec();
  const std::vector<std::size_t> fields = by_name(spec.observation);
  parts.make_passes(batch);
  if (rollout.config.normalize_observations) {
    std::vector<float> observation(rollout.rows * parts.observation_size);
    read_observation(batch, observation);
    require_finite(observation, parts.observation_size, "observation");
    parts.take_observations(observation, batch.waiting());
  }
  ++parts.draws;
  const auto step = static_cast<std::size_t>(t);
  Parts::StepPilot pilot(parts, rollout.actions.data() + step * rollout.rows * parts.action_size(), spec, fields,
                         [&](Pass& pass, std::size_t from, std::size_t count) { parts.draw_actions(pass, step, from, count); });
  batch.step(pilot);
  pilot.require_finite_observations();
  const std::size_t size = rollout.rows * parts.action_size();
  require_finite(std::span(rollout.actions).subspan(step * size, size), parts.action_size(), "action");
  const Outputs& after = batch.outputs();
  // Rows that did not fly only begin an episode, or their drones rest.
  std::vector<std::uint8_t> skipped;
  const FlagArray& flying = batch.episodes().flying;
  if (std::ranges::find(flying, 0) != flying.end()) {
    for (const std::uint8_t flew : flying) skipped.push_back(flew == 0 ? 1 : 0);
  }
  std::vector<float> reward(after.reward.begin(), after.reward.end());
  for (float& value : reward) value *= reward_scale;
  const auto is_cut = [&](std::size_t row) {
    return after.truncated[row] != 0 && after.terminated[row] == 0 && flying[row] != 0;
  };
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

void Learner::Parts::make_passes(const Batch& batch) {
  while (passes.size() < static_cast<std::size_t>(batch.num_threads())) passes.emplace_back(network);
}

void Learner::Parts::require_fits(const Batch& batch, std::size_t rows) const {
  require(batch.task() != nullptr, "batch", "a batch with a task", "one without");
  const TaskSpec& spec = batch.spec();
  const Outputs& outputs = batch.outputs();
  require(outputs.reward.size() == rows, "batch", std::to_string(rows) + " rows", outputs.reward.size());
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
}  // namespace flockstep
