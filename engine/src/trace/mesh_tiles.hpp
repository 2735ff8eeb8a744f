// Traces tiles of rays against triangles. The work that rays of one origin share is done once for all of them.
//
// A ray of a tile is (1, u, v) in the tile's frame, so the tile is a picture. In that frame a triangle becomes three edges and
// an inverse depth, all linear in u and v. A test is therefore only multiplications and additions on whole vectors of rays. A
// tile traverses the tree once, nearest nodes first. It skips boxes outside the tile and boxes beyond the farthest hit of its
// rays. Its sub-tiles of 4 x 4 rays skip boxes by the same tests.
//
// A ray's result has the same bits on every target and beside any other rays. It depends only on the frame, the origin, the ray
// and the triangles:
// - The path through the tree does not affect whether a ray hits a triangle. Each corner is rounded into the tile's frame on
//   its own, so triangles that share a corner still share it afterwards. From there on the test is exact: if rounding could
//   change the sign of an edge, an exact test in double precision decides (see crosses_exactly). Therefore no ray slips between
//   triangles that share an edge or a corner.
// - The distance is computed only from the triangle and the ray, and lies between the distances of the triangle's nearest and
//   farthest corner.
// - A box is skipped only if none of its triangles can be hit, or only beyond the current hit. Each box is widened by more than
//   the rounding error of a corner, each rectangle by more than the rounding error of a quotient.
// - Of hits at the same distance, the triangle with the lowest number wins.
// - A ray does not hit a triangle at a point that its mask makes transparent.
#pragma once

#include <cstddef>
#include <cstdint>

#include "trace/masks.hpp"
#include "trace/mesh_tree.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// One coordinate (u or v) of a tile's rays, ordered by sub-tile. It belongs to the sensor and is computed once.
struct TileAxis {
  alignas(64) float of_ray[kMaxRays];
  alignas(64) float ends[2][16];  // minimum and maximum of each sub-tile
  float least_of_all, most_of_all;

  // Sub-tile k has row k / 4 and column k % 4. Its rays are contiguous, row by row.
  static std::size_t place(std::size_t row, std::size_t column) {
    return 64 * (row / 4) + 16 * (column / 4) + 4 * (row % 4) + column % 4;
  }
};
TileAxis make_tile_axis(const float* rows);  // (kMaxRays,) rows of 16

// Keeps hits that are nearer than the rays' t_hit, or all hits if the rays have no_hits_yet. A hit gets the element
// first_element + its triangle. The rays are rows of 16 with the directions (1, u, v). u and v always have 16 rows; in rows
// beyond the rays' count their values are near the others. details: receives the details of these hits; may be null. It
// receives weights only if the tree needs them. masks: the masks that the rays pass through, or null. Call under
// FlushDenormals.
void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, const TileAxis& u, const TileAxis& v, RayBundle& rays,
                     HitDetails* details, AskedDetails asked, const Masks* masks = nullptr);

}  // namespace flockstep::trace
