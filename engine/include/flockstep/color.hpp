// ColorRange: which colours count, for tasks and users that look for something in a camera's image.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

// What the three channels of a ColorRange are. All are 8 bits, computed from a pixel as it is written (gamma applied).
enum class ColorSpace : std::uint8_t {
  rgb,     // red, green, blue
  hsv,     // hue in [0, 179] (degrees / 2; red 0, green 60, blue 120), saturation and value in [0, 255]: CameraImages::hsv
  excess,  // by how much red, green and blue each exceed 1.25 times the larger of the other two, rounded up; 0 if they do not.
           // Brighter light scales all channels alike, so this finds a hue in most light
};
template <>
struct EnumNames<ColorSpace> {
  static constexpr std::array kNames{"rgb", "hsv", "excess"};
};

// A pixel counts if each of its channels is in [low, high], both ends included. By default, green as the goal is.
struct ColorRange {
  ColorSpace space = ColorSpace::excess;
  std::array<int, 3> low{0, 17, 0};        // in [0, 255]
  std::array<int, 3> high{255, 255, 255};  // in [0, 255], >= low; a hue whose low exceeds its high wraps around through red

  static constexpr auto fields() {
    using C = ColorRange;
    return field_list(field("space", &C::space), field("low", &C::low), field("high", &C::high));
  }

  bool operator==(const ColorRange&) const = default;

  void validate() const;  // throws std::invalid_argument
};

}  // namespace flockstep
