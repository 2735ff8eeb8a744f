// Textures: the images of a world with their mip levels, as both backends read them.
//
// A backend looks a texture up at (s, t) by the mean of the two levels nearest to the level of detail, each by the mean of the
// four texels around. With t4 = the texels that a square metre of the surface shows, a pixel of width p at planar depth 1, a ray
// d of length 1 along the optical axis that meets the surface, whose unit normal is n, at planar depth z, the level of detail is
// log2(sqrt(t4) p z |d| / |n . d|): one texel a pixel, along the longer side of what the pixel covers. log2 is a straight line
// between powers of two, off by 0.09 at most, so that every processor computes the same.
//
// A texel of a level is the mean of those it covers of the level before. Where things are seen through by a texture, each counts
// as much as its alpha, so that what is cut away gives no colour to what is left.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::render {

// Whether levels have a border of one texel about them, which is what the texture shows beyond its edge as it wraps: then the
// four texels around a place are always two pairs of neighbours in memory.
enum class Border : bool { no, yes };

struct Textures {
  // masked: which of them something is seen through by, if any.
  // Throws std::invalid_argument where they have too many texels to be numbered.
  explicit Textures(std::span<const Texture> textures, const std::vector<bool>& masked = {}, Border border = Border::no);
  explicit Textures(const World& world, Border border = Border::no);

  bool empty() const { return first_level.empty(); }

  std::vector<std::uint32_t> texels;  // red, green, blue in sRGB and alpha from the lowest byte on; level by level, row by row
  // Of each texture.
  std::vector<std::int32_t> first_level, num_levels;
  std::vector<std::int32_t> wrap_across, wrap_down;  // TextureWrap
  // Of each level, the largest first: its first texel, its size, and how far apart its rows are. The last one is a single texel.
  std::vector<std::int32_t> offset, width, height, stride;
};

// Texels to a square metre of each triangle, squared texels a metre; 0 where its material has no texture. Empty where none has.
std::vector<float> texels_per_square_metre(const World& world);

}  // namespace flockstep::render
