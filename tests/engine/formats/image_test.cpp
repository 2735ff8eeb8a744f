#include "formats/image.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "refusal.hpp"
#include "render/jpeg.hpp"

namespace flockstep {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

Image decode(const Bytes& file) { return decode_image(file, "x"); }

std::string image_refusal(const Bytes& file, std::size_t max_pixels = kMaxScenePixels) {
  return testing::refusal([&] { decode_image(file, "x", max_pixels); });
}

Bytes gradient(int width, int height) {
  Bytes rgba;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (const int value : {x * 7, y * 11, x * y, x + y}) rgba.push_back(static_cast<std::uint8_t>(value % 256));
    }
  }
  return rgba;
}

std::uint32_t crc(std::span<const std::uint8_t> bytes) {
  std::uint32_t sum = 0xffffffffU;
  for (const std::uint8_t byte : bytes) {
    sum ^= byte;
    for (int bit = 0; bit < 8; ++bit) sum = (sum & 1U) != 0 ? (sum >> 1U) ^ 0xedb88320U : sum >> 1U;
  }
  return ~sum;
}

void append_number(Bytes& to, std::uint32_t value) {
  for (const unsigned shift : {24U, 16U, 8U, 0U}) to.push_back(static_cast<std::uint8_t>(value >> shift));
}

void append_chunk(Bytes& to, const std::string& name, const Bytes& data) {
  append_number(to, static_cast<std::uint32_t>(data.size()));
  Bytes body = bytes_of(name);
  body.insert(body.end(), data.begin(), data.end());
  to.insert(to.end(), body.begin(), body.end());
  append_number(to, crc(body));
}

// Builds a PNG file by hand. Each row starts with its filter number; the data is stored uncompressed.
Bytes png_of(std::uint32_t width, std::uint32_t height, int depth, int colour, const Bytes& rows, const Bytes& palette = {},
             int interlace = 0) {
  Bytes file{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  Bytes header;
  append_number(header, width);
  append_number(header, height);
  for (const int value : {depth, colour, 0, 0, interlace}) header.push_back(static_cast<std::uint8_t>(value));
  append_chunk(file, "IHDR", header);
  if (!palette.empty()) append_chunk(file, "PLTE", palette);
  const auto size = static_cast<std::uint8_t>(rows.size());
  Bytes data{0x78, 0x01, 0x01, size, 0, static_cast<std::uint8_t>(~size), 0xff};
  data.insert(data.end(), rows.begin(), rows.end());
  std::uint32_t a = 1, b = 0;
  for (const std::uint8_t byte : rows) {
    a = (a + byte) % 65521;
    b = (b + a) % 65521;
  }
  append_number(data, b << 16U | a);
  append_chunk(file, "IDAT", data);
  append_chunk(file, "IEND", {});
  return file;
}

TEST(Image, APngIsReadBackEqual) {
  for (const auto& [width, height] : {std::array{1, 1}, std::array{3, 2}, std::array{64, 33}, std::array{1, 200}}) {
    const Bytes rgba = gradient(width, height);
    const Image read = decode(bytes_of(encode_png(width, height, rgba)));
    EXPECT_EQ(read.width_px, width);
    EXPECT_EQ(read.height_px, height);
    EXPECT_EQ(read.rgba, rgba);  // including pixels with alpha 0, whose colours are kept
  }
}

TEST(Image, EveryKindOfPngBecomesRgba) {
  EXPECT_EQ(decode(png_of(2, 1, 8, 2, {0, 1, 2, 3, 4, 5, 6})).rgba, (Bytes{1, 2, 3, 255, 4, 5, 6, 255}));
  EXPECT_EQ(decode(png_of(2, 1, 8, 6, {0, 1, 2, 3, 0, 4, 5, 6, 7})).rgba, (Bytes{1, 2, 3, 0, 4, 5, 6, 7}));
  EXPECT_EQ(decode(png_of(2, 1, 8, 0, {0, 9, 200})).rgba, (Bytes{9, 9, 9, 255, 200, 200, 200, 255}));
  EXPECT_EQ(decode(png_of(2, 1, 8, 4, {0, 9, 1, 200, 2})).rgba, (Bytes{9, 9, 9, 1, 200, 200, 200, 2}));
  EXPECT_EQ(decode(png_of(2, 1, 1, 0, {0, 0x40})).rgba, (Bytes{0, 0, 0, 255, 255, 255, 255, 255}));
  EXPECT_EQ(decode(png_of(2, 1, 8, 3, {0, 1, 0}, {1, 2, 3, 4, 5, 6})).rgba, (Bytes{4, 5, 6, 255, 1, 2, 3, 255}));
  EXPECT_EQ(decode(png_of(1, 1, 16, 2, {0, 255, 255, 128, 128, 0, 0})).rgba, (Bytes{255, 128, 0, 255}));
  // Two rows, from the top. The second is a difference to the first.
  EXPECT_EQ(decode(png_of(1, 2, 8, 2, {0, 10, 20, 30, 2, 1, 1, 1})).rgba, (Bytes{10, 20, 30, 255, 11, 21, 31, 255}));
  // Interlaced: of 2 x 1 pixels, the first is in pass one and the second in pass six.
  EXPECT_EQ(decode(png_of(2, 1, 8, 2, {0, 1, 2, 3, 0, 4, 5, 6}, {}, 1)).rgba, (Bytes{1, 2, 3, 255, 4, 5, 6, 255}));
}

TEST(Image, AJpegIsRead) {
  CameraConfig camera;
  camera.width_px = 16;
  camera.height_px = 8;
  camera.layout = ImageLayout::hwc;
  const Bytes rgb(3 * 16 * 8, 180);
  const Image read = decode(bytes_of(render::compress_rgb(rgb.data(), camera, 100)));
  EXPECT_EQ(read.width_px, 16);
  EXPECT_EQ(read.height_px, 8);
  for (std::size_t i = 0; i < read.rgba.size(); ++i) EXPECT_NEAR(read.rgba[i], i % 4 == 3 ? 255 : 180, 1);
  const Image grey = decode(bytes_of(render::compress_grey(rgb.data(), camera, 100)));
  for (std::size_t i = 0; i < grey.rgba.size(); ++i) EXPECT_NEAR(grey.rgba[i], i % 4 == 3 ? 255 : 180, 1);
}

TEST(Image, ATruncatedFileIsRefused) {
  const auto cut = [](const Bytes& file) {
    for (std::size_t size = 0; size < file.size(); ++size) {
      EXPECT_NE(image_refusal({file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size)}), "accepted") << size;
    }
    EXPECT_EQ(image_refusal(file), "accepted");
  };
  cut(bytes_of(encode_png(9, 5, gradient(9, 5))));
  cut(png_of(2, 1, 8, 2, {0, 1, 2, 3, 0, 4, 5, 6}, {}, 1));
  CameraConfig camera;
  camera.width_px = 20;
  camera.height_px = 12;
  camera.layout = ImageLayout::hwc;
  const Bytes rgba = gradient(15, 16);
  cut(bytes_of(render::compress_rgb(rgba.data(), camera, 80)));
}

TEST(Image, ADamagedPngIsRefused) {
  const Bytes file = bytes_of(encode_png(9, 5, gradient(9, 5)));
  for (std::size_t i = 0; i < file.size(); ++i) {
    Bytes damaged = file;
    damaged[i] ^= 0x10;
    EXPECT_NE(image_refusal(damaged), "accepted") << i;
  }
}

TEST(Image, FilesWithoutAnImageAreRefused) {
  EXPECT_EQ(image_refusal({}), "x: expected a PNG or JPEG file, got an empty file");
  EXPECT_EQ(image_refusal(bytes_of("GIF89a")), "x: expected a PNG or JPEG file, got signature 0x47494638");
  EXPECT_NE(image_refusal({0xff, 0xd8, 0xff}), "accepted");
}

TEST(Image, SizesAreCheckedBeforeAnythingIsDecoded) {
  const Bytes row{0, 1, 2, 3};
  EXPECT_EQ(image_refusal(png_of(16385, 1, 8, 2, row)), "x: expected an image of 1 to 16384 pixels to a side, got 16385 x 1");
  EXPECT_EQ(image_refusal(png_of(1, 0x7fffffff, 8, 2, row)),
            "x: expected an image of 1 to 16384 pixels to a side, got 1 x 2147483647");
  EXPECT_EQ(image_refusal(png_of(16384, 16384, 8, 2, row)).rfind("x: expected a complete image file, got 16384 x 16384", 0), 0U);
  EXPECT_EQ(image_refusal(png_of(3, 2, 8, 2, row), 5), "x: expected at most 5 pixels, got 3 x 2");
  EXPECT_NE(image_refusal(png_of(0, 1, 8, 2, row)), "accepted");
  // Only the header of a JPEG file.
  const Bytes jpeg{0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0xea, 0x60, 0xea, 0x60, 1, 1, 0x11, 0, 0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0};
  EXPECT_EQ(image_refusal(jpeg), "x: expected an image of 1 to 16384 pixels to a side, got 60000 x 60000");
}

}  // namespace
}  // namespace flockstep
