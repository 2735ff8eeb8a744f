#include "learning/running_moments.hpp"

#include <vector>

namespace flockstep::learning {
namespace {

template <class Number>
void take_rows(RunningMoments& moments, const Number* values, std::size_t rows) {
  if (rows == 0) return;
  const std::size_t size = moments.mean.size();
  const auto count = static_cast<double>(rows);
  std::vector<double> mean(size, 0.0), squares(size, 0.0);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < size; ++i) mean[i] += static_cast<double>(values[row * size + i]);
  }
  for (double& sum : mean) sum /= count;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < size; ++i) {
      const double difference = static_cast<double>(values[row * size + i]) - mean[i];
      squares[i] += difference * difference;
    }
  }
  const double total = moments.count + count;
  for (std::size_t i = 0; i < size; ++i) {
    const double difference = mean[i] - moments.mean[i];
    const double sum = moments.variance[i] * moments.count + squares[i] + difference * difference * moments.count * count / total;
    moments.mean[i] += difference * count / total;
    moments.variance[i] = sum / total;
  }
  moments.count = total;
}

}  // namespace

RunningMoments initial_moments(std::size_t size) {
  return {.mean = std::vector<double>(size, 0.0), .variance = std::vector<double>(size, 1.0)};
}

void take(RunningMoments& moments, const float* values, std::size_t rows) { take_rows(moments, values, rows); }
void take(RunningMoments& moments, const double* values, std::size_t rows) { take_rows(moments, values, rows); }

}  // namespace flockstep::learning
