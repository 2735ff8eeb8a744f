// A Learner updates its networks from a rollout.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "learning/learner_parts.hpp"

namespace flockstep {

using namespace learning;

namespace {

constexpr std::size_t kChunk = 256;  // steps whose gradient is summed before that of other chunks is added
constexpr std::size_t kMaxChunks = 64;
constexpr std::uint32_t kOrderStream = 0x6F726465U;

}  // namespace

void Learner::Parts::draw_order() {
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

Sums Learner::Parts::add_chunk(const UpdateConfig& update, std::span<const std::int64_t> chunk, std::size_t minibatch_size,
                               Pass& pass, AlignedVector<float>& gradient) {
  Sums sums;
  std::vector<float> work(distribution.outputs());
  const auto mean = static_cast<float>(advantage_mean), scale = static_cast<float>(advantage_scale);
  const auto clip = static_cast<float>(update.clip_range), inverse_size = 1.0F / static_cast<float>(minibatch_size);
  const auto value_scale = static_cast<float>(2.0 * update.vf_coef) * inverse_size;
  const auto entropy_gradient = -static_cast<float>(update.ent_coef) * inverse_size;
  const std::size_t output_stride = padded(distribution.outputs());
  float* const by_log_std = gradient.data() + network.log_std;
  for (std::size_t from = 0; from < chunk.size(); from += Pass::kRows) {
    const auto steps = chunk.subspan(from, std::min(Pass::kRows, chunk.size() - from));
    for (std::size_t i = 0; i < steps.size(); ++i) {
      std::copy_n(rollout.inputs.data() + static_cast<std::size_t>(steps[i]) * input_stride, input_stride,
                  pass.inputs() + i * input_stride);
    }
    const float* const outputs = pass.forward_actor(parameters.data(), transposed.data(), steps.size());
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
      const Distribution::Terms gradients_of_terms{.log_prob = is_clipped ? 0.0F : -ratio * advantage * inverse_size,
                                                   .entropy = entropy_gradient};
      distribution.gradient(action, terms, gradients_of_terms, work.data(), pass.actor_gradients() + i * output_stride,
                            by_log_std);
    }
    pass.backward_actor(parameters.data(), steps.size(), gradient.data());

    const float* const values = pass.forward_critic(parameters.data(), transposed.data(), steps.size());
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const auto step = static_cast<std::size_t>(steps[i]);
      float value = values[i * kPad];
      bool is_clipped = false;
      if (update.clip_range_vf) {
        const auto limit = static_cast<float>(*update.clip_range_vf);
        const float change = value - rollout.values[step];
        is_clipped = !(std::abs(change) <= limit);  // also if it is NaN
        value = rollout.values[step] + std::clamp(change, -limit, limit);
      }
      const float error = value - rollout.returns[step];
      sums.value += static_cast<double>(error) * static_cast<double>(error);
      pass.critic_gradients()[i * kPad] = is_clipped ? 0.0F : value_scale * error;
    }
    pass.backward_critic(parameters.data(), steps.size(), gradient.data());
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
  const std::size_t least = (minibatch.size() + kMaxChunks - 1) / kMaxChunks;
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

UpdateReport Learner::update(const UpdateConfig& config, std::span<const std::int64_t> order) {
  const SingleCaller::Call call(parts_->callers);
  Parts& parts = *parts_;
  config.validate();
  const std::size_t steps = parts.size();
  require(steps > 0 && parts.is_finished, "update", "a finished rollout", parts.next);
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
      adam(step, gradient.data(), gradient.size(), parts.parameters.data(), parts.adam_m.data(), parts.adam_v.data());
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
