#include "render/lens.hpp"

#include "flockstep/config.hpp"
#include "render/camera_optics.hpp"
#include "standard.hpp"

namespace flockstep::render {
namespace {

// Whole and partial tiles, one and several samples, and lenses of both kinds, the last of which looks backwards in its corners.
std::vector<CameraConfig> bent_cameras() {
  std::vector<CameraConfig> all;
  for (const auto& [width, height] : {std::pair{1, 1}, {17, 3}, {48, 37}}) {
    const CameraConfig plain{
        .width_px = width, .height_px = height, .hfov_deg = 80.0F, .vfov_deg = 70.0F, .samples_per_pixel = 4};
    for (const std::vector<float>& k : {std::vector{-0.3F, 0.1F, 0.002F, -0.001F, -0.01F}, {0.4F, 0.2F, 0.0F, 0.02F}}) {
      all.push_back(plain);
      all.back().distortion = k;
      all.push_back(all.back());
      all.back().samples_per_pixel = 1;
    }
    all.push_back(plain);
    all.back().projection = Projection::fisheye;
    all.push_back(all.back());
    all.back().hfov_deg = all.back().vfov_deg = 170.0F;
    all.back().distortion = {-0.01F, 0.04F, -0.04F, 0.01F};
  }
  return all;
}

TEST(LensCamera, EveryPixelLooksWhereTheLensShowsIt) {
  for (const CameraConfig& camera : bent_cameras()) {
    const CameraOptics optics = make_camera_optics(camera);
    ASSERT_TRUE(optics.lens && optics.lens->shows_every_pixel());
    for (const PixelTile& tile : optics.tiles) {
      const CameraOptics::Grid& grid = optics.grids[0];
      for (std::size_t ray = 0; ray < PixelTile::kSide * tile.height; ++ray) {
        if (ray % PixelTile::kSide >= tile.width) continue;
        const std::size_t at = tile.across * PixelTile::kSide * PixelTile::kSide + ray;
        const Lens::Vec3d direction(grid.ahead.empty() ? 1.0 : static_cast<double>(grid.ahead[at]),
                                    static_cast<double>(grid.left[at]), static_cast<double>(grid.up[at]));
        const auto ideal = optics.lens->ideal_of(direction);
        ASSERT_TRUE(ideal);
        const Lens::Point image = optics.lens->to_image(*ideal);
        ASSERT_NEAR(0.5 * camera.width_px + image.x() * static_cast<double>(camera.fx()),
                    static_cast<double>(tile.column + ray % PixelTile::kSide) + 0.5, 1e-4);
        ASSERT_NEAR(0.5 * camera.height_px + image.y() * static_cast<double>(camera.fy()),
                    static_cast<double>(tile.row + ray / PixelTile::kSide) + 0.5, 1e-4);
      }
    }
  }
}

// Includes all samples, and the rays that only pad the last tiles.
TEST(LensCamera, FrustaHoldAllRaysOfTheirTile) {
  for (const CameraConfig& camera : bent_cameras()) {
    const CameraOptics optics = make_camera_optics(camera);
    for (const PixelTile& tile : optics.tiles) {
      for (const CameraOptics::Grid& grid : optics.grids) {
        for (std::size_t ray = 0; ray < PixelTile::kSide * PixelTile::kSide; ++ray) {
          const std::size_t at = tile.across * PixelTile::kSide * PixelTile::kSide + ray;
          const Vec3 direction(grid.ahead.empty() ? 1.0F : grid.ahead[at], grid.left[at], grid.up[at]);
          ASSERT_LE(direction.norm(), optics.corner * (1.0F + 1e-6F));
          for (std::size_t plane = 0; plane < trace::Frustum::kPlanes; ++plane) {
            const Vec3 normal(tile.frustum.x[plane], tile.frustum.y[plane], tile.frustum.z[plane]);
            ASSERT_LE(normal.dot(direction), tile.frustum.reach[plane] + 1e-6F) << "plane " << plane << ", ray " << ray;
          }
        }
      }
    }
  }
}

// The density of pixels selects the mip level of textures.
TEST(LensCamera, PixelsCoverPartsOfTheSphere) {
  const CameraOptics optics =
      make_camera_optics({.width_px = 640, .height_px = 16, .hfov_deg = 120.0F, .projection = Projection::fisheye});
  for (const PixelTile& tile : optics.tiles) {
    const double angle = std::abs(static_cast<double>(tile.column) + 8.0 - 320.0) / static_cast<double>(optics.fx);
    const double per_area = static_cast<double>(optics.fx * optics.fx) * angle / std::sin(angle);  // r dr / (sin a da)
    ASSERT_NEAR(static_cast<double>(tile.density), per_area, 1e-3 * per_area);
  }
}

}  // namespace
}  // namespace flockstep::render
