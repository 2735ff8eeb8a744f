// Pass: sends a few rows at a time through actor and critic, and gradients back. One per thread.
#pragma once

#include <cstddef>
#include <vector>

#include "flockstep/aligned.hpp"
#include "learning/network.hpp"

namespace flockstep::learning {

class Pass {
 public:
  static constexpr std::size_t kRows = 64;  // at most; few enough that all layers stay in the cache

  explicit Pass(const Network& network);

  float* inputs() { return inputs_.data(); }  // (kRows, padded inputs), to be filled
  // Send `rows` rows of the inputs through a network. Return the outputs, (rows, padded outputs).
  const float* forward_actor(const float* parameters, const float* transposed, std::size_t rows) {
    return forward(network_.actor, actor_, parameters, transposed, rows);
  }
  const float* forward_critic(const float* parameters, const float* transposed, std::size_t rows) {
    return forward(network_.critic, critic_, parameters, transposed, rows);
  }
  // Gradients by the outputs, to be filled; numbers beyond the outputs stay 0.
  float* actor_gradients() { return actor_.back().gradients.data(); }
  float* critic_gradients() { return critic_.back().gradients.data(); }
  // Add the gradient by the parameters, after the forward pass of the same rows.
  void backward_actor(const float* parameters, std::size_t rows, float* gradient) {
    backward(network_.actor, actor_, parameters, rows, gradient);
  }
  void backward_critic(const float* parameters, std::size_t rows, float* gradient) {
    backward(network_.critic, critic_, parameters, rows, gradient);
  }

 private:
  struct Values {  // of one layer
    AlignedVector<float> outputs, gradients;
  };

  const float* forward(const std::vector<Layer>& layers, std::vector<Values>& values, const float* parameters,
                       const float* transposed, std::size_t rows);
  void backward(const std::vector<Layer>& layers, std::vector<Values>& values, const float* parameters, std::size_t rows,
                float* gradient);

  const Network& network_;
  AlignedVector<float> inputs_;
  std::vector<Values> actor_, critic_;
};

}  // namespace flockstep::learning
