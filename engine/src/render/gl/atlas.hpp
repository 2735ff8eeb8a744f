// GlAtlas: images of one size, stacked vertically in textures. GlReadback: the memory that they are copied back to.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "render/gl/objects.hpp"
#include "render/gl/shaders.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

struct AtlasSize {
  int width = 0;   // px, per tile
  int height = 0;  // px, per tile
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

  void clear() const;  // to 0, which means that nothing was hit

 private:
  AtlasSize size_;
  Attachments attachments_;
  std::array<GlObject, 3> textures_;  // indexed by attachment number
  GlObject depth_;
  GlObject framebuffer_;
};

// Data read back from one atlas, row by row and tile by tile. A pointer is null if the atlas lacks that attachment.
struct AtlasPixels {
  const std::uint8_t* color = nullptr;  // RGBA
  const float* depth = nullptr;         // raw values of the depth buffer; see shaders.cpp
  const std::uint16_t* ids = nullptr;   // semantic, instance
  const float* normal = nullptr;        // x, y, z, unused
};

// Copies an atlas to memory. On a hardware device, the copy overlaps with further drawing.
class GlReadback {
 public:
  explicit GlReadback(bool is_software) : is_software_(is_software) {}
  ~GlReadback();
  GlReadback(const GlReadback&) = delete;
  GlReadback& operator=(const GlReadback&) = delete;

  void start(const GlAtlas& atlas, int tiles);  // copies the first `tiles` tiles
  void finish();                                // throws GlUnavailable
  const AtlasPixels& pixels() const { return pixels_; }

 private:
  void reserve(std::size_t bytes);

  bool is_software_;
  std::vector<std::byte> memory_;  // used on a software device
  GlObject buffer_;                // used on a hardware device, mapped at mapped_
  std::byte* mapped_ = nullptr;
  std::size_t capacity_ = 0;  // bytes
  GLsync fence_ = nullptr;
  AtlasPixels pixels_;
};

// --- from the atlas to frames, in the layout of the camera

// The part of a frame that one tile of the atlas holds: the whole frame, unless it is too large to be drawn at once.
struct FramePart {
  std::size_t request = 0;
  int left = 0, top = 0;      // px
  int width = 0, height = 0;  // px, at most the size of a tile
};

// Writes this part of every image in the frame.
void write_frame(const AtlasPixels& pixels, const AtlasSize& size, std::size_t tile, const RenderRequest& request,
                 const FramePart& part);

}  // namespace flockstep::render
