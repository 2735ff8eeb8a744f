// Converts between sRGB and linear values.
#pragma once

#include <array>
#include <cstdint>

namespace flockstep {

// Returns the linear value in [0, 1] of an sRGB value in [0, 1].
float linear_of_srgb(double value);

// Returns the linear value in [0, 1] of each sRGB byte.
const std::array<float, 256>& srgb_to_linear();

// Returns the nearest sRGB byte, measured in sRGB. Values outside [0, 1] are clamped.
std::uint8_t linear_to_srgb(float linear);

}  // namespace flockstep
