#include "world/obj.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace flockstep {
namespace {

class Obj : public testing::Test {
 protected:
  ~Obj() override { std::filesystem::remove(path_); }

  TriangleMesh load(const std::string& text) const {
    std::ofstream(path_, std::ios::binary) << text;
    return load_obj(path_);
  }

  // The message without the path it begins with.
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

  std::filesystem::path path_ = std::filesystem::path(testing::TempDir()) / "flockstep_obj_test.obj";
};

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

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

TEST_F(Obj, NegativeIndicesCountBack) {
  EXPECT_EQ(load(kSquare + "f -4 -3 -2\nv 5 5 5\n").triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}}));
}

TEST_F(Obj, KeepsTheOrderOfFacesOverGroupsAndMaterials) {
  const TriangleMesh mesh = load(kSquare + "g a\nf 1 2 3\nusemtl red\nf 1 3 4\ng b\nf 2 3 4\n");
  EXPECT_EQ(mesh.triangles, (std::vector<std::array<std::int32_t, 3>>{{0, 1, 2}, {0, 2, 3}, {1, 2, 3}}));
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
