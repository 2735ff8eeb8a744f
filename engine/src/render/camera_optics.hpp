// CameraOptics: the ray directions of all pixels.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "flockstep/config.hpp"
#include "render/lens.hpp"
#include "trace/frustum.hpp"
#include "trace/mesh_tiles.hpp"

namespace flockstep::render {

// A block of pixels that is traced together.
struct PixelTile {
  static constexpr std::size_t kSide = 16;  // pixels; one row is a vector of rays
  std::size_t column, row;                  // its first pixel, a multiple of kSide; any row with a rolling shutter
  std::size_t width, height;                // at most kSide
  std::size_t across, down;                 // numbers of its columns and rows in the arrays of a Grid
  std::size_t first = 0;                    // its first ray there
  trace::Frustum frustum;                   // camera frame
  float density;                            // pixels per unit of area, where directions end
};

// The pinhole model. The ray through pixel (u, v), counted from the upper left, has the direction (1, (cx - u - 1/2) / fx,
// (cy - v - 1/2) / fy) in the camera frame: x along the optical axis, y left, z up. Lengths along the ray are therefore
// planar depths.
//
// With a rolling shutter, each row of pixels has a pose of its own, and thus tiles of its own, one pixel high.
//
// A lens bends the rays: each tile has columns and rows of its own. The directions of a fisheye, some of which may point
// backwards, have length 1. Lengths along its rays are ranges.
struct CameraOptics {
  float fx, fy, cx, cy;      // px
  std::optional<Lens> lens;  // none for a plain pinhole
  // Ray directions through one point of every pixel. grids[0] holds the pixel centres. If a pixel has several samples, one
  // grid for each sample follows.
  struct Grid {
    std::vector<float> left;                     // (columns of tiles, kSide * kSide) y of the directions in a tile, row by row
    std::vector<float> up;                       // (rows of tiles, kSide * kSide) z of the directions
    std::vector<trace::TileAxis> columns, rows;  // left and up in the form of mesh_tiles.hpp; empty for a fisheye
    std::vector<float> ahead;                    // (tiles, kSide * kSide) x of the directions of a fisheye; otherwise 1
  };
  std::vector<Grid> grids;
  std::vector<PixelTile> tiles;  // row by row; each frustum contains all samples of its pixels
  float corner;                  // length of the longest direction
};

CameraOptics make_camera_optics(const CameraConfig& camera);

}  // namespace flockstep::render
