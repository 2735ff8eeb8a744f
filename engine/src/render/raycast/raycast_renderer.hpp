// Raycast renderer: renders images with the engine's own ray tracing.
#pragma once

#include <cstddef>

#include "render/raycast/shaded_bodies.hpp"
#include "render/raycast/shading.hpp"
#include "render/raycast/soft_light.hpp"
#include "render/render_request.hpp"
#include "trace/tracer.hpp"

namespace flockstep::render {

// Working memory of one rendering thread, created once.
struct RaycastScratch {
  trace::Tracer tracer;
  ShadedBodies bodies;
  Casters casters;  // used if the frame has shadows
  TilePixels pixels;
  alignas(64) std::uint8_t shaded[TilePixels::kCount];
  SoftLight soft;                                         // used if the camera has_soft_light()
  TilePixels facing;                                      // normals of the surfaces that ambient light falls on
  alignas(64) std::uint16_t sums[3][TilePixels::kCount];  // sums of r, g and b over the samples
  alignas(64) trace::RayFloats ones;                      // x of all ray directions
  alignas(64) trace::RayFloats ahead, left, up;           // directions of refined pixels' samples
  TilePixels refined;                                     // colours of a tile with refined pixels

  RaycastScratch();
};

// Renders tiles [first, last) of the request's image into its frame. The value of a pixel depends only on the
// request.
void render_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch);

// Takes all samples of the pixels around which the colours differ; call it after render_tiles() for all tiles of the image.
void refine_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch);

// Writes the pixels of a tile into a frame, in the layout of the camera.
void write_tile(const TilePixels& pixels, const PixelTile& tile, const CameraConfig& camera, const RenderTargets& frame);

}  // namespace flockstep::render
