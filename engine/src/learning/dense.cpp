#include "learning/dense.hpp"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "learning/dense.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::learning::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

using Floats = WideUpTo<kPad>;
constexpr std::size_t kLanes = Floats::kCount;

// A block of the result is as large as the registers allow: SSE4 and AVX2 have 16, AVX-512 and NEON 32.
constexpr std::size_t kRows = 6, kVectors = HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_AVX2 ? 2 : 4;

// tanh: a ratio of two polynomials in x^2, fitted to the least greatest relative error (6e-9) for |x| < 7.9, beyond which float32
// rounds to 1. The greatest error in float32 is 3e-7.
HWY_INLINE Floats tanh(Floats x) {
  const Floats c = min(max(x, -7.9F), 7.9F), u = c * c;
  Floats p = 1.5427972e-08F;
  p = mul_add(p, u, 2.2023247e-05F);
  p = mul_add(p, u, 0.003578992F);
  p = mul_add(p, u, 0.13450621F);
  p = mul_add(p, u, 1.0F);
  Floats q = 8.5987807e-07F;
  q = mul_add(q, u, 0.00034236506F);
  q = mul_add(q, u, 0.026192239F);
  q = mul_add(q, u, 0.46783948F);
  q = mul_add(q, u, 1.0F);
  return c * p / q;
}

template <After kAfter>
HWY_INLINE Floats applied(Floats x) {
  if constexpr (kAfter == After::tanh) return tanh(x);
  if constexpr (kAfter == After::relu) return max(x, 0.0F);
  return x;
}

// The gradient before kAfter, from the gradient dy after it and its value y.
template <After kAfter>
HWY_INLINE Floats with_derivative(Floats dy, Floats y) {
  if constexpr (kAfter == After::tanh) return dy * neg_mul_add(y, y, 1.0F);
  if constexpr (kAfter == After::relu) return value_if(y > 0.0F, dy);
  return dy;
}

// The operands of a product C = A B. A is read element by element, B and C in vectors.
struct Product {
  const float* a;  // element (row, k) is a[row * a_row + k * a_k]
  std::size_t a_row, a_k;
  const float* b;  // row k is b + k * b_row
  std::size_t b_row;
  std::size_t depth;  // number of k
};

// Computes a block of kM rows and kN vectors of C. finish(row, vector, sum) takes the results; each is summed in the order of k,
// from begin(row, vector).
template <std::size_t kM, std::size_t kN, class Begin, class Finish>
HWY_INLINE void block(const Product& p, std::size_t row, std::size_t column, const Begin& begin, const Finish& finish) {
  Floats sum[kM][kN];
#pragma GCC unroll 6
  for (std::size_t m = 0; m < kM; ++m) {
#pragma GCC unroll 4
    for (std::size_t n = 0; n < kN; ++n) sum[m][n] = begin(row + m, column + n * kLanes);
  }
  const float* a = p.a + row * p.a_row;
  const float* b = p.b + column;
  const std::size_t a_row = p.a_row, a_k = p.a_k, b_row = p.b_row;
  for (std::size_t k = p.depth; k > 0; --k) {
    Floats bs[kN];
#pragma GCC unroll 4
    for (std::size_t n = 0; n < kN; ++n) bs[n] = Floats::load(b + n * kLanes);
#pragma GCC unroll 6
    for (std::size_t m = 0; m < kM; ++m) {
      const Floats as = a[m * a_row];
#pragma GCC unroll 4
      for (std::size_t n = 0; n < kN; ++n) sum[m][n] = mul_add(as, bs[n], sum[m][n]);
    }
    a += a_k;
    b += b_row;
  }
#pragma GCC unroll 6
  for (std::size_t m = 0; m < kM; ++m) {
#pragma GCC unroll 4
    for (std::size_t n = 0; n < kN; ++n) finish(row + m, column + n * kLanes, sum[m][n]);
  }
}

template <std::size_t kN, class Begin, class Finish>
HWY_INLINE void columns(const Product& p, std::size_t rows, std::size_t column, const Begin& begin, const Finish& finish) {
  std::size_t row = 0;
  for (; row + kRows <= rows; row += kRows) block<kRows, kN>(p, row, column, begin, finish);
  for (; row + 2 <= rows; row += 2) block<2, kN>(p, row, column, begin, finish);
  if (row < rows) block<1, kN>(p, row, column, begin, finish);
}

// Computes C, whose rows have `count` columns.
template <class Begin, class Finish>
HWY_INLINE void multiply(const Product& p, std::size_t rows, std::size_t count, const Begin& begin, const Finish& finish) {
  const std::size_t end = (count + kLanes - 1) / kLanes * kLanes;
  std::size_t column = 0;
  for (; column + kVectors * kLanes <= end; column += kVectors * kLanes) columns<kVectors>(p, rows, column, begin, finish);
  if constexpr (kVectors > 2) {
    if (column + 2 * kLanes <= end) {
      columns<2>(p, rows, column, begin, finish);
      column += 2 * kLanes;
    }
  }
  if (column < end) columns<1>(p, rows, column, begin, finish);
}

template <After kAfter>
void forward_then(const Layer& layer, const float* parameters, const float* transposed, const float* x, std::size_t rows,
                  float* y) {
  const std::size_t in = padded(layer.in), out = padded(layer.out);
  const float* bias = parameters + layer.bias;
  multiply(
      {.a = x, .a_row = in, .a_k = 1, .b = transposed + layer.transposed, .b_row = out, .depth = layer.in}, rows, layer.out,
      [=](std::size_t, std::size_t column) HWY_ATTR { return Floats::load(bias + column); },
      [=](std::size_t row, std::size_t column, Floats sum) HWY_ATTR { applied<kAfter>(sum).store(y + row * out + column); });
}

void forward(const Layer& layer, const float* parameters, const float* transposed, const float* x, std::size_t rows, float* y) {
  switch (layer.after) {
    case After::tanh:
      return forward_then<After::tanh>(layer, parameters, transposed, x, rows, y);
    case After::relu:
      return forward_then<After::relu>(layer, parameters, transposed, x, rows, y);
    case After::nothing:
      return forward_then<After::nothing>(layer, parameters, transposed, x, rows, y);
  }
}

void add_gradient(const Layer& layer, const float* x, const float* dy, std::size_t rows, float* gradient) {
  const std::size_t in = padded(layer.in), out = padded(layer.out);
  float* weight = gradient + layer.weight;
  multiply(
      {.a = dy, .a_row = 1, .a_k = out, .b = x, .b_row = in, .depth = rows}, layer.out, layer.in,
      [=](std::size_t row, std::size_t column) HWY_ATTR { return Floats::load(weight + row * in + column); },
      [=](std::size_t row, std::size_t column, Floats sum) HWY_ATTR { sum.store(weight + row * in + column); });
  float* bias = gradient + layer.bias;
  for (std::size_t column = 0; column < layer.out; column += kLanes) {
    Floats sum = Floats::load(bias + column);
    for (std::size_t row = 0; row < rows; ++row) sum = sum + Floats::load(dy + row * out + column);
    sum.store(bias + column);
  }
}

template <After kBefore>
void backward_to(const Layer& layer, const float* parameters, const float* dy, const float* x, std::size_t rows, float* dx) {
  const std::size_t in = padded(layer.in), out = padded(layer.out);
  multiply(
      {.a = dy, .a_row = out, .a_k = 1, .b = parameters + layer.weight, .b_row = in, .depth = layer.out}, rows, layer.in,
      [](std::size_t, std::size_t) HWY_ATTR { return Floats(0.0F); },
      [=](std::size_t row, std::size_t column, Floats sum) HWY_ATTR {
        const std::size_t at = row * in + column;
        with_derivative<kBefore>(sum, Floats::load(x + at)).store(dx + at);
      });
}

void backward(const Layer& layer, const float* parameters, const float* dy, After before, const float* x, std::size_t rows,
              float* dx) {
  switch (before) {
    case After::tanh:
      return backward_to<After::tanh>(layer, parameters, dy, x, rows, dx);
    case After::relu:
      return backward_to<After::relu>(layer, parameters, dy, x, rows, dx);
    case After::nothing:
      return backward_to<After::nothing>(layer, parameters, dy, x, rows, dx);
  }
}

void adam(const AdamStep& step, const float* gradient, std::size_t count, float* parameter, float* adam_m, float* adam_v) {
  const Floats scale = step.scale, step_size = step.step_size, root_of_bias_2 = step.root_of_bias_2;
  const Floats one_minus_beta1 = 0.1F, beta2 = step.beta2, one_minus_beta2 = step.beta2 == 0.999F ? 0.001F : 1.0F - step.beta2,
               epsilon = 1e-5F;
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Floats g = Floats::load(gradient + i) * scale, old_m = Floats::load(adam_m + i);
    const Floats m = mul_add(one_minus_beta1, g - old_m, old_m);
    const Floats v = mul_add(beta2, Floats::load(adam_v + i), one_minus_beta2 * (g * g));
    m.store(adam_m + i);
    v.store(adam_v + i);
    neg_mul_add(step_size, m / (sqrt(v) / root_of_bias_2 + epsilon), Floats::load(parameter + i)).store(parameter + i);
  }
}

void add(const float* from, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; i += kLanes) (Floats::load(to + i) + Floats::load(from + i)).store(to + i);
}

}  // namespace flockstep::learning::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::learning {

HWY_EXPORT(forward);
HWY_EXPORT(add_gradient);
HWY_EXPORT(backward);
HWY_EXPORT(adam);
HWY_EXPORT(add);

void forward(const Layer& layer, const float* parameters, const float* transposed, const float* x, std::size_t rows, float* y) {
  HWY_DYNAMIC_DISPATCH(forward)(layer, parameters, transposed, x, rows, y);
}

void add_gradient(const Layer& layer, const float* x, const float* dy, std::size_t rows, float* gradient) {
  HWY_DYNAMIC_DISPATCH(add_gradient)(layer, x, dy, rows, gradient);
}

void backward(const Layer& layer, const float* parameters, const float* dy, After before, const float* x, std::size_t rows,
              float* dx) {
  HWY_DYNAMIC_DISPATCH(backward)(layer, parameters, dy, before, x, rows, dx);
}

void adam(const AdamStep& step, const float* gradient, std::size_t count, float* parameter, float* adam_m, float* adam_v) {
  HWY_DYNAMIC_DISPATCH(adam)(step, gradient, count, parameter, adam_m, adam_v);
}

void add(const float* from, std::size_t count, float* to) { HWY_DYNAMIC_DISPATCH(add)(from, count, to); }

void transpose(const Layer& layer, const float* parameters, float* transposed) {
  const std::size_t in = padded(layer.in), out = padded(layer.out);
  for (std::size_t o = 0; o < layer.out; ++o) {
    const float* from = parameters + layer.weight + o * in;
    float* to = transposed + layer.transposed + o;
    for (std::size_t i = 0; i < layer.in; ++i) to[i * out] = from[i];
  }
}

}  // namespace flockstep::learning
#endif
