// Rollout: what was collected for one update. Arrays have one row per step and row of the batch, t * R + r.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/learner.hpp"

namespace flockstep::learning {

// Mean 0 and variance 1 of `size` numbers.
RunningMoments initial_moments(std::size_t size);

// Takes rows of numbers into account: T. F. Chan, G. H. Golub, R. J. LeVeque, "Updating formulae and a pairwise algorithm for
// computing sample variances", COMPSTAT 1982. values: (rows, size).
void take(RunningMoments& moments, const float* values, std::size_t rows);
void take(RunningMoments& moments, const double* values, std::size_t rows);

struct Rollout {
  RolloutConfig config;
  std::size_t steps = 0, rows = 0;
  AlignedVector<float> inputs;   // (steps, rows, padded inputs)
  AlignedVector<float> actions;  // (steps, rows, action_size)
  AlignedVector<float> log_probs, values, rewards, advantages, returns;
  std::vector<std::uint8_t> done;     // the episode ended in this step
  std::vector<std::uint8_t> skipped;  // nothing is learned from this step
  bool has_skipped = false;           // any of them

  void resize(const RolloutConfig& config, std::size_t rows, std::size_t input_stride, std::size_t action_size);
  // Generalised advantage estimation: J. Schulman, P. Moritz, S. Levine, M. Jordan, P. Abbeel, "High-dimensional continuous
  // control using generalized advantage estimation", ICLR 2016. last_values: of the observations after the last step.
  void estimate_advantages(const float* last_values);
  // 1 - Var(returns - values) / Var(returns); NaN if the returns are constant.
  double explained_variance() const;
};

}  // namespace flockstep::learning
