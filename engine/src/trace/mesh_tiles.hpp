// Tracing tiles of rays at triangles: what rays of one origin have in common is done once for all of them.
//
// A ray of a tile is (1, u, v) in the tile's frame, so the whole tile is a picture, and a triangle, once it is turned into that
// frame, is three edges and a depth in it, all of them linear in u and v: a test is multiplications and additions for whole
// vectors of rays. A tile goes through the tree once, near things first, and leaves out boxes that lie outside of it or behind
// all that its rays have hit so far; so do its sub-tiles of 4 x 4 rays.
//
// A ray's result has the same bits on every target, whatever rays are beside it; it depends on the frame, the origin, the ray,
// and the triangles:
// - Whether a ray hits a triangle does not depend on how it came there. The corners are rounded into the tile's frame, each for
//   itself, so that triangles which share a corner still do. From there on the answer is exact: where the sign of an edge might
//   be rounding, a test in double precision that is exact decides (see crosses_exactly). So no ray slips between triangles
//   that share an edge or a corner.
// - The distance is computed from the triangle and the ray alone, and lies between those of the triangle's nearest and farthest
//   corner.
// - Boxes are left out only where no triangle in them can be hit, or only beyond what was hit: each box is widened by more than
//   the rounding of a corner, each rectangle by more than the rounding of a quotient.
// - Of hits at the same distance, the triangle with the lowest number counts.
// - Where a triangle is seen through by its mask, it is not hit.
#pragma once

#include <cstddef>
#include <cstdint>

#include "trace/masks.hpp"
#include "trace/mesh_tree.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// One coordinate of the rays of a tile in its picture, sub-tile by sub-tile. It belongs to the sensor and is computed once.
struct TileAxis {
  alignas(64) float of_ray[kMaxRays];
  alignas(64) float ends[2][16];  // least and most of each sub-tile
  float least_of_all, most_of_all;

  // Sub-tile k is that of row k / 4 and column k % 4; its rays lie together, row by row.
  static std::size_t place(std::size_t row, std::size_t column) {
    return 64 * (row / 4) + 16 * (column / 4) + 4 * (row % 4) + column % 4;
  }
};
TileAxis make_tile_axis(const float* rows);  // (kMaxRays,) rows of 16

// Takes what the tree has nearer than the rays' t_hit and element, or all it has if the rays have no_hits_yet; a hit gets the
// element first_element + its triangle. The rays are rows of 16 and have the directions (1, u, v); u and v are of 16 rows, those
// that are beyond the rays' count near the others. details: of the hits taken, null where nobody asks; weights only where the
// tree says that they matter. masks: what the rays pass through, null where nothing. Call under FlushDenormals.
void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, const TileAxis& u, const TileAxis& v, RayBundle& rays,
                     HitDetails* details, AskedDetails asked, const Masks* masks = nullptr);

}  // namespace flockstep::trace
