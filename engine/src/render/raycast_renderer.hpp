// Raycast renderer: pictures by the engine's own tracing.
#pragma once

#include <cstddef>

#include "render/shading.hpp"
#include "render/shot.hpp"
#include "trace/scene.hpp"

namespace flockstep::render {

// What one thread needs while it renders; made once.
struct RaycastScratch {
  trace::RayBundle bundle;
  trace::FacetNormals normals;
  trace::Reach reach;
  trace::RayBlock block;
  TilePixels pixels;
  alignas(64) std::uint8_t shaded[TilePixels::kCount];
  alignas(64) std::uint16_t sums[3][TilePixels::kCount];  // of the samples' r, g and b
  alignas(64) trace::RayFloats ones;                      // x of all directions

  RaycastScratch();
};

// Renders tiles [first, last) of the shot's lens into its frame. A pixel's value depends on the shot alone.
void render_tiles(const Shot& shot, std::size_t first, std::size_t last, RaycastScratch& scratch);

}  // namespace flockstep::render
