#include "render/gl/frame_writer.hpp"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace flockstep::render {
namespace {

// Drops the fourth value of each pixel. Writes the others pixel by pixel or plane by plane, as the layout requires.
template <class T>
void write_vectors(const T* from, std::size_t count, ImageLayout layout, std::size_t at, std::size_t frame_pixels, T* image) {
  if (layout == ImageLayout::hwc) {
    T* to = image + 3 * at;
    for (std::size_t i = 0; i + 1 < count; ++i) {
      std::memcpy(to + 3 * i, from + 4 * i, 4 * sizeof(T));  // a single move; the next pixel overwrites the fourth value
    }
    if (count != 0) std::memcpy(to + 3 * (count - 1), from + 4 * (count - 1), 3 * sizeof(T));
    return;
  }
  for (std::size_t channel = 0; channel < 3; ++channel) {
    T* to = image + channel * frame_pixels + at;
    for (std::size_t i = 0; i < count; ++i) to[i] = from[4 * i + channel];
  }
}

void write_grey(const std::uint8_t* from, std::size_t count, std::uint8_t* to) {
  for (std::size_t i = 0; i < count; ++i) to[i] = grey_of(from[4 * i], from[4 * i + 1], from[4 * i + 2]);
}

void write_every_second(const std::uint16_t* from, std::size_t count, std::uint16_t* to) {
  for (std::size_t i = 0; i < count; ++i) to[i] = from[2 * i];
}

// Converts values of the depth buffer to metres; see shaders.cpp.
void write_depth(const float* from, std::size_t count, const CameraConfig& camera, float* to) {
  const float farness = 1.0F / camera.far_m;
  const float scale = 1.0F / camera.near_m - farness;
  for (std::size_t i = 0; i < count; ++i) {
    const float depth = 1.0F / (from[i] * scale + farness);
    to[i] = from[i] > 0.0F ? depth : std::numeric_limits<float>::infinity();
  }
}

// Converts planar depths to ranges, in one row from column `left` on.
void lengthen(const PinholeCamera& pinhole, int left, int row, std::size_t count, float* depth) {
  const float z = (pinhole.cy - static_cast<float>(row) - 0.5F) / pinhole.fy;
  const float per_pixel = 1.0F / pinhole.fx;
  const float first = pinhole.cx - static_cast<float>(left) - 0.5F;
  for (std::size_t i = 0; i < count; ++i) {
    const float y = (first - static_cast<float>(static_cast<int>(i))) * per_pixel;
    depth[i] *= std::sqrt(1.0F + y * y + z * z);
  }
}

}  // namespace

void write_frame(const Pixels& pixels, const AtlasSize& size, std::size_t tile, const RenderRequest& request,
                 const FramePart& part) {
  const CameraConfig& camera = *request.camera;
  const Frame& frame = request.frame;
  const auto tile_width = static_cast<std::size_t>(size.width);
  const auto frame_width = static_cast<std::size_t>(camera.width_px);
  const std::size_t frame_pixels = frame_width * static_cast<std::size_t>(camera.height_px);
  const bool is_whole = part.width == size.width && part.width == camera.width_px;  // rows are then contiguous in both
  const auto width = static_cast<std::size_t>(part.width);
  const auto height = static_cast<std::size_t>(part.height);
  const std::size_t rows = is_whole ? 1 : height;
  const std::size_t count = is_whole ? width * height : width;
  for (std::size_t row = 0; row < rows; ++row) {
    const std::size_t from = (tile * static_cast<std::size_t>(size.height) + row) * tile_width;
    const std::size_t to = (static_cast<std::size_t>(part.top) + row) * frame_width + static_cast<std::size_t>(part.left);
    if (frame.rgb != nullptr) write_vectors(pixels.color + 4 * from, count, camera.layout, to, frame_pixels, frame.rgb);
    if (frame.grey != nullptr) write_grey(pixels.color + 4 * from, count, frame.grey + to);
    if (frame.depth != nullptr) write_depth(pixels.depth + from, count, camera, frame.depth + to);
    if (frame.semantic != nullptr) write_every_second(pixels.ids + 2 * from, count, frame.semantic + to);
    if (frame.instance != nullptr) write_every_second(pixels.ids + 2 * from + 1, count, frame.instance + to);
    if (frame.normal != nullptr) write_vectors(pixels.normal + 4 * from, count, camera.layout, to, frame_pixels, frame.normal);
  }
  if (frame.depth == nullptr || camera.depth_kind == DepthKind::planar) return;
  for (int row = part.top; row < part.top + part.height; ++row) {
    float* const depth = frame.depth + static_cast<std::size_t>(row) * frame_width + static_cast<std::size_t>(part.left);
    lengthen(*request.pinhole, part.left, row, width, depth);
  }
}

}  // namespace flockstep::render
