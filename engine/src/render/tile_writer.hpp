// Writing the pixels of a tile into a frame, in the layout the camera asks for.
#pragma once

#include "render/shading.hpp"
#include "render/shot.hpp"

namespace flockstep::render {

void write_tile(const TilePixels& pixels, const Tile& tile, const CameraConfig& camera, const Frame& frame);

}  // namespace flockstep::render
