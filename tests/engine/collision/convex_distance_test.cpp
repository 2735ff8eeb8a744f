#include "collision/convex_distance.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "collide.hpp"
#include "random.hpp"
#include "tried.hpp"

namespace flockstep::collision {
namespace {

// A solid beside the hull, and a plane between them.
struct Beside {
  Convex solid;
  Vec3d normal;      // of the plane, from the solid to the hull
  double gap = 0.0;  // m, along the normal
};

Beside any_beside(testing::Random& random, const Hull& hull, const Mat3d& rotation) {
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
  testing::Random random(5U + testing::part_tried());
  const Hull hull(testing::quadrotor());
  const long pairs = testing::times_tried(100'000);
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

}  // namespace
}  // namespace flockstep::collision
