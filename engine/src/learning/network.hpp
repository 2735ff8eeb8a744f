// The networks: inputs from observations, where the parameters of actor and critic lie, and passes through them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/learner.hpp"
#include "learning/dense.hpp"

namespace flockstep::learning {

// Returns the number of inputs that an observation of this size becomes.
std::size_t input_size(Features features, std::size_t observation_size);

// Writes the inputs of one observation. Its first `actor_size` numbers become features, the other ones stay as they are.
void write_inputs(Features features, const float* observation, std::size_t actor_size, std::size_t size, float* inputs);

// Derivatives by the first `size` numbers of an observation, from those by its inputs. Throws std::invalid_argument for features
// without derivatives.
void pull_back_inputs(Features features, const float* observation, const float* d_inputs, std::size_t size, float* d_observation);

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
  std::vector<Place> places_;  // one for each of `infos`
};

// Pass: sends a few rows at a time through actor and critic, and gradients back. One per thread.
class Pass {
 public:
  static constexpr std::size_t kRows = 64;  // at most; few enough that all layers stay in the cache

  explicit Pass(const Network& network);

  float* inputs() { return inputs_.data(); }  // (kRows, padded inputs of the critic), to be filled
  // Send `rows` rows of the inputs through a network. Return the outputs, (rows, padded outputs).
  const float* forward_actor(const float* parameters, const float* transposed, std::size_t rows) {
    if (!actor_inputs_.empty()) copy_actor_inputs(rows);
    return forward(network_.actor, actor_inputs(), actor_, parameters, transposed, rows);
  }
  const float* forward_critic(const float* parameters, const float* transposed, std::size_t rows) {
    return forward(network_.critic, inputs_.data(), critic_, parameters, transposed, rows);
  }
  // Gradients by the outputs, to be filled; numbers beyond the outputs stay 0.
  float* actor_gradients() { return actor_.back().gradients.data(); }
  float* critic_gradients() { return critic_.back().gradients.data(); }
  // Add the gradient by the parameters, after the forward pass of the same rows.
  // d_inputs: if not null, receives the derivatives by the inputs, (rows, padded inputs of the actor).
  void backward_actor(const float* parameters, std::size_t rows, float* gradient, float* d_inputs = nullptr) {
    backward(network_.actor, actor_inputs(), actor_, parameters, rows, gradient);
    if (d_inputs == nullptr) return;
    learning::backward(network_.actor.front(), parameters, actor_.front().gradients.data(), After::nothing, actor_inputs(), rows,
                       d_inputs);
  }
  void backward_critic(const float* parameters, std::size_t rows, float* gradient) {
    backward(network_.critic, inputs_.data(), critic_, parameters, rows, gradient);
  }

 private:
  struct Values {  // one layer's
    AlignedVector<float> outputs, gradients;
  };

  static const float* forward(const std::vector<Layer>& layers, const float* inputs, std::vector<Values>& values,
                              const float* parameters, const float* transposed, std::size_t rows);
  static void backward(const std::vector<Layer>& layers, const float* inputs, std::vector<Values>& values,
                       const float* parameters, std::size_t rows, float* gradient);

  const float* actor_inputs() const { return actor_inputs_.empty() ? inputs_.data() : actor_inputs_.data(); }
  // Copies the actor's part of the inputs, since the numbers between the rows of a layer have to be 0.
  void copy_actor_inputs(std::size_t rows);

  const Network& network_;
  AlignedVector<float> inputs_;
  AlignedVector<float> actor_inputs_;  // (kRows, padded inputs of the actor); empty: those of the critic
  std::vector<Values> actor_, critic_;
};

}  // namespace flockstep::learning
