// GlAtlas: pictures of one size above each other in textures, and the memory they are read back into.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "render/gl/objects.hpp"
#include "render/gl/shaders.hpp"

namespace flockstep::render {

struct AtlasSize {
  int width = 0;   // px, of a tile
  int height = 0;  // px, of a tile
  int tiles = 0;

  bool operator==(const AtlasSize&) const = default;
  std::size_t pixels() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(tiles);
  }
};

class GlAtlas {
 public:
  GlAtlas(const AtlasSize& size, const Attachments& attachments);  // throws GlUnavailable

  const AtlasSize& size() const { return size_; }
  const Attachments& attachments() const { return attachments_; }
  GLuint framebuffer() const { return framebuffer_.name(); }
  GLuint color() const { return textures_[0].name(); }

  // Sets the depth buffer and these attachments to 0, which stands for nothing seen.
  void clear(const Attachments& which) const;

 private:
  AtlasSize size_;
  Attachments attachments_;
  std::array<GlTexture, 3> textures_;  // as attachments are numbered
  GlTexture depth_;
  GlFramebuffer framebuffer_;
};

// What was read from one atlas, row by row and tile by tile; null where the atlas lacks it.
struct Pixels {
  const std::uint8_t* color = nullptr;  // RGBA
  const float* depth = nullptr;         // as the depth buffer has it: see gl_shaders.cpp
  const std::uint16_t* ids = nullptr;   // semantic, instance
  const float* normal = nullptr;        // x, y, z, unused
};

// Copies an atlas to memory. On hardware the copy runs while something else is drawn.
class GlReadback {
 public:
  explicit GlReadback(bool is_software) : is_software_(is_software) {}
  ~GlReadback();
  GlReadback(const GlReadback&) = delete;
  GlReadback& operator=(const GlReadback&) = delete;

  void start(const GlAtlas& atlas, int tiles);  // copies the first ones
  void finish();                                // throws GlUnavailable
  const Pixels& pixels() const { return pixels_; }

 private:
  void reserve(std::size_t bytes);

  bool is_software_;
  std::vector<std::byte> memory_;  // on a software device
  GlBuffer buffer_;                // on a hardware one, and where it is mapped
  std::byte* mapped_ = nullptr;
  std::size_t capacity_ = 0;  // bytes
  GLsync fence_ = nullptr;
  Pixels pixels_;
};

}  // namespace flockstep::render
