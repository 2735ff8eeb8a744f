// Decodes untrusted PNG and JPEG images into the pixels of a texture, and encodes PNG.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace flockstep {

struct Image {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> rgba;  // rows from top to bottom: 4 width_px height_px bytes
};

// Limit for all images of a scene together: one with sides of kMaxTexturePx, or many smaller ones. This is a gigabyte as rgba.
inline constexpr std::size_t kMaxScenePixels = std::size_t{1} << 28;

// Decodes a PNG or JPEG file, recognized by its first bytes. Grey, palette and 16-bit images become 8 bits of red, green, blue
// and alpha; colour space information is ignored. The header is checked before decoding: sides are at most kMaxTexturePx, and
// the number of pixels is at most max_pixels.
// Throws std::invalid_argument that names the source, also for truncated or damaged files.
Image decode_image(std::span<const std::uint8_t> file, const std::string& source, std::size_t max_pixels = kMaxScenePixels);

// Returns a PNG file that decode_image() reads back equal, including the colours of transparent pixels.
std::string encode_png(int width_px, int height_px, std::span<const std::uint8_t> rgba);

}  // namespace flockstep
