// Swatches: one texture shared by all furniture. Its upper part has one column per colour, from bright to dark, so that
// vertices can be shaded. Below are patches: wood, cardboard, screens, paintings.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/world_builder.hpp"

namespace flockstep::indoors {

enum class Swatch : std::uint8_t {
  // Colours.
  white,
  cream,
  light_grey,
  grey,
  dark_grey,
  black,
  steel,
  navy,
  blue,
  teal,
  leaf,
  moss,
  red,
  rust,
  orange,
  yellow,
  sand,
  brown,
  plum,
  // Material patches, cropped to the size of a face.
  oak,
  walnut,
  fabric,
  planks,
  // Pictures, stretched over a face.
  carton,
  carton_top,
  carton_plain,
  wrapped,
  keyboard,
  desktop,
  code,
  slides,
  whiteboard,
  rug,
  stripes,
  painting_a,
  painting_b,
  painting_c,
  painting_d,
  painting_e,
  count,
};

constexpr int kSwatchColors = static_cast<int>(Swatch::oak);

// The area of a swatch in the texture. For a colour, s is its column and t runs from bright to dark.
struct SwatchArea {
  std::array<double, 2> from, to;  // (s, t) of the upper left and lower right corners
  double width_m = 0.0;            // m, width of a material patch; 0 stretches it over the face
};

SwatchArea area(Swatch swatch);

// Draws the swatch texture. purpose and seed are keys of Draws.
std::uint16_t swatch_texture(WorldBuilder& builder, std::uint32_t purpose, std::uint64_t seed);

}  // namespace flockstep::indoors
