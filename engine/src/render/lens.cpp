#include "render/lens.hpp"

#include <algorithm>
#include <cmath>

#include "trace/ray_block.hpp"

namespace flockstep::render {
namespace {

// The slopes (centre - (i + place)) / focal of the pixels of every tile along one side of the image, for all pixels of a tile,
// whose place along that side is `along(pixel)`.
template <class Along>
std::vector<float> slopes(int pixels, float centre, float focal, double place, const Along& along) {
  constexpr std::size_t kCount = Tile::kSide * Tile::kSide;
  const std::size_t tiles = (static_cast<std::size_t>(pixels) + Tile::kSide - 1) / Tile::kSide;
  std::vector<float> result(tiles * kCount + trace::kRayPadding);
  for (std::size_t i = 0; i < tiles * kCount; ++i) {
    const auto pixel = static_cast<double>(i / kCount * Tile::kSide + along(i % kCount));
    result[i] = static_cast<float>((static_cast<double>(centre) - (pixel + place)) / static_cast<double>(focal));
  }
  return result;
}

}  // namespace

Lens make_lens(const CameraConfig& camera) {
  Lens lens{.fx = camera.fx(),
            .fy = camera.fy(),
            .cx = 0.5F * static_cast<float>(camera.width_px),
            .cy = 0.5F * static_cast<float>(camera.height_px),
            .grids = {},
            .tiles = {},
            .corner = 0.0F};
  const auto add_grid = [&](double left, double up) {
    lens.grids.push_back({slopes(camera.width_px, lens.cx, lens.fx, left, [](std::size_t pixel) { return pixel % Tile::kSide; }),
                          slopes(camera.height_px, lens.cy, lens.fy, up, [](std::size_t pixel) { return pixel / Tile::kSide; })});
  };
  add_grid(0.5, 0.5);
  const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(camera.samples_per_pixel))));
  for (int row = 0; side > 1 && row < side; ++row) {
    for (int column = 0; column < side; ++column) add_grid((column + 0.5) / side, (row + 0.5) / side);
  }
  const auto width = static_cast<std::size_t>(camera.width_px);
  const auto height = static_cast<std::size_t>(camera.height_px);
  // The padded rays of a tile at the border look past the image; its view holds them too.
  for (std::size_t row = 0; row < height; row += Tile::kSide) {
    for (std::size_t column = 0; column < width; column += Tile::kSide) {
      const auto edge = [](float centre, std::size_t pixel, float focal) { return (centre - static_cast<float>(pixel)) / focal; };
      lens.tiles.push_back({column, row, std::min(Tile::kSide, width - column), std::min(Tile::kSide, height - row),
                            trace::make_pyramid(edge(lens.cx, column + Tile::kSide, lens.fx), edge(lens.cx, column, lens.fx),
                                                edge(lens.cy, row + Tile::kSide, lens.fy), edge(lens.cy, row, lens.fy))});
    }
  }
  const auto past_end = [](std::size_t pixels) {
    return static_cast<double>((pixels + Tile::kSide - 1) / Tile::kSide * Tile::kSide);
  };
  const double right = past_end(width) - static_cast<double>(lens.cx);
  const double down = past_end(height) - static_cast<double>(lens.cy);
  lens.corner = static_cast<float>(std::hypot(1.0, right / static_cast<double>(lens.fx), down / static_cast<double>(lens.fy)));
  return lens;
}

}  // namespace flockstep::render
