#include <bit>

#include "flockstep/world.hpp"
#include "formats/mesh_files.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Color = std::array<float, 3>;
using Triangles = std::vector<std::array<std::int32_t, 3>>;

const std::string kVertices = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
const std::string kFaces = "element face 1\nproperty list uchar int vertex_indices\n";
const std::string kPoints = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

std::string text_file(const std::string& header, const std::string& body) {
  return "ply\nformat ascii 1.0\n" + header + "end_header\n" + body;
}

std::string ply_refusal(const std::string& bytes) {
  return refusal([&] { parse_ply(bytes, "x"); });
}

// Builds the values of a binary file.
class PlyBytes {
 public:
  explicit PlyBytes(bool is_big) : is_big_(is_big) {}
  template <class T>
  PlyBytes& add(T value) {
    std::array<char, sizeof value> bytes{};
    std::memcpy(bytes.data(), &value, sizeof value);
    if (is_big_ != (std::endian::native == std::endian::big)) std::reverse(bytes.begin(), bytes.end());
    text_.append(bytes.data(), bytes.size());
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  bool is_big_;
  std::string text_;
};

TEST(Ply, ReadsText) {
  const PlyMesh read =
      parse_ply(text_file("comment by hand\nobj_info none\n" + kVertices + kFaces, kPoints + "4 0 1 2 3\n"), "x");
  EXPECT_EQ(read.mesh.vertices, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}));
  EXPECT_EQ(read.mesh.triangles.size(), 2U);
  EXPECT_TRUE(read.mesh.colors.empty());
  EXPECT_TRUE(read.ignored.empty());
}

// Every type, both in properties that are read and in properties that are skipped.
TEST(Ply, ReadsBinaryOfBothOrders) {
  for (const bool is_big : {false, true}) {
    for (const std::string end : {"\n", "\r\n", "\r"}) {
      std::string header =
          "ply\nformat " + std::string(is_big ? "binary_big_endian" : "binary_little_endian") +
          " 1.0\nelement extra 2\nproperty list uint16 float64 values\nproperty int8 one\n"
          "element vertex 3\nproperty int z\nproperty double x\nproperty short nx\nproperty list char uint skip\n"
          "property float32 y\nproperty ushort red\nproperty uint8 green\nproperty float blue\n"
          "element face 2\nproperty uint flags\nproperty list int ushort vertex_index\nend_header\n";
      for (std::size_t at = 0; (at = header.find('\n', at)) != header.npos; at += end.size()) header.replace(at, 1, end);
      PlyBytes bytes(is_big);
      bytes.add(std::uint16_t{2}).add(1.0).add(2.0).add(std::int8_t{10}).add(std::uint16_t{0}).add(std::int8_t{-1});
      for (std::int32_t i = 0; i < 3; ++i) {
        bytes.add(std::int32_t{-i}).add(0.1 + i).add(std::int16_t{7}).add(std::int8_t{1}).add(std::uint32_t{9});
        bytes.add(0.5F * static_cast<float>(i * i)).add(std::uint16_t{65535}).add(std::uint8_t{128}).add(0.5F);
      }
      bytes.add(std::uint32_t{1}).add(std::int32_t{3});
      for (const int corner : {0, 1, 2}) bytes.add(static_cast<std::uint16_t>(corner));
      bytes.add(std::uint32_t{1}).add(std::int32_t{3});
      for (const int corner : {2, 1, 0}) bytes.add(static_cast<std::uint16_t>(corner));

      const PlyMesh read = parse_ply(header + bytes.text(), "x");
      EXPECT_EQ(read.mesh.vertices, (std::vector<Vec3>{{0.1F, 0, 0}, {1.1F, 0.5F, -1}, {2.1F, 2, -2}}));
      EXPECT_EQ(read.mesh.triangles, (Triangles{{0, 1, 2}, {2, 1, 0}}));
      ASSERT_EQ(read.mesh.colors.size(), 3U);
      EXPECT_EQ(read.mesh.colors[2][0], 1.0F);
      EXPECT_NEAR(read.mesh.colors[2][1], 0.21586, 1e-5);  // from tables of sRGB
      EXPECT_NEAR(read.mesh.colors[2][2], 0.21404, 1e-5);
      EXPECT_EQ(read.ignored, std::vector<std::string>{"elements other than vertex and face"});
      for (std::size_t size = 0; size < header.size() + bytes.text().size(); ++size) {
        EXPECT_NE(ply_refusal((header + bytes.text()).substr(0, size)), "accepted") << size;
      }
    }
  }
}

TEST(Ply, CutsPolygonsAlsoConcaveOnes) {
  const std::string arrow =
      "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
      "property list uchar int vertex_indices\n";
  const PlyMesh read =
      parse_ply(text_file(arrow, "0 0 0 2 0 0 2 2 0 1 0.5 0 0 2 0 5 0 1 2 3 4 3 0 1 2"), "x");  // tokens need no line breaks
  EXPECT_EQ(read.mesh.triangles.size(), 4U);
  double area = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto corner = [&](std::size_t k) { return read.mesh.vertices[static_cast<std::size_t>(read.mesh.triangles[i][k])]; };
    area += 0.5 * (corner(1) - corner(0)).cross(corner(2) - corner(0)).z();
  }
  EXPECT_NEAR(area, 2.5, 1e-6);
  EXPECT_EQ(read.mesh.triangles[3], (std::array<std::int32_t, 3>{0, 1, 2}));
}

TEST(Ply, ColorsOfAnyTypeAreWithinOne) {
  const auto color = [](const std::string& type, const std::string& value) {
    const std::string header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty " + type +
                               " diffuse_red\nproperty uchar g\nproperty uchar b\n";
    const std::string rest = ' ' + value + " 0 255\n";
    return parse_ply(text_file(header + kFaces, "0 0 0" + rest + "1 0 0" + rest + "0 1 0" + rest + "3 0 1 2"), "x")
        .mesh.colors.at(0)[0];
  };
  EXPECT_EQ(color("uchar", "255"), 1.0F);
  EXPECT_EQ(color("uchar", "999"), 1.0F);
  EXPECT_EQ(color("uchar", "-1"), 0.0F);
  EXPECT_EQ(color("uchar", "nan"), 0.0F);
  EXPECT_EQ(color("int", "255"), 1.0F);
  EXPECT_EQ(color("ushort", "65535"), 1.0F);
  EXPECT_NEAR(color("ushort", "32896"), 0.21586, 1e-5);
  EXPECT_EQ(color("float", "1"), 1.0F);
  EXPECT_EQ(color("double", "inf"), 1.0F);
  EXPECT_EQ(color("float", "nan"), 0.0F);
}

TEST(Ply, IgnoredPartsAreNamed) {
  const PlyMesh read =
      parse_ply(text_file("comment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                          "property float s\nproperty float t\nproperty float nx\nelement face 1\n"
                          "property list uchar int vertex_indices\nproperty uchar red\nelement edge 1\nproperty int a\n",
                          "0 0 0 1 1 1 1 0 0 1 1 1 0 1 0 1 1 1 3 0 1 2 9 5"),
                "x");
  EXPECT_EQ(read.ignored, (std::vector<std::string>{"colours of faces", "elements other than vertex and face",
                                                    "texture coordinates", "textures"}));
}

TEST(Ply, BadFilesAreRefused) {
  const auto with = [](const std::string& header, const std::string& body = "") { return ply_refusal(text_file(header, body)); };
  EXPECT_TRUE(names(ply_refusal(""), R"(x: ... "")"));
  EXPECT_TRUE(names(ply_refusal("solid"), R"(x: ... "solid")"));
  EXPECT_TRUE(names(ply_refusal("ply"), "x: ... end_header"));
  EXPECT_TRUE(names(ply_refusal("ply\nformat ascii 1.0\n"), "x: ... end_header"));
  EXPECT_TRUE(names(ply_refusal("ply\nend_header\n"), "x: header: ... format"));
  EXPECT_TRUE(names(ply_refusal("ply\nformat ascii 2.0\nend_header\n"), R"(x: header: ... 1.0 ... "format ascii 2.0")"));
  EXPECT_TRUE(names(with("element vertex\n"), R"(x: header: ... "element vertex")"));
  EXPECT_TRUE(names(with("element vertex -1\n"), R"(x: header: ... "element vertex -1")"));
  EXPECT_TRUE(names(with("property float x\n"), R"(x: header: ... "property float x")"));
  EXPECT_TRUE(names(with("element a 1\nproperty half x\n"), R"(x: header: ... "property half x")"));
  EXPECT_TRUE(names(with("element a 1\nproperty list float int x\n"), R"(x: header: ... "property list float int x")"));
  EXPECT_TRUE(names(with(kFaces, "3 0 0 0"), "x: header: ... element"));
  EXPECT_TRUE(names(with(kVertices + kVertices, kPoints + kPoints), "x: header: ... element"));
  EXPECT_TRUE(names(with(kVertices, kPoints), "x: ... face"));
  EXPECT_TRUE(names(with(kVertices + "element face 0\nproperty list uchar int vertex_indices\n", kPoints), "x: ... face"));
  EXPECT_TRUE(names(with(kVertices + "element tristrips 1\nproperty list int int vertex_indices\n", kPoints + "4 0 1 2 3"),
                    "x: element tristrips: ... faces"));
  EXPECT_TRUE(names(with("element vertex 999999999\nproperty float x\nproperty float y\nproperty float z\n" + kFaces, kPoints),
                    "x: element vertex: ... 999999999 ... 24 bytes"));
  EXPECT_TRUE(
      names(with("element vertex 3\nproperty float x\nproperty float y\n" + kFaces, kPoints), "x: element vertex: ... property"));
  EXPECT_TRUE(names(with(kVertices + "element face 1\nproperty list uchar int corners\n", kPoints + "3 0 1 2"),
                    "x: element face: ... vertex_indices"));
  EXPECT_TRUE(names(with(kVertices + kFaces, "0 0 0 1 0 zero 1 1 0 0 1 0 3 0 1 2"), R"(x: element vertex: ... "zero")"));
  EXPECT_TRUE(names(with(kVertices + kFaces, "0 0 0 1 0 nan 1 1 0 0 1 0 3 0 1 2"), "x: vertex 1: ... +-1e+06 ... nan"));
  EXPECT_TRUE(names(with(kVertices + kFaces, "0 0 0 1 0 0 1 1 0 0 1 2e6 3 0 1 2"), "x: vertex 3: ... +-1e+06 ... 2e+06"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "2 0 1"), "x: face 0: ... 3 ... 1000 ... 2"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "1.5 0 1 2"), "x: element face: ... 1.5"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "-3 0 1 2"), "x: element face: ... -3"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "3 0 1 2.5"), "x: face 0: ... 2.5"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "3 0 1 -1"), "x: face 0: ... -1"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "3 0 1 4"), "x: element face: ... 4 ... 4"));
  EXPECT_TRUE(names(with(kVertices + kFaces, kPoints + "3 0 1"), "x: element face: ... number"));
  std::string many;
  for (int i = 0; i < 1001; ++i) many += "element a 0\n";
  EXPECT_TRUE(names(with(many), "x: header: ... 1000"));
  EXPECT_NE(with("element e\xFF 1\nproperty \xFF x\n").find("\"property ? x\""), std::string::npos);
}

// An element without properties takes no space, no matter how many there are.
TEST(Ply, NothingIsSkippedAtOnce) {
  EXPECT_EQ(ply_refusal(text_file("element nothing 18446744073709551615\n" + kVertices + kFaces, kPoints + "3 0 1 2")),
            "accepted");
}

TEST(Ply, IsAWorldOrPartOfOne) {
  const TempFolder folder;
  std::ofstream(folder / "a.PLY") << text_file(kVertices + kFaces, kPoints + "4 0 1 2 3\n");
  const std::string colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  std::ofstream(folder / "b.ply") << text_file("element vertex 4\nproperty float x\nproperty float y\nproperty float z\n" +
                                                   colors + "element face 2\nproperty list uchar int vertex_indices\n",
                                               "0 0 0 255 0 0 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 3 0 1 2 3 0 1 1");

  const auto plain = World::load(folder / "a.PLY", {.scale = 2.0, .origin = Vec3(0, 0, 1), .up = UpAxis::y});
  EXPECT_EQ(plain->name(), "a");
  EXPECT_EQ(plain->bounds().min, Vec3(0, 0, 1));
  EXPECT_EQ(plain->bounds().max, Vec3(2, 0, 3));
  EXPECT_EQ(plain->materials()[0].base_color, Material().base_color);

  const auto colored = World::load(folder / "b.ply");
  EXPECT_EQ(colored->materials()[0].base_color, (Color{1, 1, 1}));
  EXPECT_EQ(colored->triangles().colors[0], (Color{1, 0, 0}));
  ASSERT_EQ(colored->ignored().size(), 1U);
  EXPECT_EQ(colored->ignored()[0], "1 triangle without an area");

  std::ofstream(folder / "scene.json") << R"({"flockstep_scene": 1, "materials": {"red": {"base_color": [1, 0, 0]}},
    "meshes": [{"file": "a.PLY", "material": "red"}, {"file": "a.PLY", "position": [0, 0, 4]}]})";
  const auto scene = World::load(folder / "scene.json");
  EXPECT_EQ(scene->bounds().max, Vec3(1, 1, 4));
  EXPECT_EQ(scene->triangles().materials, (std::vector<std::uint16_t>{0, 0, 1, 1}));
}

}  // namespace
}  // namespace flockstep
