#include "formats/image.hpp"

#include <png.h>
#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <iomanip>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// Upper bound of the compression of both formats. Headers that claim more are rejected before memory is allocated. PNG: 8
// pixels per byte, times about a thousand by deflate. JPEG: blocks of 64 pixels with at least two bits each.
constexpr std::size_t kMaxPixelsPerByte = 8 * 1040;

void check_size(std::size_t width, std::size_t height, std::size_t file_bytes, std::size_t max_pixels,
                const std::string& source) {
  const auto sides = [&] { return std::to_string(width) + " x " + std::to_string(height); };
  constexpr std::size_t kMaxSide = kMaxTexturePx;
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) {
    refuse(source, "an image of 1 to " + std::to_string(kMaxTexturePx) + " pixels to a side", sides());
  }
  require(width * height <= max_pixels, source, "at most " + std::to_string(max_pixels) + " pixels", sides());
  require(width * height / kMaxPixelsPerByte <= file_bytes, source, "a complete image file",
          sides() + " pixels in " + std::to_string(file_bytes) + " bytes");
}

// ------------------------------------------------------------------------------------------------------------------- PNG

// libpng reports errors by longjmp, which must not skip destructors. Therefore the callbacks and their callers keep their state
// here, and functions that call setjmp have no locals with destructors.
struct Png {
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::array<char, 128> error{};
  const std::uint8_t* at = nullptr;  // remaining input
  std::size_t left = 0;
  std::string* out = nullptr;  // output

  [[noreturn]] static void fail(png_structp png, png_const_charp message) {
    auto* const self = static_cast<Png*>(png_get_error_ptr(png));
    std::snprintf(self->error.data(), self->error.size(), "%s", message);
    png_longjmp(png, 1);
  }
  static void warn(png_structp, png_const_charp) {}
  static void read(png_structp png, png_bytep to, std::size_t size) {
    auto* const self = static_cast<Png*>(png_get_io_ptr(png));
    if (size > self->left) png_error(png, "the file is truncated");
    std::memcpy(to, self->at, size);
    self->at += size;
    self->left -= size;
  }
  static void write(png_structp png, png_bytep from, std::size_t size) {
    auto* const self = static_cast<Png*>(png_get_io_ptr(png));
    try {
      self->out->append(reinterpret_cast<const char*>(from), size);
    } catch (...) {
      self->error[0] = '\0';  // out of memory
    }
    if (self->error[0] == '\0') png_longjmp(png, 1);
  }
  static void flush(png_structp) {}
};

struct PngReader : Png {
  explicit PngReader(std::span<const std::uint8_t> file) {
    at = file.data();
    left = file.size();
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, static_cast<Png*>(this), fail, warn);
    if (png != nullptr) info = png_create_info_struct(png);
    if (info == nullptr) throw std::bad_alloc();
  }
  ~PngReader() { png_destroy_read_struct(&png, &info, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  bool read_header() {
    if (setjmp(png_jmpbuf(png)) != 0) return false;
    png_set_read_fn(png, static_cast<Png*>(this), read);
    png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
    png_set_user_limits(png, 0x7fffffff, 0x7fffffff);  // so that our own check reports the size
    png_set_chunk_cache_max(png, 64);
    png_set_chunk_malloc_max(png, std::size_t{1} << 24U);
    png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, nullptr, 0);
    png_read_info(png, info);
    png_set_expand(png);
    png_set_scale_16(png);
    png_set_gray_to_rgb(png);
    png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
    passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    return true;
  }

  bool read_rows(std::uint8_t* pixels, std::size_t height, std::size_t stride) {
    if (setjmp(png_jmpbuf(png)) != 0) return false;
    for (int pass = 0; pass < passes; ++pass) {
      for (std::size_t row = 0; row < height; ++row) {
        if (row % 64 == 0) Interrupt::poll();
        png_read_row(png, pixels + row * stride, nullptr);
      }
    }
    png_read_end(png, nullptr);
    return true;
  }

  int passes = 1;
};

struct PngWriter : Png {
  explicit PngWriter(std::string& file) {
    out = &file;
    error[0] = '?';
    png = png_create_write_struct(PNG_LIBPNG_VER_STRING, static_cast<Png*>(this), fail, warn);
    if (png != nullptr) info = png_create_info_struct(png);
    if (info == nullptr) throw std::bad_alloc();
  }
  ~PngWriter() { png_destroy_write_struct(&png, &info); }
  PngWriter(const PngWriter&) = delete;
  PngWriter& operator=(const PngWriter&) = delete;

  bool write_all(const std::uint8_t* pixels, std::uint32_t width, std::uint32_t height) {
    if (setjmp(png_jmpbuf(png)) != 0) return false;
    png_set_write_fn(png, static_cast<Png*>(this), write, flush);
    png_set_user_limits(png, 0x7fffffff, 0x7fffffff);
    png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB_ALPHA, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (std::size_t row = 0; row < height; ++row) {
      if (row % 64 == 0) Interrupt::poll();
      png_write_row(png, pixels + row * 4 * width);
    }
    png_write_end(png, nullptr);
    return true;
  }
};

Image decode_png(std::span<const std::uint8_t> file, const std::string& source, std::size_t max_pixels) {
  PngReader reader(file);
  const auto damaged = [&] { refuse(source, "a complete PNG file", quoted_excerpt(reader.error.data())); };
  if (!reader.read_header()) damaged();
  const std::size_t width = png_get_image_width(reader.png, reader.info);
  const std::size_t height = png_get_image_height(reader.png, reader.info);
  check_size(width, height, file.size(), max_pixels, source);
  if (png_get_rowbytes(reader.png, reader.info) != 4 * width) throw std::logic_error("a row of PNG that is not RGBA");
  Image image{static_cast<int>(width), static_cast<int>(height), std::vector<std::uint8_t>(4 * width * height)};
  if (!reader.read_rows(image.rgba.data(), height, 4 * width)) damaged();
  return image;
}

// ------------------------------------------------------------------------------------------------------------------ JPEG

Image decode_jpeg(std::span<const std::uint8_t> file, const std::string& source, std::size_t max_pixels) {
  const std::unique_ptr<void, decltype(&tjDestroy)> decoder(tjInitDecompress(), tjDestroy);
  if (!decoder) throw std::bad_alloc();
  const auto damaged = [&] { refuse(source, "a complete JPEG file", '"' + excerpt(tjGetErrorStr2(decoder.get()), 128) + '"'); };
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(decoder.get(), file.data(), file.size(), &width, &height, &subsampling, &colours) != 0) damaged();
  check_size(static_cast<std::size_t>(std::max(width, 0)), static_cast<std::size_t>(std::max(height, 0)), file.size(), max_pixels,
             source);
  if (colours == TJCS_CMYK || colours == TJCS_YCCK) refuse(source, "a greyscale or RGB JPEG file", "a CMYK one");
  Image image{width, height,
              std::vector<std::uint8_t>(std::size_t{4} * static_cast<std::size_t>(width) * static_cast<std::size_t>(height))};
  // Without TJFLAG_STOPONWARNING, missing parts of a truncated file would become grey with only a warning.
  constexpr int kFlags = TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS;
  if (tjDecompress2(decoder.get(), file.data(), file.size(), image.rgba.data(), width, 0, height, TJPF_RGBA, kFlags) != 0) {
    damaged();
  }
  return image;
}

// Returns the first bytes of a file in hexadecimal.
std::string signature_of(std::span<const std::uint8_t> file) {
  std::ostringstream text;
  text << std::hex << std::setfill('0');
  for (const std::uint8_t byte : file.first(std::min<std::size_t>(file.size(), 4))) text << std::setw(2) << +byte;
  return text.str();
}

}  // namespace

Image decode_image(std::span<const std::uint8_t> file, const std::string& source, std::size_t max_pixels) {
  constexpr std::array<std::uint8_t, 8> kPng{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  constexpr std::array<std::uint8_t, 3> kJpeg{0xff, 0xd8, 0xff};
  const auto begins_with = [&](std::span<const std::uint8_t> magic) {
    return file.size() >= magic.size() && std::equal(magic.begin(), magic.end(), file.begin());
  };
  if (begins_with(kPng)) return decode_png(file, source, max_pixels);
  if (begins_with(kJpeg)) return decode_jpeg(file, source, max_pixels);
  refuse(source, "a PNG or JPEG file", file.empty() ? std::string("an empty file") : "signature 0x" + signature_of(file));
}

std::string encode_png(int width_px, int height_px, std::span<const std::uint8_t> rgba) {
  const auto width = static_cast<std::uint32_t>(width_px), height = static_cast<std::uint32_t>(height_px);
  if (rgba.size() != std::size_t{4} * width * height) throw std::logic_error("encode_png: not a byte for each pixel and channel");
  std::string file;
  PngWriter writer(file);
  if (!writer.write_all(rgba.data(), width, height)) {
    if (writer.error[0] == '\0') throw std::bad_alloc();
    throw std::runtime_error(std::string("libpng: ") + writer.error.data());
  }
  return file;
}

}  // namespace flockstep
