#include "base/srgb.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace flockstep {
// Source: IEC 61966-2-1
float linear_of_srgb(double value) {
  return static_cast<float>(value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4));
}

const std::array<float, 256>& srgb_to_linear() {
  static const std::array<float, 256> levels = [] {
    std::array<float, 256> table;
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = linear_of_srgb(static_cast<double>(i) / 255.0);
    return table;
  }();
  return levels;
}

std::uint8_t linear_to_srgb(float linear) {
  static const std::array<float, 255> ends = [] {  // upper ends of the linear intervals of the bytes
    std::array<float, 255> table;
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = linear_of_srgb((static_cast<double>(i) + 0.5) / 255.0);
    return table;
  }();
  return static_cast<std::uint8_t>(std::upper_bound(ends.begin(), ends.end(), linear) - ends.begin());
}

}  // namespace flockstep
