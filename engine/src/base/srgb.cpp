#include "base/srgb.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

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

namespace {

// Upper ends of the linear intervals of the bytes: a value at an end belongs to the next byte.
struct Ends {
  // Floats in [kMin, 1) in groups of 128 to each power of two. Every end is in this range, and few are in one group.
  static constexpr float kMin = 0x1p-13F;
  static constexpr unsigned int kShift = 16;
  static std::uint32_t group(float linear) { return std::bit_cast<std::uint32_t>(linear) >> kShift; }

  std::array<float, 256> table;        // the last end is infinite
  std::vector<std::uint8_t> first_in;  // per group from that of kMin: the byte of its least value

  Ends() {
    for (std::size_t i = 0; i < 255; ++i) table[i] = linear_of_srgb((static_cast<double>(i) + 0.5) / 255.0);
    table[255] = std::numeric_limits<float>::infinity();
    for (std::uint32_t i = group(kMin); i < group(1.0F); ++i) {
      const auto least = std::bit_cast<float>(i << kShift);
      first_in.push_back(static_cast<std::uint8_t>(std::upper_bound(table.begin(), table.end(), least) - table.begin()));
    }
  }
};

}  // namespace

std::uint8_t linear_to_srgb(float linear) {
  static const Ends ends;
  if (linear < Ends::kMin) return 0;
  if (!(linear < 1.0F)) return 255;  // also NaN
  std::size_t byte = ends.first_in[Ends::group(linear) - Ends::group(Ends::kMin)];
  while (linear >= ends.table[byte]) ++byte;
  return static_cast<std::uint8_t>(byte);
}

}  // namespace flockstep
