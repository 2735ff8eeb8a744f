#include "learning/dense.hpp"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "learning/dense.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace flockstep::learning::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kPad>;
using Floats = hn::Vec<Tag>;
constexpr Tag kTag;
constexpr std::size_t kLanes = hn::MaxLanes(Tag());

// A block of the result is as large as the registers allow: SSE4 and AVX2 have 16, AVX-512 and NEON 32.
constexpr std::size_t kRows = 6, kVectors = HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_AVX2 ? 2 : 4;

// tanh: a ratio of two polynomials in x^2, fitted to the least greatest relative error (6e-9) for |x| < 7.9, beyond which float32
// rounds to 1. The greatest error in float32 is 3e-7.
HWY_INLINE Floats tanh(Floats x) {
  const Floats limit = hn::Set(kTag, 7.9F);
  const Floats c = hn::Min(hn::Max(x, hn::Neg(limit)), limit), u = hn::Mul(c, c);
  Floats p = hn::Set(kTag, 1.5427972e-08F);
  p = hn::MulAdd(p, u, hn::Set(kTag, 2.2023247e-05F));
  p = hn::MulAdd(p, u, hn::Set(kTag, 0.003578992F));
  p = hn::MulAdd(p, u, hn::Set(kTag, 0.13450621F));
  p = hn::MulAdd(p, u, hn::Set(kTag, 1.0F));
  Floats q = hn::Set(kTag, 8.5987807e-07F);
  q = hn::MulAdd(q, u, hn::Set(kTag, 0.00034236506F));
  q = hn::MulAdd(q, u, hn::Set(kTag, 0.026192239F));
  q = hn::MulAdd(q, u, hn::Set(kTag, 0.46783948F));
  q = hn::MulAdd(q, u, hn::Set(kTag, 1.0F));
  return hn::Div(hn::Mul(c, p), q);
}

template <After kAfter>
HWY_INLINE Floats applied(Floats x) {
  if constexpr (kAfter == After::tanh) return tanh(x);
  if constexpr (kAfter == After::relu) return hn::Max(x, hn::Zero(kTag));
  return x;
}

// The derivative of kAfter, from its value y.
template <After kAfter>
HWY_INLINE Floats with_derivative(Floats dy, Floats y) {
  if constexpr (kAfter == After::tanh) return hn::Mul(dy, hn::NegMulAdd(y, y, hn::Set(kTag, 1.0F)));
  if constexpr (kAfter == After::relu) return hn::IfThenElseZero(hn::Gt(y, hn::Zero(kTag)), dy);
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
    for (std::size_t n = 0; n < kN; ++n) bs[n] = hn::Load(kTag, b + n * kLanes);
#pragma GCC unroll 6
    for (std::size_t m = 0; m < kM; ++m) {
      const Floats as = hn::Set(kTag, a[m * a_row]);
#pragma GCC unroll 4
      for (std::size_t n = 0; n < kN; ++n) sum[m][n] = hn::MulAdd(as, bs[n], sum[m][n]);
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
      [=](std::size_t, std::size_t column) HWY_ATTR { return hn::Load(kTag, bias + column); },
      [=](std::size_t row, std::size_t column, Floats sum)
          HWY_ATTR { hn::Store(applied<kAfter>(sum), kTag, y + row * out + column); });
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
      [=](std::size_t row, std::size_t column) HWY_ATTR { return hn::Load(kTag, weight + row * in + column); },
      [=](std::size_t row, std::size_t column, Floats sum) HWY_ATTR { hn::Store(sum, kTag, weight + row * in + column); });
  float* bias = gradient + layer.bias;
  for (std::size_t column = 0; column < layer.out; column += kLanes) {
    Floats sum = hn::Load(kTag, bias + column);
    for (std::size_t row = 0; row < rows; ++row) sum = hn::Add(sum, hn::Load(kTag, dy + row * out + column));
    hn::Store(sum, kTag, bias + column);
  }
}

template <After kBefore>
void backward_to(const Layer& layer, const float* parameters, const float* dy, const float* x, std::size_t rows, float* dx) {
  const std::size_t in = padded(layer.in), out = padded(layer.out);
  multiply(
      {.a = dy, .a_row = out, .a_k = 1, .b = parameters + layer.weight, .b_row = in, .depth = layer.out}, rows, layer.in,
      [](std::size_t, std::size_t) HWY_ATTR { return hn::Zero(kTag); },
      [=](std::size_t row, std::size_t column, Floats sum) HWY_ATTR {
        const std::size_t at = row * in + column;
        hn::Store(with_derivative<kBefore>(sum, hn::Load(kTag, x + at)), kTag, dx + at);
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

void adam(const AdamStep& step, const float* gradient, std::size_t count, float* parameter, float* first, float* second) {
  const Floats scale = hn::Set(kTag, step.scale), eps = hn::Set(kTag, 1e-5F);
  const Floats beta2 = hn::Set(kTag, 0.999F), rest1 = hn::Set(kTag, 0.1F), rest2 = hn::Set(kTag, 0.001F);
  const Floats size = hn::Set(kTag, step.step_size), root = hn::Set(kTag, step.root_of_bias_2);
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Floats g = hn::Mul(hn::Load(kTag, gradient + i), scale);
    const Floats old = hn::Load(kTag, first + i);
    const Floats m = hn::MulAdd(rest1, hn::Sub(g, old), old);
    const Floats v = hn::MulAdd(beta2, hn::Load(kTag, second + i), hn::Mul(rest2, hn::Mul(g, g)));
    const Floats denominator = hn::Add(hn::Div(hn::Sqrt(v), root), eps);
    hn::Store(m, kTag, first + i);
    hn::Store(v, kTag, second + i);
    hn::Store(hn::NegMulAdd(size, hn::Div(m, denominator), hn::Load(kTag, parameter + i)), kTag, parameter + i);
  }
}

void add(const float* from, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; i += kLanes) {
    hn::Store(hn::Add(hn::Load(kTag, to + i), hn::Load(kTag, from + i)), kTag, to + i);
  }
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

void adam(const AdamStep& step, const float* gradient, std::size_t count, float* parameter, float* first, float* second) {
  HWY_DYNAMIC_DISPATCH(adam)(step, gradient, count, parameter, first, second);
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
