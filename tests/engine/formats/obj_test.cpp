#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "formats/mesh_files.hpp"

namespace flockstep {
namespace {

class Obj : public ::testing::Test {
 protected:
  ~Obj() override { std::filesystem::remove(path_); }

  TriangleMesh load(const std::string& text) const {
    std::ofstream(path_, std::ios::binary) << text;
    return load_obj(path_).mesh;
  }

  // Returns the message without its leading path.
  std::string message_of(const std::string& text) const {
    try {
      load(text);
    } catch (const std::invalid_argument& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.rfind(path_.string(), 0), 0U) << what;
      return what.substr(path_.string().size());
    }
    return "accepted";
  }

  std::filesystem::path path_ = std::filesystem::path(::testing::TempDir()) / "flockstep_obj_test.obj";
};

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

bool with_uv(const ObjNames&) { return true; }

double area(const TriangleMesh& mesh) {
  double sum = 0.0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto at = [&](std::int32_t i) { return mesh.vertices[static_cast<std::size_t>(i)]; };
    sum += 0.5 * (at(b) - at(a)).cross(at(c) - at(a)).z();
  }
  return sum;
}

TEST_F(Obj, ReadsTriangles) {
  const TriangleMesh mesh = load("# comment\r\no thing\r\n" + kSquare + "vn 0 0 1\nf 1 2 3\nf 1//1 3//1 4//1\n");
  EXPECT_EQ(mesh.vertices.size(), 4U);
  EXPECT_EQ(mesh.triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}, {0, 2, 3}}));
  EXPECT_EQ(mesh.vertices[2], Vec3(1, 1, 0));
}

TEST_F(Obj, TriangulatesPolygonsAlsoConcaveOnes) {
  EXPECT_DOUBLE_EQ(area(load(kSquare + "f 1 2 3 4\n")), 1.0);
  const std::string arrow = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\nv 0 2 0\n";  // area 4 - 1.5
  const TriangleMesh mesh = load(arrow + "f 1 2 3 4 5\n");
  EXPECT_EQ(mesh.triangles.size(), 3U);
  EXPECT_NEAR(area(mesh), 2.5, 1e-6);
}

TEST_F(Obj, NumbersAreRoundedCorrectly) {
  const TriangleMesh mesh =
      load("v 0.1 -16777217 3.4028234e38\nv +1.5e-3 .5 2.\nv 1e-30 0.30000001192092896 12345678.9\nf 1 2 3\n");
  EXPECT_EQ(mesh.vertices,
            (std::vector<Vec3>{{0.1F, -16777216.0F, 3.4028234e38F}, {1.5e-3F, 0.5F, 2.0F}, {1e-30F, 0.3F, 12345679.0F}}));
}

TEST_F(Obj, NegativeIndicesCountBack) {
  EXPECT_EQ(load(kSquare + "f -4 -3 -2\nv 5 5 5\n").triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}}));
}

TEST_F(Obj, KeepsTheOrderOfFacesOverGroupsAndMaterials) {
  const TriangleMesh mesh = load(kSquare + "g a\nf 1 2 3\nusemtl red\nf 1 3 4\ng b\nf 2 3 4\n");
  EXPECT_EQ(mesh.triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}, {0, 2, 3}, {1, 2, 3}}));
}

TEST_F(Obj, KeepsTextureCoordinatesIfRequested) {
  const std::string text = kSquare + "vt 0.25 0.75\nvt 0.5\nvt x 1\nvt 0 1 9\nf 1/1 2/2 3/4\nf 1/-3 3/4 4\nf 2/2 3/9 4/3\n";
  const TriangleMesh plain = load(text);
  EXPECT_TRUE(plain.uv.empty());
  EXPECT_EQ(plain.vertices.size(), 4U);
  const TriangleMesh mesh = parse_obj(text, "x", with_uv).mesh;
  // Vertices 0 and 2 get a copy for their second uv. Vertex 3 gets one for its invalid uv, which differs from having none.
  EXPECT_EQ(mesh.triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}, {4, 2, 3}, {1, 5, 6}}));
  EXPECT_EQ(mesh.uv, (std::vector<std::array<float, 2>>{{0.25F, 0.25F}, {0.5F, 1}, {0, 0}, {0, 0}, {0.5F, 1}, {0, 0}, {0, 0}}));
  EXPECT_EQ(mesh.vertices[4], mesh.vertices[0]);
  EXPECT_EQ(mesh.vertices[6], mesh.vertices[3]);
  EXPECT_TRUE(parse_obj(kSquare + "f 1/1 2/2 3/3\n", "x", with_uv).mesh.uv.empty());
}

TEST_F(Obj, ObjectsAndMaterialsAreNumberedByTheirFirstFaces) {
  const std::string f = "f 1 2 3\n";
  using Numbers = std::vector<std::uint16_t>;
  const auto read = [](const std::string& text) { return parse_obj(kSquare + text, "x"); };

  // Groups continue when their name appears again. A group without a face is dropped.
  ObjMesh mesh = read("usemtl none\n" + f + "g a\nusemtl  red stone \n" + f + "g b\ng c d\n" + f + "g a\nusemtl none\n" + f);
  EXPECT_EQ(mesh.mesh.objects, (Numbers{0, 1, 2, 1}));
  EXPECT_EQ(mesh.mesh.materials, (Numbers{0, 1, 1, 0}));
  EXPECT_EQ(mesh.names.materials, (std::vector<std::string>{"none", "red stone"}));

  // If there are objects, groups are ignored.
  mesh = read(f + "g a\n" + f + "o chair\n" + f + "g b\n" + f + "o table\n" + f);
  EXPECT_EQ(mesh.mesh.objects, (Numbers{0, 0, 1, 1, 2}));
  EXPECT_EQ(mesh.mesh.materials, (Numbers{0, 0, 0, 0, 0}));
  EXPECT_EQ(mesh.names.materials, std::vector<std::string>{""});

  mesh = read("mtllib a.mtl b c.mtl\nmtllib \\x\n" + f + "l 1 2\np 1\n");
  EXPECT_EQ(mesh.names.libraries, (std::vector<std::string>{"a.mtl b c.mtl", "\\x"}));
  EXPECT_EQ(mesh.ignored, std::vector<std::string>{"2 lines and points"});
}

TEST_F(Obj, NamesMarkCollisionOnlyObjects) {
  const std::string f = "f 1 2 3\n";
  const TriangleMesh mesh =
      load(kSquare + "o a\n" + f + "o UCX_a\n" + f + "o b-colonly\n" + f + "o UCX_a\n" + f + "o c-col\n" + f);
  EXPECT_EQ(mesh.objects, (std::vector<std::uint16_t>{0, 1, 2, 1, 3}));
  EXPECT_EQ(mesh.visibility, (std::vector<Visibility>{Visibility::full, Visibility::solid, Visibility::solid}));
  EXPECT_TRUE(load(kSquare + "g a\n" + f).visibility.empty());
}

TEST_F(Obj, ObjectsAndMaterialsAreOfBoundedNumber) {
  std::string objects = kSquare, materials = kSquare;
  for (int i = 0; i < 65536; ++i) {
    objects += "o " + std::to_string(i) + "\nf 1 2 3\n";
    if (i < 65532) materials += "usemtl " + std::to_string(i) + "\nf 1 2 3\n";
  }
  EXPECT_EQ(parse_obj(objects, "x").mesh.objects.back(), 65535);
  EXPECT_EQ(message_of(objects + "o more\nf 1 2 3\n"), ":131078: expected at most 65536 objects, got \"more\"");
  EXPECT_EQ(parse_obj(materials, "x").mesh.materials.back(), 65531);
  EXPECT_EQ(message_of(materials + "usemtl more\nf 1 2 3\n"), ":131070: expected at most 65532 materials, got \"more\"");
}

TEST_F(Obj, AnObjectOfManyCornersIsOne) {
  std::string vertices, text = "o a\nusemtl red\n";
  std::string face = "f";
  for (int i = 1; i <= 1000; ++i) {
    vertices += "v " + std::to_string(i) + ' ' + std::to_string(i * i) + " 0\n";
    face += ' ' + std::to_string(i);
  }
  for (int i = 0; i < 3; ++i) text += face + '\n';
  const ObjMesh mesh = parse_obj(vertices + text + "o b\n" + face, "x");
  ASSERT_EQ(mesh.mesh.triangles.size(), 4 * 998U);
  for (std::size_t i = 0; i < mesh.mesh.triangles.size(); ++i) {
    ASSERT_EQ(mesh.mesh.objects[i], i < 3 * 998 ? 0 : 1);
    ASSERT_EQ(mesh.mesh.materials[i], 0);
  }
}

TEST_F(Obj, ThreeNumbersBehindAVertexAreItsColorInSrgb) {
  const TriangleMesh mesh = load("v 0 0 0 1 0.5 0\nv 1 0 0 0.02 0 1\nv 1 1 0 9\nv 1 2 0 1 1 2\nv 2 2 0 0 0 0 0\nf 1 2 3\n");
  ASSERT_EQ(mesh.colors.size(), 5U);
  EXPECT_NEAR(mesh.colors[0][1], 0.2140, 1e-4);  // from tables of sRGB
  EXPECT_NEAR(mesh.colors[1][0], 0.001548, 1e-6);
  EXPECT_EQ(mesh.colors[0][0], 1.0F);
  EXPECT_EQ(mesh.colors[0][2], 0.0F);
  for (std::size_t i = 2; i < 5; ++i) EXPECT_EQ(mesh.colors[i], (std::array{1.0F, 1.0F, 1.0F}));
  EXPECT_TRUE(load(kSquare + "f 1 2 3\n").colors.empty());
}

TEST_F(Obj, BadFilesAreRefusedWithTheLine) {
  EXPECT_EQ(message_of("v 0 0 zero\n"), ":1: expected three finite coordinates after v, got \"v 0 0 zero\"");
  EXPECT_EQ(message_of("v 0 0\n"), ":1: expected three finite coordinates after v, got \"v 0 0\"");
  EXPECT_EQ(message_of("v 0 0 nan\n"), ":1: expected three finite coordinates after v, got \"v 0 0 nan\"");
  EXPECT_EQ(message_of("v 0 0 1e39\n"), ":1: expected three finite coordinates after v, got \"v 0 0 1e39\"");
  EXPECT_EQ(message_of(kSquare + "f 1 2 5\n"), ":5: expected a vertex index within the 4 vertices so far, got \"5\"");
  EXPECT_EQ(message_of(kSquare + "f 1 2 -5\n"), ":5: expected a vertex index within the 4 vertices so far, got \"-5\"");
  EXPECT_EQ(message_of(kSquare + "f 0 1 2\n"), ":5: expected a vertex index within the 4 vertices so far, got \"0\"");
  EXPECT_EQ(message_of(kSquare + "\nf 1 2 x/1\n"), ":6: expected vertex indices after f, got \"f 1 2 x/1\"");
  EXPECT_EQ(message_of(kSquare + "f 1 2\n"), ":5: expected at least three corners after f, got \"f 1 2\"");
  EXPECT_EQ(message_of(kSquare), ": expected at least one face, got none");
  EXPECT_EQ(message_of(""), ": expected at least one face, got none");
}

TEST_F(Obj, LinesEndInAnyOfThreeWays) {
  const std::string lines[] = {"v 0 0 0", "v 1 0 0", "", "# v", "v 1 1 0", "f 1 2 3"};
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    std::string text;
    for (const std::string& line : lines) text += line + end;
    EXPECT_EQ(load(text).triangles.size(), 1U);
    EXPECT_EQ(message_of(text + "f 1 2 4" + end), ":7: expected a vertex index within the 3 vertices so far, got \"4\"");
  }
  EXPECT_EQ(message_of("v 5\r6\r7\r"), ":1: expected three finite coordinates after v, got \"v 5\"");
  EXPECT_EQ(message_of(kSquare + "f 1 2 3\rf 1 2 99999999"),
            ":6: expected a vertex index within the 4 vertices so far, got \"99999999\"");
}

TEST_F(Obj, OtherLinesAreSkipped) {
  const std::string others =
      "vt 1\nvn x\nvp 1 2\nl 1 99999999\np 77 -77\nt crease 2147483647/2147483647/2147483647\nmtllib /dev/zero\n"
      "usemtl no\ng\ns off\nvw 1 0 2147483647 1\nfoo\n";
  EXPECT_EQ(load(others + kSquare + others + "f 1/9/9 2//-8 3/x\n" + others).triangles.size(), 1U);
}

TEST_F(Obj, FacesHaveAThousandCornersAtMost) {
  std::string vertices;
  std::string face = "f";
  for (int i = 1; i <= 1000; ++i) {
    vertices += "v " + std::to_string(i) + ' ' + std::to_string(i * i) + " 0\n";
    face += ' ' + std::to_string(i);
  }
  EXPECT_EQ(load(vertices + face + '\n').triangles.size(), 998U);
  EXPECT_NE(message_of(vertices + face + " 1\n").find(":1001: expected at most 1000 corners after f"), std::string::npos);
}

TEST_F(Obj, MessagesAreShortAndUtf8) {
  EXPECT_EQ(message_of("v 1 2 \xFC\n"), ":1: expected three finite coordinates after v, got \"v 1 2 ?\"");
  EXPECT_LT(message_of("v " + std::string(1000000, 'x')).size(), 200U);
}

TEST(ObjFile, AMissingFileIsNamed) {
  try {
    load_obj("no-such.obj");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "no-such.obj: cannot read an OBJ file: No such file or directory");
  }
}

}  // namespace
}  // namespace flockstep
