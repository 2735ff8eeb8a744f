#include "collision/convex.hpp"

#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "collide.hpp"
#include "collision/convex_distance.hpp"
#include "flockstep/world_builder.hpp"

namespace flockstep::collision {
namespace {

using namespace testing;

// Triangles with a vertex at each corner of a box, and `inside` more in it.
MeshPart box_of_triangles(Random& random, const Vec3& half, int inside) {
  MeshPart part;
  for (int i = 0; i < 8 + inside; ++i) {
    const Vec3 corner =
        i < 8 ? Vec3((i & 1) != 0 ? 1.0F : -1.0F, (i & 2) != 0 ? 1.0F : -1.0F, (i & 4) != 0 ? 1.0F : -1.0F) : random.point(0.99F);
    part.vertices.push_back(corner.cwiseProduct(half));
  }
  for (std::int32_t i = 0; i + 2 < 8 + inside; ++i) part.triangles.push_back({i, i + 1, i + 2});
  return part;
}

std::shared_ptr<const World> world_of(const std::vector<MeshPart>& parts) {
  WorldBuilder builder;
  const std::uint16_t grey = builder.material({.name = "grey"});
  for (const MeshPart& part : parts) builder.mesh(part, grey);
  return builder.build();
}

TEST(Corners, TheFarthestCornerIsThatOfAllCorners) {
  Random random(31);
  for (const float size : {0.01F, 1.0F, 300.0F}) {
    const auto world = world_of({box_of_triangles(random, Vec3::Constant(size), 700)});
    const std::vector<Corners> parts = corners_of_objects(world->triangles());
    ASSERT_EQ(parts.size(), 1U);
    for (int i = 0; i < 300; ++i) {
      const Vec3d direction = random.direction().cast<double>() * std::pow(10.0, i % 7 - 3);
      double farthest = -1e300;
      for (const Vec3& vertex : world->triangles().vertices) farthest = std::max(farthest, vertex.cast<double>().dot(direction));
      // Another corner would be nearer by far more than the rounding error of a sum.
      EXPECT_NEAR(parts[0].support(direction).dot(direction), farthest, 1e-14 * direction.norm() * static_cast<double>(size));
    }
    EXPECT_NEAR(parts[0].radius(), std::sqrt(3.0) * static_cast<double>(size), 1e-6 * static_cast<double>(size));
  }
}

TEST(Corners, EachObjectHasItsOwn) {
  Random random(32);
  const auto world = world_of({box_of_triangles(random, {1, 1, 1}, 10), box_of_triangles(random, {2, 1, 1}, 20)});
  const std::vector<Corners> parts = corners_of_objects(world->triangles());
  ASSERT_EQ(parts.size(), 2U);
  EXPECT_EQ(parts[0].support(Vec3d::UnitX()).x(), 1.0);
  EXPECT_EQ(parts[1].support(Vec3d::UnitX()).x(), 2.0);
}

TEST(Corners, TheNearestPointOfAHullIsThatOfItsBox) {
  Random random(33);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 half(random.within(0.05F, 3.0F), random.within(0.05F, 3.0F), random.within(0.05F, 3.0F));
    const auto world = world_of({box_of_triangles(random, half, 30)});
    const std::vector<Corners> parts = corners_of_objects(world->triangles());
    const Pose pose{random.point(2.0F), random.rotation()};
    const Convex hull = make_hull(parts[0], pose);
    const Convex box =
        make_convex({.kind = PrimitiveKind::box, .center = pose.position, .rotation = pose.rotation, .half_extents = half});
    const Vec3d point = random.point(6.0F).cast<double>();
    const double distance = (closest_point(box, point) - point).norm();
    const Vec3d nearest = closest_point(hull, point);
    EXPECT_NEAR((nearest - point).norm(), distance, 3e-4 * distance + 1e-6);
    if (distance < 1e-4) continue;
    // The plane through the point never cuts the hull.
    const Vec3d normal = (point - nearest).normalized();
    const Vec3d farthest = hull.center + hull.rotation * support(hull, hull.rotation.transpose() * normal);
    EXPECT_LE(normal.dot(farthest - nearest), 1e-9);
  }
}

// A solid beside the hull, and a plane between them.
struct Beside {
  Convex solid;
  Vec3d normal;      // of the plane, from the solid to the hull
  double gap = 0.0;  // m, along the normal
};

Beside any_beside(Random& random, const Hull& hull, const Mat3d& rotation) {
  constexpr PrimitiveKind kKinds[] = {PrimitiveKind::sphere, PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::capsule};
  const PrimitiveKind kind = kKinds[random.generator()() % 4];
  const auto size = static_cast<float>(std::pow(10.0, random.within(-3.3F, 0.0F)));
  Vec3 half = Vec3::Constant(size);
  if (kind == PrimitiveKind::box) half = size * (Vec3::Constant(0.2F) + random.point(0.8F).cwiseAbs());
  if (kind == PrimitiveKind::cylinder) half.z() = size * random.within(0.2F, 4.0F);
  if (kind == PrimitiveKind::capsule) half.z() = size * random.within(1.0F, 4.0F);
  Beside beside{make_convex({.kind = kind, .center = Vec3::Zero(), .rotation = random.rotation(), .half_extents = half}),
                random.direction().normalized().cast<double>().normalized(), std::pow(10.0, -4.0 + 3.0 * random.within(0, 1))};
  const Vec3d nearest = rotation * hull.vertex(hull.support(-(rotation.transpose() * beside.normal).cast<float>()));
  beside.solid.center = nearest - (supporting_plane(beside.solid, beside.normal).offset + beside.gap) * beside.normal;
  const Vec3d aside = random.point(0.5F).cast<double>();
  beside.solid.center += aside - aside.dot(beside.normal) * beside.normal;
  return beside;
}

TEST(ConvexDistance, SeparatesWhatAPlaneSeparates) {
  Random random(5U + part_tried());
  const Hull hull(quadrotor());
  const long pairs = times_tried(100'000);
  for (long pair = 0; pair < pairs; ++pair) {
    const Mat3d rotation = random.rotation().toRotationMatrix().cast<double>();
    const Beside beside = any_beside(random, hull, rotation);
    const Vec3d guess = random.generator()() % 2 == 0 ? Vec3d(-beside.solid.center) : random.direction().cast<double>();
    const Separation found = separate(hull, rotation, Vec3d::Zero(), beside.solid, guess);
    ASSERT_FALSE(found.overlapping) << "pair " << pair << ", gap " << beside.gap;
    EXPECT_GE(found.distance, beside.gap - 1e-6) << "pair " << pair;
    EXPECT_GE(found.gap, (1.0 - 3e-4) * beside.gap - 2e-6) << "pair " << pair;
  }
}

TEST(ConvexDistance, NoFaceOfABoxIsAShorterWayOut) {
  Random random(6U + part_tried());
  const Hull hull(quadrotor());
  const Convex box = make_convex({.kind = PrimitiveKind::box, .half_extents = Vec3::Ones()});
  const long poses = times_tried(50'000 / kThinning);
  for (long pose = 0; pose < poses; ++pose) {
    const Mat3d rotation = random.rotation().toRotationMatrix().cast<double>();
    const Vec3d position = random.point(1.4F).cast<double>();
    if (!separate(hull, rotation, position, box, position).overlapping) continue;
    const auto length_along = [&](const Vec3d& normal) {
      double nearest = std::numeric_limits<double>::infinity();
      for (int i = 0; i < hull.count(); ++i) nearest = std::min(nearest, normal.dot(position + rotation * hull.vertex(i)));
      return normal.cwiseAbs().sum() - nearest;
    };
    const double found = length_along(penetrate(hull, rotation, position, box).normal);
    for (int face = 0; face < 6; ++face) {
      ASSERT_LT(found, length_along((face < 3 ? 1.0 : -1.0) * Vec3d::Unit(face % 3)) + 1e-6) << "pose " << pose;
    }
  }
}

}  // namespace
}  // namespace flockstep::collision
