// Fully connected layers: the arithmetic of the networks, by SIMD. Matrices have rows of a padded length, a multiple of kPad
// floats; the numbers in between are 0, and every function keeps them so.
#pragma once

#include <cstddef>
#include <cstdint>

#include "flockstep/learner.hpp"

namespace flockstep::learning {

inline constexpr std::size_t kPad = 16;

constexpr std::size_t padded(std::size_t count) { return (count + kPad - 1) / kPad * kPad; }

// The function after a layer.
enum class After : std::uint8_t { nothing, tanh, relu };

// Sizes of a layer, and places of its parameters.
struct Layer {
  std::size_t in, out;
  std::size_t weight, bias;  // first number among the padded parameters: (out, padded in) and (padded out)
  std::size_t transposed;    // first number among the transposed weights: (in, padded out)
  After after;
};

// y = after(x W^T + b). x: (rows, padded in), y: (rows, padded out).
void forward(const Layer& layer, const float* parameters, const float* transposed, const float* x, std::size_t rows, float* y);

// Adds the gradient of the layer's weights and bias. dy: (rows, padded out), the gradient before `after`.
void add_gradient(const Layer& layer, const float* x, const float* dy, std::size_t rows, float* gradient);

// dx = (dy W) before'(x), the gradient before the function whose values are x. x, dx: (rows, padded in).
void backward(const Layer& layer, const float* parameters, const float* dy, After before, const float* x, std::size_t rows,
              float* dx);

// Fills the transposed weights of the layer.
void transpose(const Layer& layer, const float* parameters, float* transposed);

// One step of Adam: D. P. Kingma, J. Ba, "Adam: a method for stochastic optimization", ICLR 2015, computed as PyTorch does.
struct AdamStep {
  float step_size;       // learning rate / (1 - beta1^t)
  float root_of_bias_2;  // sqrt(1 - beta2^t)
  float scale;           // factor that limits the norm of the gradient
  float beta2 = 0.999F;
};
// adam_m, adam_v: running means of the gradient and of its square. count: a multiple of kPad.
void adam(const AdamStep& step, const float* gradient, std::size_t count, float* parameter, float* adam_m, float* adam_v);

// to += from.
void add(const float* from, std::size_t count, float* to);

}  // namespace flockstep::learning
