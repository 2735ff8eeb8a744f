#include "render/gl/atlas.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "render/gl/egl_context.hpp"

namespace flockstep::render {
namespace {

struct Format {
  GLenum internal, format, type;
  std::size_t bytes;  // bytes per pixel
};
// Images that can be read: the attachments by number, then the depth buffer.
constexpr std::size_t kNumColors = 3;
constexpr std::array<Format, kNumColors + 1> kFormats{
    Format{GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, 4}, Format{GL_RG16UI, GL_RG_INTEGER, GL_UNSIGNED_SHORT, 4},
    Format{GL_RGBA32F, GL_RGBA, GL_FLOAT, 16}, Format{GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, 4}};

std::array<bool, kFormats.size()> present(const Attachments& attachments) {
  return {attachments.color, attachments.ids, attachments.normal, attachments.depth};
}

}  // namespace

GlAtlas::GlAtlas(const AtlasSize& size, const Attachments& attachments) : size_(size), attachments_(attachments) {
  framebuffer_ = make_framebuffer();
  const auto attach = [&](GLenum point, GLenum format) {
    GlObject texture = make_texture();
    glTextureStorage2D(texture.name(), 1, format, size_.width, size_.height * size_.tiles);
    glTextureParameteri(texture.name(), GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTextureParameteri(texture.name(), GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glNamedFramebufferTexture(framebuffer_.name(), point, texture.name(), 0);
    return texture;
  };
  std::array<GLenum, kNumColors> draws{};
  for (std::size_t i = 0; i < kNumColors; ++i) {
    const auto point = static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + i);
    draws[i] = present(attachments_)[i] ? point : GLenum{GL_NONE};
    if (present(attachments_)[i]) textures_[i] = attach(point, kFormats[i].internal);
  }
  glNamedFramebufferDrawBuffers(framebuffer_.name(), static_cast<GLsizei>(draws.size()), draws.data());
  depth_ = attach(GL_DEPTH_ATTACHMENT, kFormats[kNumColors].internal);
  if (glCheckNamedFramebufferStatus(framebuffer_.name(), GL_DRAW_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
    throw GlUnavailable("the device cannot allocate images of this size and format");
  }
}

void GlAtlas::clear() const {
  const GLuint name = framebuffer_.name();
  if (attachments_.ids) glClearNamedFramebufferuiv(name, GL_COLOR, 1, std::array<GLuint, 4>{}.data());
  if (attachments_.normal) glClearNamedFramebufferfv(name, GL_COLOR, 2, std::array<float, 4>{}.data());
  glClearNamedFramebufferfv(name, GL_DEPTH, 0, std::array<float, 4>{}.data());
}

GlReadback::~GlReadback() {
  if (fence_ != nullptr) glDeleteSync(fence_);
}

void GlReadback::reserve(std::size_t bytes) {
  if (bytes <= capacity_) return;
  capacity_ = bytes;
  if (is_software_) {
    memory_.resize(bytes);
    return;
  }
  constexpr GLbitfield kAccess = GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
  buffer_ = make_buffer();
  glNamedBufferStorage(buffer_.name(), static_cast<GLsizeiptr>(bytes), nullptr, kAccess | GL_CLIENT_STORAGE_BIT);
  mapped_ = static_cast<std::byte*>(glMapNamedBufferRange(buffer_.name(), 0, static_cast<GLsizeiptr>(bytes), kAccess));
  if (mapped_ == nullptr) throw GlUnavailable("the device cannot map a buffer to read images from");
}

void GlReadback::start(const GlAtlas& atlas, int tiles) {
  const AtlasSize& size = atlas.size();
  const std::size_t pixels = AtlasSize{size.width, size.height, tiles}.pixels();
  const auto is_present = present(atlas.attachments());
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < kFormats.size(); ++i) bytes += is_present[i] ? pixels * kFormats[i].bytes : 0;
  reserve(bytes);

  std::byte* const base = is_software_ ? memory_.data() : mapped_;
  glBindFramebuffer(GL_READ_FRAMEBUFFER, atlas.framebuffer());
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  if (!is_software_) glBindBuffer(GL_PIXEL_PACK_BUFFER, buffer_.name());
  std::array<const std::byte*, kFormats.size()> at{};
  std::size_t offset = 0;
  for (std::size_t i = 0; i < kFormats.size(); ++i) {
    if (!is_present[i]) continue;
    at[i] = base + offset;
    void* const target = is_software_ ? base + offset : reinterpret_cast<void*>(offset);
    if (i < kNumColors) glReadBuffer(static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + i));
    glReadPixels(0, 0, size.width, size.height * tiles, kFormats[i].format, kFormats[i].type, target);
    offset += pixels * kFormats[i].bytes;
  }
  pixels_ = {reinterpret_cast<const std::uint8_t*>(at[0]), reinterpret_cast<const float*>(at[3]),
             reinterpret_cast<const std::uint16_t*>(at[1]), reinterpret_cast<const float*>(at[2])};
  if (!is_software_) {
    glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    fence_ = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
    glFlush();
  }
}

void GlReadback::finish() {
  if (fence_ != nullptr) {
    GLenum status = GL_TIMEOUT_EXPIRED;
    // No time limit is needed here: the caller that waits for the frames has one; see GlWorker::wait.
    while (status == GL_TIMEOUT_EXPIRED) status = glClientWaitSync(fence_, GL_SYNC_FLUSH_COMMANDS_BIT, 1'000'000'000);
    glDeleteSync(fence_);
    fence_ = nullptr;
    if (status == GL_WAIT_FAILED) throw GlUnavailable("the device lost the images while reading them back");
  }
  if (const GLenum error = glGetError(); error != GL_NO_ERROR) {
    throw GlUnavailable("OpenGL failed with error " + std::to_string(error));
  }
}

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
void lengthen(const CameraOptics& optics, int left, int row, std::size_t count, float* depth) {
  const float z = (optics.cy - static_cast<float>(row) - 0.5F) / optics.fy;
  const float per_pixel = 1.0F / optics.fx;
  const float first = optics.cx - static_cast<float>(left) - 0.5F;
  for (std::size_t i = 0; i < count; ++i) {
    const float y = (first - static_cast<float>(static_cast<int>(i))) * per_pixel;
    depth[i] *= std::sqrt(1.0F + y * y + z * z);
  }
}

}  // namespace

void write_frame(const AtlasPixels& pixels, const AtlasSize& size, std::size_t tile, const RenderRequest& request,
                 const FramePart& part) {
  const CameraConfig& camera = *request.camera;
  const RenderTargets& frame = request.frame;
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
    lengthen(*request.optics, part.left, row, width, depth);
  }
}

}  // namespace flockstep::render
