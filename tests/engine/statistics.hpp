// Statistics of readings, for the oracles of sensors' errors.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

namespace flockstep::testing {

struct Moments {
  double mean = 0.0, variance = 0.0;
};

inline Moments moments(const std::vector<double>& values) {
  Moments m;
  for (const double value : values) m.mean += value / static_cast<double>(values.size());
  for (const double value : values) m.variance += (value - m.mean) * (value - m.mean) / static_cast<double>(values.size() - 1);
  return m;
}

// Compares the mean of independent values with the expected one, within three standard errors.
inline ::testing::AssertionResult has_mean(const std::vector<double>& values, double expected) {
  const Moments found = moments(values);
  const double error = std::sqrt(found.variance / static_cast<double>(values.size()));
  if (error > 0.0 && std::abs(found.mean - expected) <= 3.0 * error) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "mean " << found.mean << " +- " << error << ", expected " << expected;
}

inline std::vector<double> products(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> all;
  for (std::size_t i = 0; i < a.size(); ++i) all.push_back(a[i] * b[i]);
  return all;
}

// Returns the Allan variance of clusters of k readings.
inline double allan_variance(const std::vector<double>& readings, std::size_t k) {
  std::vector<double> means;
  for (std::size_t i = 0; i + k <= readings.size(); i += k) {
    double mean = 0.0;
    for (std::size_t j = i; j < i + k; ++j) mean += readings[j] / static_cast<double>(k);
    means.push_back(mean);
  }
  double sum = 0.0;
  for (std::size_t i = 1; i < means.size(); ++i) sum += (means[i] - means[i - 1]) * (means[i] - means[i - 1]);
  return sum / (2.0 * static_cast<double>(means.size() - 1));
}

// Returns the Allan variance of a stationary process with this covariance of readings that are n apart.
inline double allan_variance_of(const std::function<double(double)>& covariance, std::size_t k) {
  double variance = 0.0;
  for (std::size_t i = 0; i < k; ++i) {
    for (std::size_t j = 0; j < k; ++j) {
      const double lag = static_cast<double>(j) - static_cast<double>(i);
      variance += covariance(std::abs(lag)) - covariance(static_cast<double>(k) + lag);
    }
  }
  return variance / static_cast<double>(k * k);
}

// Compares the Allan variance of independent series with the expected one, for clusters of three lengths k. Each element of
// `readings` has one reading of every series.
inline void expect_allan(std::span<const std::vector<double>> readings, const std::function<double(std::size_t)>& expected) {
  for (const std::size_t k : {1U, 16U, 64U}) {
    std::vector<double> found;
    for (std::size_t i = 0; i < readings.front().size(); ++i) {
      std::vector<double> series;
      for (const std::vector<double>& now : readings) series.push_back(now[i]);
      found.push_back(allan_variance(series, k));
    }
    EXPECT_TRUE(has_mean(found, expected(k))) << k;
  }
}

// The same, of stationary series with this covariance.
inline void expect_allan_of(std::span<const std::vector<double>> readings, const std::function<double(double)>& covariance) {
  expect_allan(readings, [&](std::size_t k) { return allan_variance_of(covariance, k); });
}

// Returns the Allan variance of readings of a random walk, whose variance grows by `step` between two. The mean of k readings
// makes it (2 k^2 + 1) / (2 k^2) times that of a continuous walk.
inline double allan_variance_of_walk(double step, std::size_t k) {
  const auto n = static_cast<double>(k);
  return step * n / 3.0 * (1.0 + 0.5 / (n * n));
}

}  // namespace flockstep::testing
