#include "learning/features.hpp"

#include <algorithm>
#include <cmath>

namespace flockstep::learning {
namespace {

constexpr std::size_t kDirection = 3;  // numbers of a direction or an offset
constexpr float kDirectionGain = 2.0F;
constexpr float kNearest = 0.05F;  // fraction of the maximum range: keeps the logarithm finite
constexpr std::size_t kBlob = 2;   // offset and area of the blob
constexpr float kOffsetGain = 3.0F, kWidthGain = 5.0F;
constexpr float kNearPoint = 0.1F;  // m

// Emphasises near obstacles.
void write_nearness(const float* ranges, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; ++i) to[i] = -std::log(ranges[i] + kNearest);
}

}  // namespace

std::size_t input_size(Features features, std::size_t observation_size) {
  if (features == Features::blob) return observation_size + 1;
  if (features == Features::point) return observation_size + kDirection;
  return observation_size;
}

void write_inputs(Features features, const float* observation, std::size_t observation_size, float* inputs) {
  switch (features) {
    case Features::flat:
      std::copy_n(observation, observation_size, inputs);
      return;
    case Features::goal:
      for (std::size_t i = 0; i < kDirection; ++i) inputs[i] = kDirectionGain * observation[i];
      write_nearness(observation + kDirection, observation_size - kDirection, inputs + kDirection);
      return;
    case Features::blob:
      inputs[0] = kOffsetGain * observation[0];
      inputs[1] = kWidthGain * std::sqrt(observation[1]);
      inputs[2] = observation[1] > 0.0F ? 1.0F : 0.0F;
      write_nearness(observation + kBlob, observation_size - kBlob, inputs + kBlob + 1);
      return;
    case Features::point: {
      const float x = observation[0], y = observation[1], z = observation[2];
      const float scale = 1.0F / (std::sqrt(x * x + y * y + z * z) + kNearPoint);
      for (std::size_t i = 0; i < kDirection; ++i) inputs[i] = observation[i] * scale;
      std::copy_n(observation, observation_size, inputs + kDirection);
      return;
    }
  }
}

}  // namespace flockstep::learning
