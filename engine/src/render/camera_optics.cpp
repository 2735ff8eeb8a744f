#include "render/camera_optics.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "trace/ray_block.hpp"

namespace flockstep::render {
namespace {

constexpr std::size_t kPixels = PixelTile::kSide * PixelTile::kSide;  // pixels per tile
// Floats after the last tile: packets read 4 rows of it, even if it has one.
constexpr std::size_t kPadding = 3 * PixelTile::kSide + trace::kRayPadding;

// Returns the slopes (centre - (i + place)) / focal for the pixels i of every tile along one side of the image. Each tile
// gets a value for each of its pixels; along(pixel) is the position of a pixel along that side.
template <class Along>
std::vector<float> slopes(int pixels, float centre, float focal, double place, const Along& along) {
  const std::size_t tiles = (static_cast<std::size_t>(pixels) + PixelTile::kSide - 1) / PixelTile::kSide;
  std::vector<float> result(tiles * kPixels + kPadding);
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

// Returns the positions of the samples in a pixel, from its upper left corner: the centre, then those that are averaged.
std::vector<Lens::Point> sample_places(int samples_per_pixel) {
  std::vector<Lens::Point> places{{0.5, 0.5}};
  const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(samples_per_pixel))));
  for (int row = 0; side > 1 && row < side; ++row) {
    for (int column = 0; column < side; ++column) places.emplace_back((column + 0.5) / side, (row + 0.5) / side);
  }
  return places;
}

// Fills in the grids and tiles of a camera with a lens.
class LensTable {
 public:
  LensTable(const CameraConfig& camera, CameraOptics& optics) : camera_(camera), optics_(optics) {}

  void make() {
    for (const Lens::Point& place : sample_places(camera_.samples_per_pixel)) add_grid(place);
    for (PixelTile& tile : optics_.tiles) set_bounds(tile);
  }

 private:
  // Returns the ideal point of a point of the image in pixels. Inverting begins at the last one, which is near.
  Lens::Point ideal(double u, double v) {
    const Lens::Point image((u - 0.5 * camera_.width_px) / static_cast<double>(optics_.fx),
                            (v - 0.5 * camera_.height_px) / static_cast<double>(optics_.fy));
    return last_ = optics_.lens->to_ideal(image, last_);
  }

  void add_grid(const Lens::Point& place) {
    CameraOptics::Grid grid;
    const bool fisheye = optics_.lens->is_fisheye();
    for (auto* values : {&grid.left, &grid.up, &grid.ahead}) {
      if (values != &grid.ahead || fisheye) values->resize(optics_.tiles.size() * kPixels + kPadding);
    }
    for (const PixelTile& tile : optics_.tiles) {
      for (std::size_t i = 0; i < kPixels; ++i) {
        // Padding rays repeat the border: beyond it the lens may fold.
        const std::size_t column = tile.column + std::min(i % PixelTile::kSide, tile.width - 1);
        const std::size_t row = tile.row + std::min(i / PixelTile::kSide, tile.height - 1);
        const Lens::Vec3d direction =
            optics_.lens->direction_of(ideal(static_cast<double>(column) + place.x(), static_cast<double>(row) + place.y()));
        const std::size_t ray = tile.across * kPixels + i;
        if (fisheye) grid.ahead[ray] = static_cast<float>(direction.x());
        grid.left[ray] = static_cast<float>(direction.y());
        grid.up[ray] = static_cast<float>(direction.z());
      }
    }
    if (!fisheye) {
      grid.columns = axes(grid.left);
      grid.rows = axes(grid.up);
    }
    optics_.grids.push_back(std::move(grid));
  }

  void set_bounds(PixelTile& tile) {
    std::vector<float> x, y, z;  // all samples
    for (const CameraOptics::Grid& grid : optics_.grids) {
      const auto add = [&](const std::vector<float>& from, std::vector<float>& to) {
        if (!from.empty()) to.insert(to.end(), &from[tile.across * kPixels], &from[tile.across * kPixels] + kPixels);
      };
      add(grid.ahead, x);
      add(grid.left, y);
      add(grid.up, z);
    }
    if (optics_.lens->is_fisheye()) {
      tile.frustum = trace::make_frustum(x, y, z);
    } else {
      const auto [left_min, left_max] = std::ranges::minmax(y);
      const auto [up_min, up_max] = std::ranges::minmax(z);
      tile.frustum = trace::make_pyramid(left_min, left_max, up_min, up_max);
      for (std::size_t i = 0; i < y.size(); ++i) optics_.corner = std::max(optics_.corner, std::hypot(1.0F, y[i], z[i]));
    }
    const double u = static_cast<double>(tile.column) + 0.5 * static_cast<double>(tile.width);
    const double v = static_cast<double>(tile.row) + 0.5 * static_cast<double>(tile.height);
    const auto direction = [&](double right, double down) { return optics_.lens->direction_of(ideal(u + right, v + down)); };
    const Lens::Vec3d across = direction(0.5, 0.0) - direction(-0.5, 0.0), down = direction(0.0, 0.5) - direction(0.0, -0.5);
    tile.density = static_cast<float>(1.0 / across.cross(down).norm());
  }

  const CameraConfig& camera_;
  CameraOptics& optics_;
  Lens::Point last_ = Lens::Point::Zero();
};

// Returns the tiles of one row of pixels each, row by row, whose rays are those of these tiles.
std::vector<PixelTile> cut_into_rows(const std::vector<PixelTile>& tiles) {
  std::vector<PixelTile> rows;
  for (auto left = tiles.begin(); left != tiles.end();) {
    const auto end = std::find_if(left, tiles.end(), [&](const PixelTile& tile) { return tile.row != left->row; });
    for (std::size_t row = 0; row < left->height; ++row) {
      for (auto tile = left; tile != end; ++tile) {
        rows.push_back(*tile);
        rows.back().row += row;
        rows.back().height = 1;
        rows.back().first = row * PixelTile::kSide;
      }
    }
    left = end;
  }
  return rows;
}

CameraOptics make_whole_tiles(const CameraConfig& camera) {
  CameraOptics optics{.fx = camera.fx(),
                      .fy = camera.fy(),
                      .cx = 0.5F * static_cast<float>(camera.width_px),
                      .cy = 0.5F * static_cast<float>(camera.height_px),
                      .lens = {},
                      .grids = {},
                      .tiles = {},
                      .corner = 1.0F};
  if (camera.has_lens()) optics.lens.emplace(camera.projection, camera.distortion, camera.corner());
  const auto width = static_cast<std::size_t>(camera.width_px);
  const auto height = static_cast<std::size_t>(camera.height_px);
  // Padding rays of a tile at the border point past the image; the frustum of the tile contains them as well.
  for (std::size_t row = 0; row < height; row += PixelTile::kSide) {
    for (std::size_t column = 0; column < width; column += PixelTile::kSide) {
      const auto edge = [](float centre, std::size_t pixel, float focal) { return (centre - static_cast<float>(pixel)) / focal; };
      optics.tiles.push_back({.column = column,
                              .row = row,
                              .width = std::min(PixelTile::kSide, width - column),
                              .height = std::min(PixelTile::kSide, height - row),
                              .across = optics.lens ? optics.tiles.size() : column / PixelTile::kSide,
                              .down = optics.lens ? optics.tiles.size() : row / PixelTile::kSide,
                              .frustum = trace::make_pyramid(
                                  edge(optics.cx, column + PixelTile::kSide, optics.fx), edge(optics.cx, column, optics.fx),
                                  edge(optics.cy, row + PixelTile::kSide, optics.fy), edge(optics.cy, row, optics.fy)),
                              .density = optics.fx * optics.fy});
    }
  }
  if (optics.lens) {
    LensTable(camera, optics).make();
    return optics;
  }
  for (const Lens::Point& place : sample_places(camera.samples_per_pixel)) {
    CameraOptics::Grid grid{.left = slopes(camera.width_px, optics.cx, optics.fx, place.x(),
                                           [](std::size_t pixel) { return pixel % PixelTile::kSide; }),
                            .up = slopes(camera.height_px, optics.cy, optics.fy, place.y(),
                                         [](std::size_t pixel) { return pixel / PixelTile::kSide; }),
                            .columns = {},
                            .rows = {},
                            .ahead = {}};
    grid.columns = axes(grid.left);
    grid.rows = axes(grid.up);
    optics.grids.push_back(std::move(grid));
  }
  const auto past_end = [](std::size_t pixels) {
    return static_cast<double>((pixels + PixelTile::kSide - 1) / PixelTile::kSide * PixelTile::kSide);
  };
  const double right = past_end(width) - static_cast<double>(optics.cx);
  const double down = past_end(height) - static_cast<double>(optics.cy);
  optics.corner =
      static_cast<float>(std::hypot(1.0, right / static_cast<double>(optics.fx), down / static_cast<double>(optics.fy)));
  return optics;
}

}  // namespace

CameraOptics make_camera_optics(const CameraConfig& camera) {
  CameraOptics optics = make_whole_tiles(camera);
  if (camera.rolling_shutter_s > 0.0F) optics.tiles = cut_into_rows(optics.tiles);
  return optics;
}

}  // namespace flockstep::render
