#include "render/raycast/raycast_renderer.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/raycast/tile_writer.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cstddef>
#include <cstring>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::render::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

constexpr std::size_t kSide = PixelTile::kSide;

// Interleaves a row of kSide pixels with three channels.
template <class T>
HWY_INLINE void interleave(const T* a, const T* b, const T* c, T* out) {
  using Lanes = Wide<hn::CappedTag<T, kSide>>;
  for (std::size_t i = 0; i < kSide; i += Lanes::kCount) Wide3<Lanes>::load(a + i, b + i, c + i).store_rows(out + 3 * i);
}

// Writes three channels of a tile into an image of either layout.
template <class T>
HWY_INLINE void write_channels(const T* a, const T* b, const T* c, const PixelTile& tile, const CameraConfig& camera, T* image) {
  const auto width = static_cast<std::size_t>(camera.width_px);
  const auto plane = width * static_cast<std::size_t>(camera.height_px);
  for (std::size_t row = 0; row < tile.height; ++row) {
    const std::size_t from = row * kSide;
    const std::size_t to = (tile.row + row) * width + tile.column;
    if (camera.layout == ImageLayout::chw) {
      std::memcpy(image + to, a + from, tile.width * sizeof(T));
      std::memcpy(image + plane + to, b + from, tile.width * sizeof(T));
      std::memcpy(image + 2 * plane + to, c + from, tile.width * sizeof(T));
    } else if (tile.width == kSide) {
      interleave(a + from, b + from, c + from, image + 3 * to);
    } else {
      T pixels[3 * kSide];
      interleave(a + from, b + from, c + from, pixels);
      std::memcpy(image + 3 * to, pixels, 3 * tile.width * sizeof(T));
    }
  }
}

template <class T>
HWY_INLINE void write_plane(const T* values, const PixelTile& tile, const CameraConfig& camera, T* image) {
  const auto width = static_cast<std::size_t>(camera.width_px);
  for (std::size_t row = 0; row < tile.height; ++row) {
    T* const to = image + (tile.row + row) * width + tile.column;
    if (tile.width == kSide) {
      std::memcpy(to, values + row * kSide, kSide * sizeof(T));  // the constant size avoids a call
    } else {
      std::memcpy(to, values + row * kSide, tile.width * sizeof(T));
    }
  }
}

void write(const TilePixels& pixels, const PixelTile& tile, const CameraConfig& camera, const RenderTargets& frame) {
  if (frame.rgb != nullptr) write_channels(pixels.r, pixels.g, pixels.b, tile, camera, frame.rgb);
  if (frame.depth != nullptr) write_plane(pixels.depth, tile, camera, frame.depth);
  if (frame.semantic != nullptr) write_plane(pixels.semantic, tile, camera, frame.semantic);
  if (frame.instance != nullptr) write_plane(pixels.instance, tile, camera, frame.instance);
  if (frame.normal != nullptr) write_channels(pixels.nx, pixels.ny, pixels.nz, tile, camera, frame.normal);
  if (frame.grey != nullptr) {
    alignas(64) std::uint8_t grey[TilePixels::kCount];
    for (std::size_t i = 0; i < tile.height * kSide; ++i) grey[i] = grey_of(pixels.r[i], pixels.g[i], pixels.b[i]);
    write_plane(grey, tile, camera, frame.grey);
  }
}

}  // namespace flockstep::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::render {

HWY_EXPORT(write);

void write_tile(const TilePixels& pixels, const PixelTile& tile, const CameraConfig& camera, const RenderTargets& frame) {
  HWY_DYNAMIC_DISPATCH(write)(pixels, tile, camera, frame);
}

}  // namespace flockstep::render
#endif
