#include "render/pinhole_camera.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "trace/ray_block.hpp"

namespace flockstep::render {
namespace {

constexpr std::size_t kPixels = PixelTile::kSide * PixelTile::kSide;  // pixels per tile

// Returns the slopes (centre - (i + place)) / focal for the pixels i of every tile along one side of the image. Each tile
// gets a value for each of its pixels; along(pixel) is the position of a pixel along that side.
template <class Along>
std::vector<float> slopes(int pixels, float centre, float focal, double place, const Along& along) {
  const std::size_t tiles = (static_cast<std::size_t>(pixels) + PixelTile::kSide - 1) / PixelTile::kSide;
  std::vector<float> result(tiles * kPixels + trace::kRayPadding);
  for (std::size_t i = 0; i < tiles * kPixels; ++i) {
    const auto pixel = static_cast<double>(i / kPixels * PixelTile::kSide + along(i % kPixels));
    result[i] = static_cast<float>((static_cast<double>(centre) - (pixel + place)) / static_cast<double>(focal));
  }
  return result;
}

std::vector<trace::TileAxis> axes(const std::vector<float>& slopes) {
  std::vector<trace::TileAxis> result;
  for (std::size_t first = 0; first + kPixels <= slopes.size(); first += kPixels) {
    result.push_back(trace::make_tile_axis(&slopes[first]));
  }
  return result;
}

}  // namespace

PinholeCamera make_pinhole_camera(const CameraConfig& camera) {
  PinholeCamera pinhole{.fx = camera.fx(),
                        .fy = camera.fy(),
                        .cx = 0.5F * static_cast<float>(camera.width_px),
                        .cy = 0.5F * static_cast<float>(camera.height_px),
                        .grids = {},
                        .tiles = {},
                        .corner = 0.0F};
  const auto add_grid = [&](double left, double up) {
    PinholeCamera::Grid grid{
        slopes(camera.width_px, pinhole.cx, pinhole.fx, left, [](std::size_t pixel) { return pixel % PixelTile::kSide; }),
        slopes(camera.height_px, pinhole.cy, pinhole.fy, up, [](std::size_t pixel) { return pixel / PixelTile::kSide; }),
        {},
        {}};
    grid.columns = axes(grid.left);
    grid.rows = axes(grid.up);
    pinhole.grids.push_back(std::move(grid));
  };
  add_grid(0.5, 0.5);
  const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(camera.samples_per_pixel))));
  for (int row = 0; side > 1 && row < side; ++row) {
    for (int column = 0; column < side; ++column) add_grid((column + 0.5) / side, (row + 0.5) / side);
  }
  const auto width = static_cast<std::size_t>(camera.width_px);
  const auto height = static_cast<std::size_t>(camera.height_px);
  // Padding rays of a tile at the border point past the image; the frustum of the tile contains them as well.
  for (std::size_t row = 0; row < height; row += PixelTile::kSide) {
    for (std::size_t column = 0; column < width; column += PixelTile::kSide) {
      const auto edge = [](float centre, std::size_t pixel, float focal) { return (centre - static_cast<float>(pixel)) / focal; };
      pinhole.tiles.push_back(
          {column, row, std::min(PixelTile::kSide, width - column), std::min(PixelTile::kSide, height - row),
           trace::make_pyramid(edge(pinhole.cx, column + PixelTile::kSide, pinhole.fx), edge(pinhole.cx, column, pinhole.fx),
                               edge(pinhole.cy, row + PixelTile::kSide, pinhole.fy), edge(pinhole.cy, row, pinhole.fy))});
    }
  }
  const auto past_end = [](std::size_t pixels) {
    return static_cast<double>((pixels + PixelTile::kSide - 1) / PixelTile::kSide * PixelTile::kSide);
  };
  const double right = past_end(width) - static_cast<double>(pinhole.cx);
  const double down = past_end(height) - static_cast<double>(pinhole.cy);
  pinhole.corner =
      static_cast<float>(std::hypot(1.0, right / static_cast<double>(pinhole.fx), down / static_cast<double>(pinhole.fy)));
  return pinhole;
}

}  // namespace flockstep::render
