#include "world/tessellate.hpp"

#include <map>

#include "standard.hpp"

namespace flockstep {
namespace {

using Vec3d = Eigen::Vector3d;

// Distance from a point to the surface of a primitive, by textbook formulas.
double distance_to_surface(const Primitive& primitive, const Vec3& point) {
  const Vec3d local = primitive.rotation.cast<double>().conjugate() * (point - primitive.center).cast<double>();
  const Vec3d half = primitive.half_extents.cast<double>();
  if (primitive.kind == PrimitiveKind::sphere) return std::abs(local.norm() - half.x());
  if (primitive.kind == PrimitiveKind::capsule) {
    const double middle = half.z() - half.x();
    return std::abs((local - Vec3d(0, 0, std::clamp(local.z(), -middle, middle))).norm() - half.x());
  }
  Eigen::VectorXd outside;  // signed distances to the faces, whose intersection is the body
  if (primitive.kind == PrimitiveKind::cylinder) {
    outside = Eigen::Vector2d(local.head<2>().norm() - half.x(), std::abs(local.z()) - half.z());
  } else {
    outside = local.cwiseAbs() - half;
  }
  const double depth = outside.maxCoeff();
  return depth <= 0.0 ? -depth : outside.cwiseMax(0.0).norm();
}

struct Shape {
  Primitive primitive;
  double volume;
};

std::vector<Shape> shapes() {
  const Quat turn(Eigen::AngleAxisf(0.7F, Vec3(1, 2, 3).normalized()));
  constexpr double kPi = std::numbers::pi;
  return {
      {{.kind = PrimitiveKind::box, .center = {1, 2, 3}, .rotation = turn, .half_extents = {0.5F, 1, 2}}, 8.0},
      {{.kind = PrimitiveKind::room, .center = {7, 7, 2.625F}, .half_extents = {7, 7, 2.625F}}, -14.0 * 14.0 * 5.25},
      {{.kind = PrimitiveKind::cylinder, .center = {-1, 0, 2}, .rotation = turn, .half_extents = {0.5F, 0.5F, 2}}, kPi},
      {{.kind = PrimitiveKind::sphere, .center = {3, -2, 1}, .half_extents = {1.5F, 1.5F, 1.5F}}, 4.5 * kPi},
      // 4/3 pi r^3 for the caps, plus pi r^2 times 2 (half height - r) between them.
      {{.kind = PrimitiveKind::capsule, .center = {1, 1, 0}, .rotation = turn, .half_extents = {0.5F, 0.5F, 2}},
       kPi / 6.0 + 0.75 * kPi},
      {{.kind = PrimitiveKind::capsule, .center = {0, 3, 0}, .rotation = turn, .half_extents = {0.75F, 0.75F, 0.75F}},
       0.5625 * kPi},
  };
}

TriangleMesh triangles_of(const Primitive& primitive, float chord_error_m) {
  SceneDescription description;
  description.primitives = {primitive};
  return tessellate(description, chord_error_m);
}

Vec3 corner(const TriangleMesh& mesh, std::size_t triangle, std::size_t k) {
  return mesh.vertices[static_cast<std::size_t>(mesh.triangles[triangle][k])];
}

// Returns the volume, which is positive if triangles are counter-clockwise seen from outside (divergence theorem).
double volume(const TriangleMesh& mesh) {
  double sum = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vec3d a = corner(mesh, i, 0).cast<double>();
    sum += a.dot(corner(mesh, i, 1).cast<double>().cross(corner(mesh, i, 2).cast<double>())) / 6.0;
  }
  return sum;
}

TEST(Tessellate, SurfacesAreClosedAndFaceFreeSpace) {
  for (const Shape& shape : shapes()) {
    const TriangleMesh mesh = triangles_of(shape.primitive, 1e-4F);
    EXPECT_NEAR(volume(mesh) / shape.volume, 1.0, 2e-3);
    std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
    for (const auto& [a, b, c] : mesh.triangles) {
      ++edges[{a, b}];
      ++edges[{b, c}];
      ++edges[{c, a}];
    }
    for (const auto& [edge, count] : edges) {
      ASSERT_EQ(count, 1);
      ASSERT_TRUE(edges.contains({edge.second, edge.first}));
    }
  }
}

TEST(Tessellate, ChordErrorIsHonouredAndUsed) {
  constexpr int kSteps = 6;
  for (const float chord_error : {0.1F, 1e-2F, 1e-3F}) {
    for (const Shape& shape : shapes()) {
      const TriangleMesh mesh = triangles_of(shape.primitive, chord_error);
      double largest = 0.0;
      for (const Vec3& vertex : mesh.vertices) ASSERT_LT(distance_to_surface(shape.primitive, vertex), 2e-6);
      for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        const Vec3 a = corner(mesh, i, 0);
        const Vec3 ab = corner(mesh, i, 1) - a;
        const Vec3 ac = corner(mesh, i, 2) - a;
        for (int u = 0; u <= kSteps; ++u) {
          for (int v = 0; u + v <= kSteps; ++v) {
            const Vec3 point = a + ab * (static_cast<float>(u) / kSteps) + ac * (static_cast<float>(v) / kSteps);
            largest = std::max(largest, distance_to_surface(shape.primitive, point));
          }
        }
      }
      EXPECT_LE(largest, chord_error + 2e-6);
      using enum PrimitiveKind;
      const PrimitiveKind kind = shape.primitive.kind;
      const bool is_round = kind == cylinder || kind == sphere || kind == capsule;
      // The mesh is not much finer than requested either. Only the coarsest mesh is, because of the minimum number of sides.
      if (is_round && chord_error < 0.1F) {
        EXPECT_GE(largest, 0.5 * chord_error);
      }
    }
  }
}

TEST(Tessellate, PlanesAndDiscsAreFlatAndFaceLocalZ) {
  const Quat turn(Eigen::AngleAxisf(0.7F, Vec3(1, 2, 3).normalized()));
  const Vec3 center(1, -2, 3);
  for (const float chord_error : {0.1F, 1e-2F, 1e-3F, 1e-4F}) {
    for (const Shape& shape : std::vector<Shape>{
             {{.kind = PrimitiveKind::plane, .center = center, .rotation = turn, .half_extents = {0.5F, 2, 0}}, 4.0},
             {{.kind = PrimitiveKind::disc, .center = center, .rotation = turn, .half_extents = {1.5F, 1.5F, 0}},
              2.25 * std::numbers::pi}}) {  // area in place of volume
      const bool is_disc = shape.primitive.kind == PrimitiveKind::disc;
      const TriangleMesh mesh = triangles_of(shape.primitive, chord_error);
      const Vec3d normal = (turn * Vec3::UnitZ()).cast<double>();
      double area = 0.0;
      std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
      for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        const Vec3d a = corner(mesh, i, 0).cast<double>();
        const Vec3d twice = (corner(mesh, i, 1).cast<double>() - a).cross(corner(mesh, i, 2).cast<double>() - a);
        area += 0.5 * twice.norm();
        EXPECT_LT((twice.normalized() - normal).norm(), 1e-5);
        for (std::size_t k = 0; k < 3; ++k) ++edges[{mesh.triangles[i][k], mesh.triangles[i][(k + 1) % 3]}];
      }
      // The sides of a disc's polygon are off by at most the chord error, so the area is off by at most that times the
      // perimeter.
      const double missing = is_disc ? static_cast<double>(chord_error) * 3.0 * std::numbers::pi : 0.0;
      EXPECT_LE(area, shape.volume + 1e-5);
      EXPECT_GE(area, shape.volume - missing - 1e-5);
      double farthest = 0.0;  // m, distance of the rim from its chords
      for (const auto& [edge, count] : edges) {
        ASSERT_EQ(count, 1);
        if (edges.contains({edge.second, edge.first})) continue;
        const auto at = [&](std::int32_t vertex) { return mesh.vertices[static_cast<std::size_t>(vertex)]; };
        const Vec3 middle = 0.5F * (at(edge.first) + at(edge.second)) - center;
        if (is_disc) {
          EXPECT_NEAR((at(edge.first) - center).norm(), 1.5F, 2e-6F);
          farthest = std::max(farthest, 1.5 - static_cast<double>(middle.norm()));
        } else {
          const Vec3 local = turn.conjugate() * middle;
          EXPECT_TRUE(std::abs(std::abs(local.x()) - 0.5F) < 2e-6F || std::abs(std::abs(local.y()) - 2.0F) < 2e-6F);
        }
      }
      EXPECT_LE(farthest, static_cast<double>(chord_error) + 2e-6);
      if (is_disc && chord_error < 0.1F) {
        EXPECT_GE(farthest, 0.5 * static_cast<double>(chord_error));
      }
      if (!is_disc) {
        EXPECT_EQ(mesh.triangles.size(), 2U);
      }
    }
  }
}

TEST(Tessellate, PrimitivesComeInOrderThenMeshes) {
  SceneDescription description;
  description.materials = {{"a"}, {"b"}, {"c"}};
  description.primitives = {{.kind = PrimitiveKind::room, .material = 2}, {.kind = PrimitiveKind::box, .material = 1}};
  description.mesh = {{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitY()}, {{0, 1, 2}}, {0}};
  const TriangleMesh mesh = tessellate(description, 1e-3F);
  ASSERT_EQ(mesh.triangles.size(), 25U);
  ASSERT_EQ(mesh.materials.size(), 25U);
  EXPECT_EQ(mesh.materials[0], 2);
  EXPECT_EQ(mesh.materials[12], 1);
  EXPECT_EQ(mesh.materials[24], 0);
  ASSERT_EQ(mesh.objects.size(), 25U);
  EXPECT_EQ(mesh.objects[0], 0);
  EXPECT_EQ(mesh.objects[11], 0);
  EXPECT_EQ(mesh.objects[12], 1);
  EXPECT_EQ(mesh.objects[24], 2);
  EXPECT_EQ(mesh.triangles[24], (std::array<std::int32_t, 3>{16, 17, 18}));
  EXPECT_EQ(mesh.vertices[17], Vec3(Vec3::UnitX()));
}

TEST(Tessellate, MeshesKeepTheirObjectsAfterThoseOfThePrimitives) {
  SceneDescription description;
  description.primitives = {{.kind = PrimitiveKind::plane, .half_extents = {1, 1, 0}}};
  description.mesh = {{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitY()}, {{0, 1, 2}, {2, 1, 0}}, {0, 0}, {3, 65534}};
  EXPECT_EQ(tessellate(description, 1e-3F).objects, (std::vector<std::uint16_t>{0, 0, 4, 65535}));
  description.mesh.objects = {3, 65535};  // would become 65536
  EXPECT_TRUE(tessellate(description, 1e-3F).objects.empty());
}

TEST(Tessellate, BadChordErrorsAreRefused) {
  SceneDescription description;
  description.primitives = {Primitive{}};
  for (const float bad : {0.0F, -1.0F, 1e-9F, kNan}) {
    EXPECT_THROW(tessellate(description, bad), std::invalid_argument) << bad;
  }
  EXPECT_EQ(tessellate(description, std::numeric_limits<float>::infinity()).triangles.size(), 12U);
}

TEST(Tessellate, MeshesOfGigabytesAreRefusedWithTheNumber) {
  SceneDescription scene;
  scene.primitives = {{.kind = PrimitiveKind::sphere, .half_extents = Vec3::Constant(1e6F)}};
  EXPECT_REFUSED(tessellate(scene, 1e-6F), "1e+08");
  EXPECT_LT(tessellate(scene, 1e3F).triangles.size(), 100000U);
}

}  // namespace
}  // namespace flockstep
