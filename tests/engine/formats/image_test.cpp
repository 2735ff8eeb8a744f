#include "formats/image.hpp"

#include "base/json_document.hpp"
#include "formats/scene_json.hpp"
#include "render/jpeg.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

Image decode(const Bytes& file) { return decode_image(file, "x"); }

std::string image_refusal(const Bytes& file, std::size_t max_pixels = kMaxScenePixels) {
  return refusal([&] { decode_image(file, "x", max_pixels); });
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
  CameraConfig camera{.width_px = 16, .height_px = 8, .layout = ImageLayout::hwc};
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
  CameraConfig camera{.width_px = 20, .height_px = 12, .layout = ImageLayout::hwc};
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
  EXPECT_TRUE(names(image_refusal({}), "x: ... JPEG"));
  EXPECT_TRUE(names(image_refusal(bytes_of("GIF89a")), "x: ... signature 0x47494638"));
  EXPECT_NE(image_refusal({0xff, 0xd8, 0xff}), "accepted");
}

TEST(Image, SizesAreCheckedBeforeAnythingIsDecoded) {
  const Bytes row{0, 1, 2, 3};
  EXPECT_TRUE(names(image_refusal(png_of(16385, 1, 8, 2, row)), "x: ... 1 ... 16384 ... 16385 x 1"));
  EXPECT_TRUE(names(image_refusal(png_of(1, 0x7fffffff, 8, 2, row)), "x: ... 1 ... 16384 ... 1 x 2147483647"));
  EXPECT_TRUE(names(image_refusal(png_of(16384, 16384, 8, 2, row)), "x: ... 16384 x 16384"));
  EXPECT_TRUE(names(image_refusal(png_of(3, 2, 8, 2, row), 5), "x: ... 5 ... 3 x 2"));
  EXPECT_NE(image_refusal(png_of(0, 1, 8, 2, row)), "accepted");
  // Only the header of a JPEG file.
  const Bytes jpeg{0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0xea, 0x60, 0xea, 0x60, 1, 1, 0x11, 0, 0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0};
  EXPECT_TRUE(names(image_refusal(jpeg), "x: ... 1 ... 16384 ... 60000 x 60000"));
}

// -- Textures in scene files.

const std::vector<std::uint8_t> kPixels{255, 0, 0, 255, 0, 0, 255, 0};  // red, transparent blue

std::string png() { return encode_png(2, 1, kPixels); }

// Returns a scene with a triangle of the material "wood", which has the given texture.
std::string textured_scene(const std::string& texture, const std::string& mesh = R"(, "uv": [[0, 0], [1, 0], [0.1, 2]])") {
  return R"({"flockstep_scene": 1, "textures": {"planks": )" + texture +
         R"(}, "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}, "red": {"base_color": [1, 0, 0]}},
             "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]], "material": "wood")" +
         mesh + "}]}";
}

std::string base64(const std::string& more = "") { return R"({"png_base64": ")" + base64_of(png()) + '"' + more + '}'; }

std::string texture_refusal(const std::string& text) {
  return refusal([&] { World::from_json(text); });
}

using Uv = std::vector<std::array<float, 2>>;

TEST(SceneTextures, AreReadWithTheirWrapAndTheMeshesUv) {
  const auto world = World::from_json(textured_scene(base64(R"(, "wrap": ["clamp", "mirror"])")));
  ASSERT_EQ(world->textures().size(), 1U);
  const Texture& texture = world->textures()[0];
  EXPECT_EQ(texture.name, "planks");
  EXPECT_EQ(texture.width_px, 2);
  EXPECT_EQ(texture.height_px, 1);
  EXPECT_EQ(texture.rgba, kPixels);
  EXPECT_EQ(texture.wrap, (std::array{TextureWrap::clamp, TextureWrap::mirror}));
  EXPECT_EQ(world->materials()[0].texture, 0);
  EXPECT_FALSE(world->materials()[1].texture);
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 0}, {1, 0}, {0.1F, 2}}));
}

TEST(SceneTextures, MeshesWithoutUvHaveZeros) {
  const std::string corners = R"({"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]])";
  const auto world = World::from_json(R"({"flockstep_scene": 1, "textures": {"planks": )" + base64() +
                                      R"(}, "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}}, "meshes": [)" +
                                      corners + "}, " + corners + R"(, "uv": [[1, 2], [3, 4], [5, 6]]}, )" + corners + "}]}");
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 0}, {0, 0}, {0, 0}, {1, 2}, {3, 4}, {5, 6}, {0, 0}, {0, 0}, {0, 0}}));
  EXPECT_EQ(World::from_json(world->to_json())->content_hash(), world->content_hash());
}

TEST(SceneTextures, ComeBackEqualAndInTheirOrder) {
  SceneDescription description;
  const std::array<TextureWrap, 3> wraps{TextureWrap::repeat, TextureWrap::mirror, TextureWrap::clamp};
  description.materials.clear();
  for (int i = 0; i < 12; ++i) {
    Texture texture{"texture " + std::to_string(11 - i), 3, 2, std::vector<std::uint8_t>(24, static_cast<std::uint8_t>(i))};
    texture.wrap = {wraps[static_cast<std::size_t>(i) % 3], wraps[static_cast<std::size_t>(i) / 3 % 3]};
    description.textures.push_back(texture);
    description.materials.push_back(Material{"material " + std::to_string(i)});
    if (i % 4 != 3) description.materials.back().texture = static_cast<std::uint16_t>(i);
  }
  description.mesh.vertices = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)};
  description.mesh.triangles = {{0, 1, 2}, {0, 3, 1}};
  description.mesh.objects = {0, 2};
  description.mesh.uv = {{0.1F, 1.0F / 3.0F}, {-1e-30F, 1e6F}, {0, -0.0F}, {0.3F, 1}};
  const World world(description);
  const auto again = World::from_json(world.to_json());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->to_json(), world.to_json());
  ASSERT_EQ(again->textures().size(), 12U);
  EXPECT_EQ(again->textures()[3].name, "texture 8");
  EXPECT_EQ(again->triangles().uv, world.triangles().uv);
}

TEST(SceneTextures, FilesLieBesideTheScene) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "below");
  std::ofstream(folder / "planks.png", std::ios::binary) << png();
  std::ofstream(folder / "hall.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
  const std::string text = R"({"flockstep_scene": 1, "textures": {"planks": {"file": "planks.png"}},
      "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}}, "meshes": [{"file": "hall.obj", "material": "wood"}]})";
  std::ofstream(folder / "a.json") << text;
  const auto world = World::load(folder / "a.json");
  EXPECT_EQ(world->textures()[0].rgba, kPixels);
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 1}, {1, 1}, {0, 0}}));
  EXPECT_EQ(World::from_json(world->to_json())->content_hash(), world->content_hash());

  const auto refusal = [&](const std::string& file) {
    return testing::refusal([&] { parse_scene(textured_scene(R"({"file": ")" + file + "\"}"), "x", folder / "below"); });
  };
  EXPECT_TRUE(names(refusal("../planks.png"), R"(x: /textures/planks/file: ... "../planks.png")"));
  const std::string place = (folder / "below/none.png").string();
  EXPECT_EQ(refusal("none.png"), "x: /textures/planks/file: " + place + ": cannot read an image: No such file or directory");
}

TEST(SceneTextures, BadOnesAreRefused) {
  EXPECT_TRUE(names(texture_refusal(textured_scene("{}")), R"(scene: /textures/planks: ... "file" ... "png_base64")"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(R"(, "file": "x.png")"))),
                    R"(scene: /textures/planks: ... "file" ... "png_base64")"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(R"(, "wrap": ["clamp"])"))),
                    R"(scene: /textures/planks/wrap: ... 2 ... ["clamp"])"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(R"(, "wrap": ["clamp", "tile"])"))),
                    R"(scene: /textures/planks/wrap/1: ... repeat, mirror, clamp ... tile)"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(R"(, "size": 2)"))), "scene: /textures/planks/size: unknown field"));
  EXPECT_TRUE(
      names(texture_refusal(textured_scene(R"({"png_base64": 7})")), "scene: /textures/planks/png_base64: ... string ... 7"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(R"({"png_base64": "a-b"})")),
                    R"(scene: /textures/planks/png_base64: ... base64 ... the character "-")"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(R"({"png_base64": "abcd"})")),
                    "scene: /textures/planks/png_base64: ... signature 0x69b71d"));
  std::string other = textured_scene(base64());
  other.replace(other.find(R"("texture": "planks")"), 19, R"("texture": "stones")");
  EXPECT_TRUE(names(texture_refusal(other), R"(scene: /materials/wood/texture: ... "stones")"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0]])")), "scene: /meshes/0/uv: ... (3) ... 1"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0], [0], [0, 0]])")),
                    "scene: /meshes/0/uv/1: ... 2 ... [0]"));
  EXPECT_TRUE(names(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0], [0, 1], [0, 1e7]])")),
                    "scene: /meshes/0/uv/2/1: ... +-1e+06 ... 10000000.0"));
  SceneDescription twice;
  twice.primitives.emplace_back();
  twice.textures.assign(2, Texture{"a", 1, 1, {0, 0, 0, 0}});
  EXPECT_THROW(World{twice}, std::invalid_argument);
}

}  // namespace
}  // namespace flockstep
