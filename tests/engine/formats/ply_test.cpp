#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "flockstep/world.hpp"
#include "formats/mesh_files.hpp"
#include "refusal.hpp"

namespace flockstep {
namespace {

using Color = std::array<float, 3>;
using Triangles = std::vector<std::array<std::int32_t, 3>>;

const std::string kVertices = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
const std::string kFaces = "element face 1\nproperty list uchar int vertex_indices\n";
const std::string kPoints = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

std::string text_file(const std::string& header, const std::string& body) {
  return "ply\nformat ascii 1.0\n" + header + "end_header\n" + body;
}

std::string ply_refusal(const std::string& bytes) {
  return testing::refusal([&] { parse_ply(bytes, "x"); });
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
  EXPECT_EQ(ply_refusal(""), "x: expected a PLY file, which begins with a line ply, got \"\"");
  EXPECT_EQ(ply_refusal("solid"), "x: expected a PLY file, which begins with a line ply, got \"solid\"");
  EXPECT_EQ(ply_refusal("ply"), "x: expected a header that ends with end_header, got a truncated one");
  EXPECT_EQ(ply_refusal("ply\nformat ascii 1.0\n"), "x: expected a header that ends with end_header, got a truncated one");
  EXPECT_EQ(ply_refusal("ply\nend_header\n"), "x: header: expected a format line, got none");
  EXPECT_EQ(ply_refusal("ply\nformat ascii 2.0\nend_header\n"),
            "x: header: expected format ascii, binary_little_endian or binary_big_endian, and 1.0, got \"format ascii 2.0\"");
  EXPECT_EQ(with("element vertex\n"), "x: header: expected a name and a count after element, got \"element vertex\"");
  EXPECT_EQ(with("element vertex -1\n"), "x: header: expected a name and a count after element, got \"element vertex -1\"");
  EXPECT_EQ(with("property float x\n"),
            "x: header: expected format, comment, element and property, and end_header, got \"property float x\"");
  EXPECT_EQ(with("element a 1\nproperty half x\n"),
            "x: header: expected property, a type such as float or uchar, a name, got \"property half x\"");
  EXPECT_EQ(with("element a 1\nproperty list float int x\n"),
            "x: header: expected property list, an integer type, a type, a name, got \"property list float int x\"");
  EXPECT_EQ(with(kFaces, "3 0 0 0"), "x: header: expected one element vertex and one element face, got none");
  EXPECT_EQ(with(kVertices + kVertices, kPoints + kPoints),
            "x: header: expected one element vertex and one element face, got several");
  EXPECT_EQ(with(kVertices, kPoints), "x: expected at least one face, got a point cloud");
  EXPECT_EQ(with(kVertices + "element face 0\nproperty list uchar int vertex_indices\n", kPoints),
            "x: expected at least one face, got a point cloud");
  EXPECT_EQ(with(kVertices + "element tristrips 1\nproperty list int int vertex_indices\n", kPoints + "4 0 1 2 3"),
            "x: element tristrips: expected faces, got triangle strips, which are not supported");
  EXPECT_EQ(with("element vertex 999999999\nproperty float x\nproperty float y\nproperty float z\n" + kFaces, kPoints),
            "x: element vertex: expected a file that holds 999999999, got 24 bytes");
  EXPECT_EQ(with("element vertex 3\nproperty float x\nproperty float y\n" + kFaces, kPoints),
            "x: element vertex: expected one property x, one y and one z, got others");
  EXPECT_EQ(with(kVertices + "element face 1\nproperty list uchar int corners\n", kPoints + "3 0 1 2"),
            "x: element face: expected a list vertex_indices, got none");
  EXPECT_EQ(with(kVertices + kFaces, "0 0 0 1 0 zero 1 1 0 0 1 0 3 0 1 2"), "x: element vertex: expected a number, got \"zero\"");
  EXPECT_EQ(with(kVertices + kFaces, "0 0 0 1 0 nan 1 1 0 0 1 0 3 0 1 2"),
            "x: vertex 1: expected finite coordinates within +-1e+06 m, got nan");
  EXPECT_EQ(with(kVertices + kFaces, "0 0 0 1 0 0 1 1 0 0 1 2e6 3 0 1 2"),
            "x: vertex 3: expected finite coordinates within +-1e+06 m, got 2e+06");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "2 0 1"), "x: face 0: expected 3 to 1000 corners, got 2");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "1.5 0 1 2"), "x: element face: expected a length within the file, got 1.5");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "-3 0 1 2"), "x: element face: expected a length within the file, got -3");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "3 0 1 2.5"), "x: face 0: expected indices of vertices, got 2.5");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "3 0 1 -1"), "x: face 0: expected indices of vertices, got -1");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "3 0 1 4"), "x: element face: expected indices of 4 vertices, got 4");
  EXPECT_EQ(with(kVertices + kFaces, kPoints + "3 0 1"), "x: element face: expected a number, got the end of the file");
  std::string many;
  for (int i = 0; i < 1001; ++i) many += "element a 0\n";
  EXPECT_EQ(with(many), "x: header: expected at most 1000 elements and properties, got more");
  EXPECT_NE(with("element e\xFF 1\nproperty \xFF x\n").find("\"property ? x\""), std::string::npos);
}

// An element without properties takes no space, no matter how many there are.
TEST(Ply, NothingIsSkippedAtOnce) {
  EXPECT_EQ(ply_refusal(text_file("element nothing 18446744073709551615\n" + kVertices + kFaces, kPoints + "3 0 1 2")),
            "accepted");
}

TEST(Ply, IsAWorldOrPartOfOne) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_ply_test";
  std::filesystem::create_directories(folder);
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
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace flockstep
