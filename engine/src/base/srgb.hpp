// Bytes of sRGB and linear values.
#pragma once

#include <array>
#include <cstdint>

namespace flockstep {

// The linear value in [0, 1] of one of sRGB in [0, 1].
float linear_of_srgb(double value);

// The linear value in [0, 1] of each byte.
const std::array<float, 256>& srgb_to_linear();

// The byte whose value is nearest, as sRGB measures it; of values beyond [0, 1] the last one.
std::uint8_t linear_to_srgb(float linear);

}  // namespace flockstep
