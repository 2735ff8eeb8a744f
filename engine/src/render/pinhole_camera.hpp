// PinholeCamera: which way each pixel looks.
#pragma once

#include <cstddef>
#include <vector>

#include "flockstep/config.hpp"
#include "trace/frustum.hpp"
#include "trace/mesh_tiles.hpp"

namespace flockstep::render {

// A block of pixels that is traced at once.
struct PixelTile {
  static constexpr std::size_t kSide = 16;  // pixels; a row of it is a vector of rays
  std::size_t column, row;                  // of its first pixel, a multiple of kSide
  std::size_t width, height;                // at most kSide
  trace::Frustum frustum;                   // camera frame
};

// The pinhole model. The ray through pixel (u, v), counted from the upper left, has the direction
// (1, (cx - u - 1/2) / fx, (cy - v - 1/2) / fy) in the camera's frame (x along the optical axis, y left, z up), so that lengths
// along it are planar depths.
struct PinholeCamera {
  float fx, fy, cx, cy;  // px
  // The directions through one point of every pixel. grids[0] is for the centres; where a pixel has several samples, a grid for
  // each of them follows.
  struct Grid {
    std::vector<float> left;  // (columns of tiles, kSide * kSide) y of the directions of a tile's pixels, row by row
    std::vector<float> up;    // (rows of tiles, kSide * kSide) z, likewise
    std::vector<trace::TileAxis> columns, rows;  // the same as mesh_tiles.hpp takes it
  };
  std::vector<Grid> grids;
  std::vector<PixelTile> tiles;  // row by row; the frustum of each holds all samples of its pixels
  float corner;                  // length of the longest direction
};

PinholeCamera make_pinhole_camera(const CameraConfig& camera);

}  // namespace flockstep::render
