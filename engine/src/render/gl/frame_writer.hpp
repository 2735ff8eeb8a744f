// Writing the pixels of an atlas into frames, in the layout the camera asks for.
#pragma once

#include <cstddef>

#include "render/gl/atlas.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

// Which part of a frame a tile of the atlas holds: all of it, unless the picture is larger than what can be drawn at once.
struct FramePart {
  std::size_t request = 0;
  int left = 0, top = 0;      // px
  int width = 0, height = 0;  // px, at most the tile's
};

// Writes this part of every image that the frame has.
void write_frame(const Pixels& pixels, const AtlasSize& size, std::size_t tile, const RenderRequest& request,
                 const FramePart& part);

}  // namespace flockstep::render
