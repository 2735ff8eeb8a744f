// ColorRange: a range of colours, for tasks and users that search camera images for a colour.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// The three channels of a ColorRange, 8 bits each.
enum class ColorSpace : std::uint8_t { rgb, hsv, excess };
template <>
struct EnumNames<ColorSpace> {
  static constexpr std::array kNames{"rgb", "hsv", "excess"};
};

// A pixel matches if each of its channels is in [low, high], both ends included. The default matches the green of the goal.
struct ColorRange {
  ColorSpace space = ColorSpace::excess;
  std::array<int, 3> low{0, 17, 0};
  std::array<int, 3> high{255, 255, 255};

  static constexpr auto fields() {
    using C = ColorRange;
    return field_list(
        field(
            "space", &C::space,
            {.about = "Channels, 8 bits each, of a pixel as written. ``\"rgb\"``: red, green, blue. ``\"hsv\"``: hue in [0, "
                      "179], half of the degrees (red 0, green 60, blue 120), saturation and value in [0, 255]. ``\"excess\"``: "
                      "by how much red, green and blue each exceed 1.25 times the larger of the other two, rounded up, at least "
                      "0. It finds a hue in most light, which scales the channels equally: ``low=(17, 0, 0)`` is red."}),
        field("low", &C::low, {.about = "Minimum of each channel.", .limits = between(0, 255)}),
        field("high", &C::high,
              {.about = "Maximum of each channel, at least ``low``. A hue wraps around: from 170 to 10 is red.",
               .limits = between(0, 255)}));
  }

  bool operator==(const ColorRange&) const = default;

  FLOCKSTEP_API void validate() const;  // throws std::invalid_argument
};

}  // namespace flockstep
