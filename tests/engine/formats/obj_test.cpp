#include <random>

#include "formats/mesh_files.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;

class Obj : public ::testing::Test {
 protected:
  ~Obj() override { std::filesystem::remove(path_); }

  TriangleMesh load(const std::string& text) const {
    std::ofstream(path_, std::ios::binary) << text;
    return load_obj(path_).mesh;
  }

  // Returns the message without its leading path.
  std::string message_of(const std::string& text) const {
    const std::string what = refusal([&] { load(text); }), path = path_.string();
    EXPECT_TRUE(what == "accepted" || what.starts_with(path)) << what;
    return what.starts_with(path) ? what.substr(path.size()) : what;
  }

  std::filesystem::path path_ = std::filesystem::path(::testing::TempDir()) / "flockstep_obj_test.obj";
};

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

bool with_uv(const ObjNames&) { return true; }

// Returns the lines of the vertices of a convex polygon, and that of its face without its end.
std::pair<std::string, std::string> thousand_corners() {
  std::string vertices, face = "f";
  for (int i = 1; i <= 1000; ++i) {
    vertices += "v " + std::to_string(i) + ' ' + std::to_string(i * i) + " 0\n";
    face += ' ' + std::to_string(i);
  }
  return {vertices, face};
}

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
  EXPECT_TRUE(names(message_of(objects + "o more\nf 1 2 3\n"), R"(:131078: ... 65536 ... "more")"));
  EXPECT_EQ(parse_obj(materials, "x").mesh.materials.back(), 65531);
  EXPECT_TRUE(names(message_of(materials + "usemtl more\nf 1 2 3\n"), R"(:131070: ... 65532 ... "more")"));
}

TEST_F(Obj, AnObjectOfManyCornersIsOne) {
  const auto [vertices, face] = thousand_corners();
  std::string text = "o a\nusemtl red\n";
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
  EXPECT_TRUE(names(message_of("v 0 0 zero\n"), R"(:1: ... "v 0 0 zero")"));
  EXPECT_TRUE(names(message_of("v 0 0\n"), R"(:1: ... "v 0 0")"));
  EXPECT_TRUE(names(message_of("v 0 0 nan\n"), R"(:1: ... "v 0 0 nan")"));
  EXPECT_TRUE(names(message_of("v 0 0 1e39\n"), R"(:1: ... "v 0 0 1e39")"));
  EXPECT_TRUE(names(message_of(kSquare + "f 1 2 5\n"), R"(:5: ... 4 ... "5")"));
  EXPECT_TRUE(names(message_of(kSquare + "f 1 2 -5\n"), R"(:5: ... 4 ... "-5")"));
  EXPECT_TRUE(names(message_of(kSquare + "f 0 1 2\n"), R"(:5: ... 4 ... "0")"));
  EXPECT_TRUE(names(message_of(kSquare + "\nf 1 2 x/1\n"), R"(:6: ... "f 1 2 x/1")"));
  EXPECT_TRUE(names(message_of(kSquare + "f 1 2\n"), R"(:5: ... "f 1 2")"));
  EXPECT_TRUE(names(message_of(kSquare), ": ... face"));
  EXPECT_TRUE(names(message_of(""), ": ... face"));
}

TEST_F(Obj, LinesEndInAnyOfThreeWays) {
  const std::string lines[] = {"v 0 0 0", "v 1 0 0", "", "# v", "v 1 1 0", "f 1 2 3"};
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    std::string text;
    for (const std::string& line : lines) text += line + end;
    EXPECT_EQ(load(text).triangles.size(), 1U);
    EXPECT_TRUE(names(message_of(text + "f 1 2 4" + end), R"(:7: ... 3 ... "4")"));
  }
  EXPECT_TRUE(names(message_of("v 5\r6\r7\r"), R"(:1: ... "v 5")"));
  EXPECT_TRUE(names(message_of(kSquare + "f 1 2 3\rf 1 2 99999999"), R"(:6: ... 4 ... "99999999")"));
}

TEST_F(Obj, OtherLinesAreSkipped) {
  const std::string others =
      "vt 1\nvn x\nvp 1 2\nl 1 99999999\np 77 -77\nt crease 2147483647/2147483647/2147483647\nmtllib /dev/zero\n"
      "usemtl no\ng\ns off\nvw 1 0 2147483647 1\nfoo\n";
  EXPECT_EQ(load(others + kSquare + others + "f 1/9/9 2//-8 3/x\n" + others).triangles.size(), 1U);
}

TEST_F(Obj, FacesHaveAThousandCornersAtMost) {
  const auto [vertices, face] = thousand_corners();
  EXPECT_EQ(load(vertices + face + '\n').triangles.size(), 998U);
  EXPECT_TRUE(names(message_of(vertices + face + " 1\n"), ":1001: ... 1000"));
}

TEST_F(Obj, MessagesAreShortAndUtf8) {
  EXPECT_TRUE(names(message_of("v 1 2 \xFC\n"), R"(:1: ... "v 1 2 ?")"));
  EXPECT_LT(message_of("v " + std::string(1000000, 'x')).size(), 200U);
}

TEST(ObjFile, AMissingFileIsNamed) {
  EXPECT_REFUSED(load_obj("no-such.obj"), "no-such.obj: cannot read an OBJ file: No such file or directory");
}

using Point = std::array<double, 2>;
using CornerTriples = std::vector<CornerTriple>;

double turn(const Point& a, const Point& b, const Point& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

double shoelace(const std::vector<Point>& polygon) {
  double sum = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    sum += 0.5 * (a[0] * b[1] - a[1] * b[0]);
  }
  return sum;
}

// Returns whether a point is inside, by the number of edges that a ray to the right crosses.
bool is_inside(const Point& p, const std::vector<Point>& polygon) {
  bool inside = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double along = (p[1] - a[1]) / (b[1] - a[1]);
    if ((a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + along * (b[0] - a[0])) inside = !inside;
  }
  return inside;
}

// Checks the polygon in a plane that depends on the seed, in a random order and from a random first corner.
void expect_covered(std::vector<Point> polygon, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::rotate(polygon.begin(), polygon.begin() + static_cast<std::ptrdiff_t>(random() % polygon.size()), polygon.end());
  if (random() % 2 == 0) std::reverse(polygon.begin(), polygon.end());
  const double area = shoelace(polygon);
  const Eigen::Quaterniond turned =
      Eigen::Quaterniond(uniform(random), uniform(random), uniform(random), uniform(random)).normalized();
  const Eigen::Vector3d origin(uniform(random), uniform(random), uniform(random));
  std::vector<Vec3> corners;
  for (const Point& p : polygon) corners.push_back((origin + turned * Eigen::Vector3d(p[0], p[1], 0.0)).cast<float>());

  const CornerTriples triangles = cut_polygon(corners);
  ASSERT_EQ(triangles.size(), polygon.size() - 2);
  double sum = 0.0;
  for (const auto& [i, j, k] : triangles) {
    const Point &a = polygon[i], &b = polygon[j], &c = polygon[k];
    const double part = 0.5 * turn(a, b, c);
    EXPECT_GE(part / area, -1e-6);  // none is flipped
    sum += std::abs(part);
    const Point middle{(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0};
    EXPECT_TRUE(is_inside(middle, polygon) || std::abs(part / area) < 1e-5);
  }
  EXPECT_NEAR(sum / std::abs(area), 1.0, 1e-5);
}

// The same cut as by tinyobjloader 2.0.0rc10.
TEST(Polygon, ConvexOnesKeepTheTrianglesOfTinyobjloader) {
  const std::vector<Vec3> around{{-1, -1, 0}, {1, -1, 0}, {2, 0, 0}, {1, 1, 0}, {-1, 1, 0}, {-2, 0, 0}};
  EXPECT_EQ(cut_polygon(around), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}}));
  const std::vector<Vec3> beside{{5, 0, 0}, {7, 0, 0}, {8, 2, 0}, {6, 4, 0}, {4, 2, 0}};
  EXPECT_EQ(cut_polygon(beside), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}}));
  const std::vector<Vec3> backwards{{5, 0, 3}, {4, 2, 3}, {6, 4, 3}, {8, 2, 3}, {7, 0, 3}};
  EXPECT_EQ(cut_polygon(backwards), (CornerTriples{{2, 3, 4}, {2, 4, 0}, {0, 1, 2}}));
  const std::vector<Vec3> straight{{1, 1, 0}, {2, 1, 0}, {3, 1, 0}, {3, 2, 0}, {3, 3, 0}, {1, 3, 0}};
  EXPECT_EQ(cut_polygon(straight), (CornerTriples{{0, 1, 2}, {2, 3, 4}, {2, 4, 5}, {0, 2, 5}}));
  const std::vector<Vec3> upright{{-3, 5, 0}, {-3, 7, 1}, {-3, 9, 4}, {-3, 8, 7}, {-3, 6, 8}, {-3, 4, 6}, {-3, 3, 3}};
  EXPECT_EQ(cut_polygon(upright), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}}));
}

TEST(Polygon, QuadsAreCutAtTheShorterDiagonalThatIsInside) {
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}), (CornerTriples{{0, 1, 3}, {1, 2, 3}}));
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {3, -1, 0}, {4, 0, 0}, {3, 1, 0}}), (CornerTriples{{0, 1, 3}, {1, 2, 3}}));
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{3, -1, 0}, {4, 0, 0}, {3, 1, 0}, {0, 0, 0}}), (CornerTriples{{0, 1, 2}, {0, 2, 3}}));
  // An arrowhead, whose shorter diagonal lies outside.
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {4, -1, 0}, {3, 0, 0}, {4, 1, 0}}), (CornerTriples{{0, 1, 2}, {0, 2, 3}}));
}

TEST(Polygon, ConcaveOnesAreCoveredExactly) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.2, 1.0);
  for (unsigned seed = 0; seed < 500; ++seed) {
    std::vector<Point> star, band;
    const std::size_t count = 4 + seed % 40;
    for (std::size_t i = 0; i < count; ++i) {
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(count), radius = uniform(random);
      star.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    expect_covered(star, seed);
    const double width = 0.3 * uniform(random);  // for a spiral
    for (std::size_t i = 0; i < 2 * count; ++i) {
      const double angle = 0.4 * static_cast<double>(i < count ? i : 2 * count - 1 - i);
      const double radius = 1.0 + 0.2 * angle + (i < count ? 0.0 : width);
      band.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    expect_covered(band, seed);
  }
}

// A bridge is an edge used in both directions that connects a hole to the outline.
TEST(Polygon, CornersMayTouchAsThoseOfHolesAndBridges) {
  const std::vector<Point> one{{0, 0}, {1, 0}, {1, 1}, {1, 2}, {2, 2}, {2, 1}, {1, 1}, {1, 0}, {3, 0}, {3, 3}, {0, 3}};
  const std::vector<Point> slanted{{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
  const std::vector<Point> pinched{{0, 0}, {1, 0}, {4, 4}, {2.5, 0}, {4, 0}, {4, 4}, {0, 4}};  // a hole that touches a corner
  ASSERT_EQ(shoelace(one), 8.0);
  ASSERT_EQ(shoelace(pinched), 13.0);
  ASSERT_EQ(shoelace(slanted), 12.0);
  for (unsigned seed = 0; seed < 100; ++seed) {
    expect_covered(one, seed);
    expect_covered(slanted, seed);
    expect_covered(pinched, seed);
  }
}

// Includes polygons without area, and self-intersecting ones.
TEST(Polygon, AnyCornersBecomeTwoTrianglesFewer) {
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    const bool is_rough = i % 2 == 0;
    std::vector<Vec3> corners(3 + random() % (i % 30 == 0 ? 998 : 20));
    for (Vec3& corner : corners) {
      for (float& coordinate : corner) coordinate = static_cast<float>(is_rough ? random() % 3 : random());
    }
    const CornerTriples triangles = cut_polygon(corners);
    ASSERT_EQ(triangles.size(), corners.size() - 2);
    std::vector<bool> is_used(corners.size());
    for (const CornerTriple& triangle : triangles) {
      for (const std::size_t corner : triangle) is_used.at(corner) = true;
    }
    EXPECT_EQ(std::count(is_used.begin(), is_used.end(), false), 0);
  }
}

}  // namespace
}  // namespace flockstep
