#include "learning/distribution.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/random.hpp"

namespace flockstep::learning {
namespace {

const double kHalfLogTwoPi = 0.5 * std::log(2.0 * std::numbers::pi);
constexpr std::uint32_t kStream = 0x61637473U;  // distinguishes actions from other draws with the same key

std::array<std::uint32_t, 4> words(const Distribution::Draw& draw, std::uint32_t index) {
  return philox4x32(
      {draw.row, index ^ kStream, static_cast<std::uint32_t>(draw.number), static_cast<std::uint32_t>(draw.number >> 32U)},
      {static_cast<std::uint32_t>(draw.seed), static_cast<std::uint32_t>(draw.seed >> 32U)});
}

}  // namespace

void Distribution::set(const float* log_std) {
  if (is_discrete_) return;
  std_.resize(size_);
  inverse_std_.resize(size_);
  double sum = 0.0;
  for (std::size_t j = 0; j < size_; ++j) {
    std_[j] = std::exp(log_std[j]);
    inverse_std_[j] = 1.0F / std_[j];
    sum += log_std[j];
  }
  log_normaliser_ = static_cast<float>(sum + static_cast<double>(size_) * kHalfLogTwoPi);
  entropy_ = static_cast<float>(sum + static_cast<double>(size_) * (0.5 + kHalfLogTwoPi));
}

void Distribution::mode(const float* output, float* action) const {
  if (is_discrete_) {
    *action = static_cast<float>(std::max_element(output, output + size_) - output);
  } else {
    std::copy_n(output, size_, action);
  }
}

void Distribution::draw(const float* output, const Draw& draw, float* action) const {
  if (!is_discrete_) {
    for (std::size_t j = 0; j < size_; j += 4) {
      const auto bits = words(draw, static_cast<std::uint32_t>(j));
      const auto first = normal_pair(bits), second = normal_pair({bits[2], bits[3], 0, 0});
      const float normal[4] = {first[0], first[1], second[0], second[1]};
      for (std::size_t i = j; i < std::min(j + 4, size_); ++i) action[i] = output[i] + std_[i] * normal[i - j];
    }
    return;
  }
  // The largest of logit + Gumbel noise has the distribution of the softmax.
  *action = 0.0F;
  float best = -INFINITY;
  for (std::size_t j = 0; j < size_; ++j) {
    const double uniform = (words(draw, static_cast<std::uint32_t>(j))[0] + 0.5) * 0x1p-32;
    const auto value = static_cast<float>(output[j] - std::log(-std::log(uniform)));
    if (value > best) {
      best = value;
      *action = static_cast<float>(j);
    }
  }
}

Distribution::Terms Distribution::evaluate(const float* output, const float* action, float* work) const {
  if (!is_discrete_) {
    float sum = 0.0F;
    for (std::size_t j = 0; j < size_; ++j) {
      work[j] = (action[j] - output[j]) * inverse_std_[j];
      sum += work[j] * work[j];
    }
    return {-0.5F * sum - log_normaliser_, entropy_};
  }
  const float greatest = *std::max_element(output, output + size_);
  float sum = 0.0F;
  for (std::size_t j = 0; j < size_; ++j) sum += std::exp(output[j] - greatest);
  const float log_sum = greatest + std::log(sum);
  float entropy = 0.0F;
  for (std::size_t j = 0; j < size_; ++j) {
    work[j] = output[j] - log_sum;
    entropy -= work[j] * std::exp(work[j]);
  }
  return {work[static_cast<std::size_t>(*action)], entropy};
}

void Distribution::gradient(const float* action, Terms terms, Terms gradients, const float* work, float* by_output,
                            float* by_log_std) const {
  if (!is_discrete_) {
    for (std::size_t j = 0; j < size_; ++j) {
      by_output[j] = gradients.log_prob * work[j] * inverse_std_[j];
      by_log_std[j] += gradients.log_prob * (work[j] * work[j] - 1.0F);
    }
    return;
  }
  for (std::size_t j = 0; j < size_; ++j) {
    const float probability = std::exp(work[j]);
    const float chosen = j == static_cast<std::size_t>(*action) ? 1.0F : 0.0F;
    by_output[j] = gradients.log_prob * (chosen - probability) - gradients.entropy * probability * (work[j] + terms.entropy);
  }
}

void Distribution::entropy_gradient(float gradient, float* by_log_std) const {
  if (is_discrete_) return;
  for (std::size_t j = 0; j < size_; ++j) by_log_std[j] += gradient;
}

double Distribution::mean_std() const {
  double sum = 0.0;
  for (const float value : std_) sum += value;
  return std_.empty() ? 0.0 : sum / static_cast<double>(std_.size());
}

}  // namespace flockstep::learning
