// Features: fixed functions from observations to the inputs of the networks.
#pragma once

#include <cstddef>

#include "flockstep/learner.hpp"

namespace flockstep::learning {

// Returns the number of inputs that an observation of this size becomes.
std::size_t input_size(Features features, std::size_t observation_size);

// Writes the inputs of one observation.
void write_inputs(Features features, const float* observation, std::size_t observation_size, float* inputs);

}  // namespace flockstep::learning
