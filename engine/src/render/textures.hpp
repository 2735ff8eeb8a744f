// Textures: the images of a world with their mip levels, read by both backends.
//
// Textures are filtered trilinearly: a backend interpolates between the four texels around (s, t) in each of the two levels
// nearest to the level of detail, then between the two levels. The level of detail is log2(sqrt(t4) p z |d| / |n . d|). Here
// t4 is the number of texels that a square metre of the surface shows, p the width of a pixel at planar depth 1, d the ray
// direction with length 1 along the optical axis, z the planar depth of the hit, and n the unit normal of the surface. This
// yields one texel per pixel along the longer side of the area that the pixel covers. log2 is approximated by straight lines
// between powers of two, with an error of at most 0.09, so that every processor computes the same result.
//
// Each texel of a level is the mean of the texels that it covers in the previous level. In a texture that makes things
// transparent, each texel is weighted by its alpha, so that invisible parts do not affect the colour of visible ones.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::render {

// Each level has a border of one texel. It continues the texture beyond its edge according to its wrap mode, so the four texels
// around a position are always two pairs of neighbours in memory.
struct Textures {
  // masked: one flag per texture, true if it makes something transparent; empty if none does. Throws std::invalid_argument if
  // there are too many texels to be numbered.
  explicit Textures(std::span<const Texture> textures, const std::vector<bool>& masked = {});
  explicit Textures(const World& world);

  bool empty() const { return first_level.empty(); }

  std::vector<std::uint32_t> texels;  // sRGB red, green, blue, then alpha, from the lowest byte on; level by level, row by row
  // One per texture.
  std::vector<std::int32_t> first_level, num_levels;
  std::vector<std::int32_t> wrap_across, wrap_down;  // TextureWrap
  // One per level, largest first: its first texel within the border, its size, and the distance between its rows. The last level
  // is a single texel.
  std::vector<std::int32_t> offset, width, height, stride;
};

// Returns the texels per square metre of each triangle; 0 if its material has no texture. Empty if no material has one.
std::vector<float> texels_per_square_metre(const World& world);

}  // namespace flockstep::render
