// Distribution of the actions, given the outputs of the actor. Independent Gaussians whose standard deviations do not depend on
// the observation, or one of several actions, whose log probabilities are the outputs plus a constant.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/learner.hpp"

namespace flockstep::learning {

class Distribution {
 public:
  // Log probability of an action, and entropy; also the gradient of the loss by the two.
  struct Terms {
    float log_prob, entropy;
  };
  // Key of the random numbers of one action.
  struct Draw {
    std::uint64_t seed, number;
    std::uint32_t row;
  };

  explicit Distribution(const NetworkConfig& config)
      : is_discrete_(config.is_discrete), size_(static_cast<std::size_t>(config.action_size)) {}

  std::size_t outputs() const { return size_; }                         // numbers that the actor returns
  std::size_t action_size() const { return is_discrete_ ? 1 : size_; }  // numbers that an action is stored as
  // Call this after the parameters have changed; for discrete actions log_std is not read.
  void set(const float* log_std);

  void mode(const float* output, float* action) const;
  void draw(const float* output, const Draw& draw, float* action) const;
  // work: (outputs,) for gradient(), which takes the same output and action.
  Terms evaluate(const float* output, const float* action, float* work) const;
  // Writes the gradient by the outputs; adds the one by log_std. work is overwritten by neither.
  void gradient(const float* action, Terms terms, Terms gradients, const float* work, float* by_output, float* by_log_std) const;
  // Adds the gradient by log_std of an entropy that is the same for all steps.
  void entropy_gradient(float gradient, float* by_log_std) const;
  double mean_std() const;  // mean of the standard deviations; 0 for discrete actions

 private:
  bool is_discrete_;
  std::size_t size_;
  std::vector<float> std_, inverse_std_;
  float log_normaliser_ = 0.0F, entropy_ = 0.0F;
};

}  // namespace flockstep::learning
