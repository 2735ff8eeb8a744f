#include "render/camera_optics.hpp"

#include "flockstep/config.hpp"
#include "standard.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::render {
namespace {

// Image sizes: one pixel, thin, small, whole tiles, and partial tiles. Narrow and wide views, one and several samples.
std::vector<CameraConfig> cameras() {
  std::vector<CameraConfig> all;
  for (const auto& [width, height] : {std::pair{1, 1}, {17, 3}, {33, 47}, {64, 48}, {160, 16}}) {
    for (const float fov : {5.0F, 90.0F, 150.0F}) {
      all.push_back({.width_px = width, .height_px = height, .hfov_deg = fov});
      all.push_back({.width_px = width, .height_px = height, .vfov_deg = 60.0F, .samples_per_pixel = 4});
      all.push_back({.width_px = width, .height_px = height, .hfov_deg = fov, .vfov_deg = 80.0F, .samples_per_pixel = 9});
    }
  }
  return all;
}

std::string name_of(const CameraConfig& camera) {
  return std::to_string(camera.width_px) + "x" + std::to_string(camera.height_px) + ", fx " + std::to_string(camera.fx()) +
         ", samples " + std::to_string(camera.samples_per_pixel);
}

TEST(PinholeFocalLength, OfKnownAngles) {
  EXPECT_EQ((CameraConfig{.width_px = 640, .height_px = 480}).fx(), 320.0F);  // hfov defaults to 90 degrees
  EXPECT_EQ((CameraConfig{.width_px = 640, .height_px = 480}).fy(), 320.0F);
  EXPECT_NEAR((CameraConfig{.width_px = 640, .hfov_deg = 60.0F}).fx(), 554.25626, 1e-4);  // 320 / tan 30
  EXPECT_NEAR((CameraConfig{.height_px = 480, .vfov_deg = 90.0F}).fy(), 240.0, 1e-4);
  EXPECT_NEAR((CameraConfig{.height_px = 480, .vfov_deg = 90.0F}).fx(), 240.0, 1e-4);  // square pixels
  const CameraConfig both{.width_px = 640, .height_px = 480, .hfov_deg = 90.0F, .vfov_deg = 60.0F};
  EXPECT_NEAR(both.fx(), 320.0, 1e-4);
  EXPECT_NEAR(both.fy(), 415.69219, 1e-4);  // 240 / tan 30
}

TEST(CameraOptics, EveryPixelLooksThroughItsSamples) {
  for (const CameraConfig& camera : cameras()) {
    SCOPED_TRACE(name_of(camera));
    const CameraOptics optics = make_camera_optics(camera);
    const auto samples = static_cast<std::size_t>(camera.samples_per_pixel);
    ASSERT_EQ(optics.grids.size(), samples == 1 ? 1 : 1 + samples);
    const auto side = static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(samples))));
    const auto place = [&](std::size_t grid, std::size_t step) {  // position within a pixel
      return grid == 0 ? 0.5 : (static_cast<double>(step) + 0.5) / static_cast<double>(side);
    };
    for (const PixelTile& tile : optics.tiles) {
      for (std::size_t grid = 0; grid < optics.grids.size(); ++grid) {
        const double left = place(grid, (grid - 1) % side);
        const double down = place(grid, (grid - 1) / side);
        const float* const y = optics.grids[grid].left.data() + tile.column * PixelTile::kSide;
        const float* const z = optics.grids[grid].up.data() + tile.row * PixelTile::kSide;
        for (std::size_t ray = 0; ray < PixelTile::kSide * PixelTile::kSide; ++ray) {
          const double u = static_cast<double>(tile.column + ray % PixelTile::kSide) + left;
          const double v = static_cast<double>(tile.row + ray / PixelTile::kSide) + down;
          const double its_y = (0.5 * camera.width_px - u) / static_cast<double>(camera.fx());
          const double its_z = (0.5 * camera.height_px - v) / static_cast<double>(camera.fy());
          ASSERT_NEAR(y[ray], its_y, 1e-6 * (1.0 + std::abs(its_y))) << "grid " << grid << ", ray " << ray;
          ASSERT_NEAR(z[ray], its_z, 1e-6 * (1.0 + std::abs(its_z))) << "grid " << grid << ", ray " << ray;
          ASSERT_LE(std::hypot(1.0, its_y, its_z), static_cast<double>(optics.corner) * (1.0 + 1e-6));
        }
      }
    }
  }
}

TEST(CameraOptics, WholeVectorsMayBeReadPastTheLastRay) {
  const CameraOptics optics = make_camera_optics({.width_px = 17, .height_px = 3});
  constexpr std::size_t kPadding = 3 * PixelTile::kSide + trace::kRayPadding;  // after the last row of a rolling shutter
  for (const CameraOptics::Grid& grid : optics.grids) {
    EXPECT_EQ(grid.left.size(), 2 * PixelTile::kSide * PixelTile::kSide + kPadding);
    EXPECT_EQ(grid.up.size(), PixelTile::kSide * PixelTile::kSide + kPadding);
  }
}

TEST(CameraOptics, TilesHoldEveryPixelOnce) {
  for (const CameraConfig& camera : cameras()) {
    SCOPED_TRACE(name_of(camera));
    const auto width = static_cast<std::size_t>(camera.width_px);
    const auto height = static_cast<std::size_t>(camera.height_px);
    std::vector<int> times(width * height, 0);
    for (const PixelTile& tile : make_camera_optics(camera).tiles) {
      EXPECT_EQ(tile.column % PixelTile::kSide, 0U);
      EXPECT_EQ(tile.row % PixelTile::kSide, 0U);
      ASSERT_LE(tile.column + tile.width, width);
      ASSERT_LE(tile.row + tile.height, height);
      for (std::size_t row = tile.row; row < tile.row + tile.height; ++row) {
        for (std::size_t column = tile.column; column < tile.column + tile.width; ++column) ++times[row * width + column];
      }
    }
    EXPECT_EQ(std::count(times.begin(), times.end(), 1), static_cast<std::ptrdiff_t>(times.size()));
  }
}

// Includes the rays that only pad the last tiles. The frusta are as tight as the borders of their tiles.
TEST(CameraOptics, FrustaHoldAllRaysOfTheirTile) {
  for (const CameraConfig& camera : cameras()) {
    SCOPED_TRACE(name_of(camera));
    const CameraOptics optics = make_camera_optics(camera);
    for (const PixelTile& tile : optics.tiles) {
      const trace::Frustum& frustum = tile.frustum;
      const auto above = [&](std::size_t plane, const Vec3& direction) {
        return Vec3(frustum.x[plane], frustum.y[plane], frustum.z[plane]).dot(direction);
      };
      for (std::size_t plane = 0; plane < trace::Frustum::kPlanes; ++plane) {
        for (const CameraOptics::Grid& grid : optics.grids) {
          for (std::size_t ray = 0; ray < PixelTile::kSide * PixelTile::kSide; ++ray) {
            const Vec3 direction(1.0F, grid.left[tile.column * PixelTile::kSide + ray],
                                 grid.up[tile.row * PixelTile::kSide + ray]);
            ASSERT_LE(above(plane, direction), frustum.reach[plane]) << "plane " << plane << ", ray " << ray;
          }
        }
        float most = -1e9F;
        for (const std::size_t right : {std::size_t{0}, PixelTile::kSide}) {
          for (const std::size_t down : {std::size_t{0}, PixelTile::kSide}) {
            const Vec3 corner(1.0F, (optics.cx - static_cast<float>(tile.column + right)) / optics.fx,
                              (optics.cy - static_cast<float>(tile.row + down)) / optics.fy);
            most = std::max(most, above(plane, corner.normalized()));
          }
        }
        ASSERT_NEAR(most, 0.0F, 2e-6F) << "plane " << plane;
      }
    }
  }
}

}  // namespace
}  // namespace flockstep::render
