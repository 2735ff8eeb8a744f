// Writes the pixels of an atlas into frames, in the layout of the camera.
#pragma once

#include <cstddef>

#include "render/gl/atlas.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

// The part of a frame that one tile of the atlas holds: the whole frame, unless it is too large to be drawn at once.
struct FramePart {
  std::size_t request = 0;
  int left = 0, top = 0;      // px
  int width = 0, height = 0;  // px, at most the size of a tile
};

// Writes this part of every image in the frame.
void write_frame(const Pixels& pixels, const AtlasSize& size, std::size_t tile, const RenderRequest& request,
                 const FramePart& part);

}  // namespace flockstep::render
