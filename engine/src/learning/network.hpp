// Network: where the parameters of actor and critic lie.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/learner.hpp"
#include "learning/dense.hpp"

namespace flockstep::learning {

// The layers of actor and critic. The last layer gives the means or logits, or the value.
struct Network {
  explicit Network(const NetworkConfig& config);

  std::vector<Layer> actor, critic;
  std::size_t log_std = 0;           // first of action_size numbers; only for actions that are numbers
  std::size_t num_padded = 0;        // parameters with padding
  std::size_t num_transposed = 0;    // transposed weights with padding
  std::vector<ParameterInfo> infos;  // in the order of the plain parameters
  std::size_t num_parameters = 0;    // without padding

  // Copies between plain and padded parameters.
  void unpack(std::span<const float> plain, std::span<float> padded) const;
  std::vector<float> packed(std::span<const float> padded) const;
  // Fills weights with random orthogonal matrices, scaled as in Stable-Baselines3, and the rest with 0.
  void initialise(std::uint64_t seed, std::span<float> padded) const;
  void transpose_all(const AlignedVector<float>& parameters, AlignedVector<float>& transposed) const;

 private:
  // Calls f(plain, padded, count) for every run of consecutive numbers.
  template <class F>
  void for_each_run(const F& f) const;

  struct Place {
    const Layer* layer;  // null: log_std
    bool is_weight;
  };
  std::vector<Place> places_;  // of `infos`
};

}  // namespace flockstep::learning
