#include <algorithm>
#include <cstddef>
#include <string>

#include "base/require.hpp"
#include "flockstep/color.hpp"

namespace flockstep {

void ColorRange::validate() const {
  const auto text = [](const std::array<int, 3>& values) {
    return "(" + std::to_string(values[0]) + ", " + std::to_string(values[1]) + ", " + std::to_string(values[2]) + ")";
  };
  const auto is_byte = [](int value) { return value >= 0 && value <= 255; };
  require(std::ranges::all_of(low, is_byte), "color.low", "three integers in [0, 255]", text(low));
  require(std::ranges::all_of(high, is_byte), "color.high", "three integers in [0, 255]", text(high));
  for (std::size_t k = space == ColorSpace::hsv ? 1 : 0; k < 3; ++k) {
    require(low[k] <= high[k], "color.low", "no channel above high, which is " + text(high) + " (only a hue wraps around)",
            text(low));
  }
}

}  // namespace flockstep
