// Raycast renderer: pictures by the engine's own tracing.
#pragma once

#include <cstddef>

#include "render/raycast/shading.hpp"
#include "render/render_request.hpp"
#include "trace/tracer.hpp"

namespace flockstep::render {

// What one thread needs while it renders; made once.
struct RaycastScratch {
  trace::Tracer tracer;
  TilePixels pixels;
  alignas(64) std::uint8_t shaded[TilePixels::kCount];
  alignas(64) std::uint16_t sums[3][TilePixels::kCount];  // of the samples' r, g and b
  alignas(64) trace::RayFloats ones;                      // x of all directions

  RaycastScratch();
};

// Renders tiles [first, last) of the request's pinhole into its frame. A pixel's value depends on the request alone.
void render_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch);

}  // namespace flockstep::render
