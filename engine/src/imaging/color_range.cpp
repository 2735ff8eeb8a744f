#include <cstddef>
#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/color.hpp"

namespace flockstep {

void ColorRange::validate() const {
  const auto text = [](const std::array<int, 3>& values) {
    return "(" + std::to_string(values[0]) + ", " + std::to_string(values[1]) + ", " + std::to_string(values[2]) + ")";
  };
  check_fields(*this, "color.");
  for (std::size_t k = space == ColorSpace::hsv ? 1 : 0; k < 3; ++k) {
    require(low[k] <= high[k], "color.low", "no channel above high, which is " + text(high) + " (only a hue wraps around)",
            text(low));
  }
}

}  // namespace flockstep
