// Gusts, compared with closed forms of their variances, autocorrelations and spectra.
#include "dynamics/wind.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "random.hpp"

namespace flockstep::dynamics {
namespace {

GustNoise noise(testing::Random& random) {
  GustNoise numbers;
  for (float& number : numbers) number = random.normal();
  return numbers;
}

// Returns a long record of the three components, starting from the stationary distribution.
std::array<std::vector<double>, 3> record(const WindConfig& config, double step, int count, unsigned seed) {
  testing::Random random(seed);
  const Wind wind(config, step);
  GustState gust = wind.begin(noise(random));
  std::array<std::vector<double>, 3> values;
  for (int i = 0; i < count; ++i) {
    const Vec3 at = wind.at(gust);
    for (int axis = 0; axis < 3; ++axis) values[static_cast<std::size_t>(axis)].push_back(static_cast<double>(at[axis]));
    gust = wind.next(gust, noise(random));
  }
  return values;
}

double covariance(const std::vector<double>& x, std::size_t lag, double mean) {
  double sum = 0.0;
  for (std::size_t i = 0; i + lag < x.size(); ++i) sum += (x[i] - mean) * (x[i + lag] - mean);
  return sum / static_cast<double>(x.size() - lag);
}

TEST(Wind, WithoutGustsIsItsMean) {
  const Wind wind({.mean_mps = {1, -2, 0.5F}}, 0.02);
  EXPECT_FALSE(wind.has_gusts());
  EXPECT_EQ(wind.at({}), Vec3(1, -2, 0.5F));
}

TEST(Wind, OrnsteinUhlenbeckDecaysInItsTime) {
  const WindConfig config{.mean_mps = {3, 0, 0}, .gusts = Gusts::ornstein_uhlenbeck, .gust_std_mps = 0.7F, .gust_time_s = 0.5F};
  const auto values = record(config, 0.05, 400000, 1);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double mean = axis == 0 ? 3.0 : 0.0;
    for (const std::size_t lag : {0U, 5U, 10U, 20U}) {
      const double expected = 0.49 * std::exp(-0.05 * static_cast<double>(lag) / 0.5);
      EXPECT_NEAR(covariance(values[axis], lag, mean), expected, 0.02) << axis << ", " << lag;
    }
  }
}

// 8785C: with T = L / V, the autocovariance is s^2 e^(-t/T) along the wind, and s^2 e^(-t/T) (1 - t / 2T) across and
// vertically.
TEST(Wind, DrydenHasTheCovarianceOfTheStandard) {
  const WindConfig config{.mean_mps = {4, 3, 0}, .gusts = Gusts::dryden, .wind_at_6m_mps = 8.0F, .height_m = 20.0F};
  const double feet = 20.0 / 0.3048;
  const double shape = 0.177 + 0.000823 * feet;
  const double std_w = 0.8, std_u = std_w / std::pow(shape, 0.4);
  const double time_u = feet / std::pow(shape, 1.2) * 0.3048 / 5.0, time_w = 20.0 / 5.0;
  const double step = 0.5;
  const auto values = record(config, step, 1000000, 2);
  std::vector<double> along, across, up = values[2];
  for (std::size_t i = 0; i < values[0].size(); ++i) {
    const double x = values[0][i] - 4.0, y = values[1][i] - 3.0;
    along.push_back(0.8 * x + 0.6 * y);
    across.push_back(-0.6 * x + 0.8 * y);
  }
  for (const std::size_t lag : {0U, 1U, 4U, 16U, 40U}) {
    const double t = step * static_cast<double>(lag);
    const double tolerance = 0.03;
    EXPECT_NEAR(covariance(along, lag, 0.0) / (std_u * std_u), std::exp(-t / time_u), 2 * tolerance) << lag;
    EXPECT_NEAR(covariance(across, lag, 0.0) / (std_u * std_u), std::exp(-t / time_u) * (1.0 - 0.5 * t / time_u), tolerance)
        << lag;
    EXPECT_NEAR(covariance(up, lag, 0.0) / (std_w * std_w), std::exp(-t / time_w) * (1.0 - 0.5 * t / time_w), tolerance) << lag;
  }
}

// The process is exact for any step size: two short steps equal a long one.
TEST(Wind, DoesNotDependOnTheStep) {
  const WindConfig config{.gusts = Gusts::dryden};
  const auto fine = record(config, 0.25, 800000, 3);
  const auto coarse = record(config, 1.0, 200000, 4);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const std::size_t lag : {0U, 1U, 3U}) {
      const double scale = covariance(coarse[axis], 0, 0.0);
      EXPECT_NEAR(covariance(fine[axis], 4 * lag, 0.0) / scale, covariance(coarse[axis], lag, 0.0) / scale, 0.06);
    }
  }
}

}  // namespace
}  // namespace flockstep::dynamics
