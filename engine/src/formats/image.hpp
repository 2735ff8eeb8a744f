// Images from outside: PNG and JPEG read with care into the pixels of a texture, and PNG written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace flockstep {

struct Image {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> rgba;  // row by row from the top: 4 width_px height_px bytes
};

// Of all images of a scene together: one of kMaxTexturePx to a side, or many smaller ones. A gigabyte as rgba.
inline constexpr std::size_t kMaxScenePixels = std::size_t{1} << 28;

// A PNG or JPEG file's pixels; which of the two it is, its first bytes tell. Grey, palettes and 16 bits come out as 8 bits of
// red, green, blue and alpha, and what a file says of its colour space is not asked. The header is looked at before anything is
// decoded: the sides are at most kMaxTexturePx, and the pixels at most max_pixels.
// Throws std::invalid_argument naming the source, also of a file that is cut short or damaged.
Image decode_image(std::span<const std::uint8_t> file, const std::string& source, std::size_t max_pixels = kMaxScenePixels);

// The bytes of a PNG file, which decode_image() reads back equal, the colours of transparent pixels included.
std::string encode_png(int width_px, int height_px, std::span<const std::uint8_t> rgba);

}  // namespace flockstep
