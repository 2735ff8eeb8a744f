#include "learning/dense.hpp"

#include <hwy/targets.h>

#include <random>
#include <tuple>

#include "flockstep/aligned.hpp"
#include "on_target.hpp"
#include "standard.hpp"

namespace flockstep::learning {
namespace {

using namespace testing;

constexpr double kTolerance = 2e-6;  // relative to the sum of the products' magnitudes, or to 1

// Sizes around those of vectors, of registers' blocks and of the padding.
const std::vector<std::tuple<std::size_t, std::size_t, std::size_t>> kSizes{
    {1, 1, 1},   {3, 2, 5},   {7, 4, 6},    {15, 17, 13}, {16, 16, 6},  {17, 15, 2},   {31, 33, 7},
    {38, 64, 8}, {64, 6, 64}, {65, 127, 3}, {64, 64, 11}, {100, 1, 12}, {129, 48, 63}, {5, 200, 1}};

class Dense : public ::testing::Test {
 protected:
  AlignedVector<float> random_rows(std::size_t rows, std::size_t size) {
    AlignedVector<float> values(rows * padded(size));
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t i = 0; i < size; ++i) values[row * padded(size) + i] = normal_(random_);
    }
    return values;
  }

  // A layer whose parameters begin after some others, and these parameters.
  static Layer layer_of(std::size_t in, std::size_t out, After after) {
    return {.in = in, .out = out, .weight = kPad, .bias = kPad + out * padded(in), .transposed = 2 * kPad, .after = after};
  }
  AlignedVector<float> parameters_of(const Layer& layer) {
    AlignedVector<float> all(kPad, -1.0F);
    for (const auto& part : {random_rows(layer.out, layer.in), random_rows(1, layer.out)}) {
      all.insert(all.end(), part.begin(), part.end());
    }
    return all;
  }
  static AlignedVector<float> transposed_of(const Layer& layer, const AlignedVector<float>& parameters) {
    AlignedVector<float> transposed(layer.transposed + layer.in * padded(layer.out));
    transpose(layer, parameters.data(), transposed.data());
    return transposed;
  }

  // Fails unless the rows hold the expected numbers, and zeros behind them.
  static void expect_rows(const AlignedVector<float>& got, const std::vector<double>& expected, const std::vector<double>& sizes,
                          std::size_t rows, std::size_t size) {
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t i = 0; i < padded(size); ++i) {
        const double value = static_cast<double>(got[row * padded(size) + i]);
        if (i >= size) {
          ASSERT_EQ(value, 0.0) << "behind row " << row;
          continue;
        }
        const double limit = kTolerance * (1.0 + sizes[row * size + i]);
        ASSERT_NEAR(value, expected[row * size + i], limit) << "row " << row << ", number " << i;
      }
    }
  }

  template <class F>
  static void on_every_target(const F& f) {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      const OnTarget on(target);
      for (const auto& [in, out, rows] : kSizes) {
        SCOPED_TRACE(std::string(hwy::TargetName(target)) + ", " + std::to_string(in) + " to " + std::to_string(out) + ", rows " +
                     std::to_string(rows));
        f(in, out, rows);
        if (HasFatalFailure()) return;
      }
    }
  }

  std::mt19937 random_{1};
  std::normal_distribution<float> normal_;
};

double applied(After after, double x) {
  return after == After::tanh ? std::tanh(x) : after == After::relu ? std::max(x, 0.0) : x;
}

TEST_F(Dense, ForwardEqualsSumsInDouble) {
  on_every_target([&](std::size_t in, std::size_t out, std::size_t rows) {
    for (const After after : {After::nothing, After::tanh, After::relu}) {
      const Layer layer = layer_of(in, out, after);
      const AlignedVector<float> parameters = parameters_of(layer), x = random_rows(rows, in);
      const AlignedVector<float> transposed = transposed_of(layer, parameters);
      AlignedVector<float> y(rows * padded(out));
      forward(layer, parameters.data(), transposed.data(), x.data(), rows, y.data());
      std::vector<double> expected, sizes;
      for (std::size_t row = 0; row < rows; ++row) {
        for (std::size_t o = 0; o < out; ++o) {
          double sum = static_cast<double>(parameters[layer.bias + o]), size = std::abs(sum);
          for (std::size_t i = 0; i < in; ++i) {
            const double product =
                static_cast<double>(parameters[layer.weight + o * padded(in) + i]) * static_cast<double>(x[row * padded(in) + i]);
            sum += product;
            size += std::abs(product);
          }
          expected.push_back(applied(after, sum));
          sizes.push_back(size);
        }
      }
      expect_rows(y, expected, sizes, rows, out);
    }
  });
}

TEST_F(Dense, GradientsOfWeightsAreAdded) {
  on_every_target([&](std::size_t in, std::size_t out, std::size_t rows) {
    const Layer layer = layer_of(in, out, After::nothing);
    const AlignedVector<float> before = parameters_of(layer), x = random_rows(rows, in), dy = random_rows(rows, out);
    AlignedVector<float> gradient = before;
    add_gradient(layer, x.data(), dy.data(), rows, gradient.data());
    std::vector<double> weights, weight_sizes, biases, bias_sizes;
    for (std::size_t o = 0; o < out; ++o) {
      for (std::size_t i = 0; i <= in; ++i) {  // i == in: the bias
        const std::size_t at = i == in ? layer.bias + o : layer.weight + o * padded(in) + i;
        double sum = static_cast<double>(before[at]), size = std::abs(sum);
        for (std::size_t row = 0; row < rows; ++row) {
          const double product =
              static_cast<double>(dy[row * padded(out) + o]) * (i == in ? 1.0 : static_cast<double>(x[row * padded(in) + i]));
          sum += product;
          size += std::abs(product);
        }
        (i == in ? biases : weights).push_back(sum);
        (i == in ? bias_sizes : weight_sizes).push_back(size);
      }
    }
    const auto weight = gradient.begin() + static_cast<std::ptrdiff_t>(layer.weight),
               bias = gradient.begin() + static_cast<std::ptrdiff_t>(layer.bias);
    expect_rows({weight, bias}, weights, weight_sizes, out, in);
    expect_rows({bias, gradient.end()}, biases, bias_sizes, 1, out);
    for (std::size_t i = 0; i < layer.weight; ++i) ASSERT_EQ(gradient[i], -1.0F) << "before the layer";
  });
}

TEST_F(Dense, BackwardEqualsSumsInDouble) {
  on_every_target([&](std::size_t in, std::size_t out, std::size_t rows) {
    for (const After before : {After::nothing, After::tanh, After::relu}) {
      const Layer layer = layer_of(in, out, After::nothing);
      const AlignedVector<float> parameters = parameters_of(layer), dy = random_rows(rows, out);
      AlignedVector<float> x = random_rows(rows, in), dx(rows * padded(in), 0.0F);
      for (float& value : x) value = static_cast<float>(applied(before, static_cast<double>(value)));
      backward(layer, parameters.data(), dy.data(), before, x.data(), rows, dx.data());
      std::vector<double> expected, sizes;
      for (std::size_t row = 0; row < rows; ++row) {
        for (std::size_t i = 0; i < in; ++i) {
          const double y = static_cast<double>(x[row * padded(in) + i]);
          const double slope = before == After::tanh ? 1.0 - y * y : before == After::relu ? (y > 0.0 ? 1.0 : 0.0) : 1.0;
          double sum = 0.0, size = 0.0;
          for (std::size_t o = 0; o < out; ++o) {
            const double product = static_cast<double>(dy[row * padded(out) + o]) *
                                   static_cast<double>(parameters[layer.weight + o * padded(in) + i]);
            sum += product;
            size += std::abs(product);
          }
          expected.push_back(sum * slope);
          sizes.push_back(size);
        }
      }
      expect_rows(dx, expected, sizes, rows, in);
    }
  });
}

TEST_F(Dense, TanhIsExactToFewUnitsInTheLastPlace) {
  testing::on_every_target([&] {
    const Layer layer = layer_of(1, 1, After::tanh);
    AlignedVector<float> parameters(layer.bias + kPad);
    parameters[layer.weight] = 1.0F;
    const AlignedVector<float> transposed = transposed_of(layer, parameters);
    for (int i = -4000; i <= 4000; ++i) {
      AlignedVector<float> x(kPad), y(kPad);
      x[0] = static_cast<float>(i) * 0.005F;
      forward(layer, parameters.data(), transposed.data(), x.data(), 1, y.data());
      const double expected = std::tanh(static_cast<double>(x[0]));
      ASSERT_NEAR(static_cast<double>(y[0]), expected, 3e-7 * std::abs(expected) + 1e-12) << x[0];
      ASSERT_LE(std::abs(y[0]), 1.0F) << x[0];
    }
  });
}

TEST_F(Dense, AdamStepsAsItsFormulaInDouble) {
  testing::on_every_target([&] {
    constexpr std::size_t kCount = 5 * kPad;
    AlignedVector<float> parameter = random_rows(5, kPad), adam_m(kCount), adam_v(kCount);
    std::vector<double> expected(parameter.begin(), parameter.end()), m(kCount), v(kCount);
    for (int time = 1; time <= 20; ++time) {
      const AlignedVector<float> gradient = random_rows(5, kPad);
      const double rate = 0.01, scale = 0.3, decay1 = 1.0 - std::pow(0.9, time), decay2 = 1.0 - std::pow(0.999, time);
      adam({.step_size = static_cast<float>(rate / decay1),
            .root_of_bias_2 = static_cast<float>(std::sqrt(decay2)),
            .scale = 0.3F},
           gradient.data(), kCount, parameter.data(), adam_m.data(), adam_v.data());
      for (std::size_t i = 0; i < kCount; ++i) {
        const double g = scale * static_cast<double>(gradient[i]);
        m[i] += 0.1 * (g - m[i]);
        v[i] = 0.999 * v[i] + 0.001 * g * g;
        expected[i] -= rate / decay1 * m[i] / (std::sqrt(v[i] / decay2) + 1e-5);
        ASSERT_NEAR(static_cast<double>(parameter[i]), expected[i], 2e-6) << time;
      }
    }
  });
}

}  // namespace
}  // namespace flockstep::learning
