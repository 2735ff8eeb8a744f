// Kinematic drones that stay where they are while their sensors read, for tests of sensors that need no rotors.
#pragma once

#include <vector>

#include "batch_helpers.hpp"

namespace flockstep::testing {

constexpr double kReadingS = 0.05;  // time between two readings

inline BatchConfig resting(int num_drones) {
  return {.num_envs = num_drones, .num_threads = 1, .clock = {.policy_hz = static_cast<float>(1.0 / kReadingS)}};
}

inline Batch make_resting(const BatchConfig& config) {
  return Batch(config, {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5000, 5000, 5000})})});
}

// Lets a step pass, and reads.
inline void read_next(Batch& batch) {
  const std::vector<float> position = batch.state().position;
  batch.move(position, {});
  batch.sense();
}

}  // namespace flockstep::testing
