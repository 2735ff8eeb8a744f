// Tests whether all numbers are finite.
#pragma once

#include <span>

namespace flockstep {

bool are_finite(std::span<const float> values);
bool are_finite(std::span<const double> values);

}  // namespace flockstep
