// Writes the pixels of a tile into a frame, in the layout of the camera.
#pragma once

#include "render/raycast/shading.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

void write_tile(const TilePixels& pixels, const PixelTile& tile, const CameraConfig& camera, const Frame& frame);

}  // namespace flockstep::render
