// Swatches: one image that all furniture shares. Its upper part has columns of one colour each, from bright to dark, so that a
// vertex may be shaded as it stands; below are patches: wood, cardboard, screens, paintings.
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
  // Patches of a material, cut to the size of a face.
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

// Where a swatch lies in the image. Of a colour, s is its column and t goes from bright to dark.
struct SwatchArea {
  std::array<double, 2> from, to;  // (s, t) of the upper left and the lower right corner
  double width_m = 0.0;            // of a material: how wide the patch is; 0: stretched over a face
};

SwatchArea area(Swatch swatch);

// The image, drawn from a seed; purpose as of Draws.
std::uint16_t swatch_texture(WorldBuilder& builder, std::uint32_t purpose, std::uint64_t seed);

}  // namespace flockstep::indoors
