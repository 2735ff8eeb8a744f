#include "learning/rollout.hpp"

#include <limits>
#include <vector>

namespace flockstep::learning {
namespace {

template <class Number>
void take_rows(RunningMoments& moments, const Number* values, std::size_t rows) {
  if (rows == 0) return;
  const std::size_t size = moments.mean.size();
  const auto count = static_cast<double>(rows);
  std::vector<double> mean(size, 0.0), squares(size, 0.0);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < size; ++i) mean[i] += static_cast<double>(values[row * size + i]);
  }
  for (double& sum : mean) sum /= count;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < size; ++i) {
      const double difference = static_cast<double>(values[row * size + i]) - mean[i];
      squares[i] += difference * difference;
    }
  }
  const double total = moments.count + count;
  for (std::size_t i = 0; i < size; ++i) {
    const double difference = mean[i] - moments.mean[i];
    const double sum = moments.variance[i] * moments.count + squares[i] + difference * difference * moments.count * count / total;
    moments.mean[i] += difference * count / total;
    moments.variance[i] = sum / total;
  }
  moments.count = total;
}

}  // namespace

RunningMoments initial_moments(std::size_t size) {
  return {.mean = std::vector<double>(size, 0.0), .variance = std::vector<double>(size, 1.0)};
}

void take(RunningMoments& moments, const float* values, std::size_t rows) { take_rows(moments, values, rows); }
void take(RunningMoments& moments, const double* values, std::size_t rows) { take_rows(moments, values, rows); }

void Rollout::resize(const RolloutConfig& new_config, std::size_t new_rows, std::size_t input_stride, std::size_t action_size) {
  const auto new_steps = static_cast<std::size_t>(new_config.n_steps);
  const std::size_t count = new_steps * new_rows;
  inputs.assign(count * input_stride, 0.0F);
  actions.assign(count * action_size, 0.0F);
  for (auto* array : {&log_probs, &values, &rewards, &advantages, &returns}) array->assign(count, 0.0F);
  done.assign(count, 0);
  skipped.assign(count, 0);
  has_skipped = false;
  // Last, so that there is no rollout if memory ran out.
  config = new_config;
  steps = new_steps;
  rows = new_rows;
}

void Rollout::estimate_advantages(const float* last_values) {
  const auto gamma = static_cast<float>(config.gamma), decay = static_cast<float>(config.gamma * config.gae_lambda);
  std::vector<float> advantage(rows, 0.0F);  // one per row, at the step after t
  const float* next_values = last_values;
  for (std::size_t t = steps; t-- > 0;) {
    const std::size_t first = t * rows;
    for (std::size_t r = 0; r < rows; ++r) {
      const std::size_t i = first + r;
      const float goes_on = done[i] != 0 || skipped[i] != 0 ? 0.0F : 1.0F;
      const float error = rewards[i] + gamma * next_values[r] * goes_on - values[i];
      advantage[r] = error + decay * goes_on * advantage[r];
      advantages[i] = advantage[r];
      returns[i] = advantage[r] + values[i];
    }
    next_values = values.data() + first;
  }
}

double Rollout::explained_variance() const {
  double count = 0.0, mean = 0.0, mean_error = 0.0;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    if (skipped[i] != 0) continue;
    count += 1.0;
    mean += returns[i];
    mean_error += returns[i] - values[i];
  }
  mean /= count;
  mean_error /= count;
  double variance = 0.0, left = 0.0;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    if (skipped[i] != 0) continue;
    variance += (returns[i] - mean) * (returns[i] - mean);
    const double error = returns[i] - values[i] - mean_error;
    left += error * error;
  }
  return variance == 0.0 ? std::numeric_limits<double>::quiet_NaN() : 1.0 - left / variance;
}

}  // namespace flockstep::learning
