// PinholeCamera: the ray directions of all pixels.
#pragma once

#include <cstddef>
#include <vector>

#include "flockstep/config.hpp"
#include "trace/frustum.hpp"
#include "trace/mesh_tiles.hpp"

namespace flockstep::render {

// A block of pixels that is traced together.
struct PixelTile {
  static constexpr std::size_t kSide = 16;  // pixels; one row is a vector of rays
  std::size_t column, row;                  // its first pixel, a multiple of kSide
  std::size_t width, height;                // at most kSide
  trace::Frustum frustum;                   // camera frame
};

// The pinhole model. The ray through pixel (u, v), counted from the upper left, has the direction (1, (cx - u - 1/2) / fx,
// (cy - v - 1/2) / fy) in the camera frame: x along the optical axis, y left, z up. Lengths along the ray are therefore
// planar depths.
struct PinholeCamera {
  float fx, fy, cx, cy;  // px
  // Ray directions through one point of every pixel. grids[0] holds the pixel centres. If a pixel has several samples, one
  // grid for each sample follows.
  struct Grid {
    std::vector<float> left;                     // (columns of tiles, kSide * kSide) y of the directions in a tile, row by row
    std::vector<float> up;                       // (rows of tiles, kSide * kSide) z of the directions
    std::vector<trace::TileAxis> columns, rows;  // left and up in the form of mesh_tiles.hpp
  };
  std::vector<Grid> grids;
  std::vector<PixelTile> tiles;  // row by row; each frustum contains all samples of its pixels
  float corner;                  // length of the longest direction
};

PinholeCamera make_pinhole_camera(const CameraConfig& camera);

}  // namespace flockstep::render
