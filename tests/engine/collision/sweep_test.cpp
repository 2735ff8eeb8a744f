#include "collision/sweep.hpp"

#include "collision/places.hpp"

namespace flockstep::collision {
namespace {

using namespace places;

// -- Results known in closed form. The hull is 0.93 x 0.59 x 0.2 m.

// Standoff of the hull, and tolerance of the results.
constexpr float kStop = static_cast<float>(kStandoff);
constexpr float kTolerance = 2e-5F;

TEST(Sweep, FreeMotionIsFlownWhole) {
  const Place place({make(PrimitiveKind::box, {0, 0, 0}, {1, 1, 1})});
  const Contact contact = place.sweep(at(-3, 0, 3), at(3, 0, 3));
  EXPECT_FALSE(contact.hit);
  EXPECT_FALSE(contact.inside);
  EXPECT_EQ(contact.fraction, 1.0F);
  EXPECT_EQ(contact.normal, Vec3::Zero());
}

TEST(Sweep, StopsBeforeTheWallOfARoom) {
  const Place place({make(PrimitiveKind::room, {5, 5, 2}, {5, 5, 2})});
  const Contact contact = place.sweep(at(5, 5, 2), at(15, 5, 2));
  ASSERT_TRUE(contact.hit);
  EXPECT_NEAR(10.0F * contact.fraction, 5.0F - 0.465F - kStop, kTolerance);
  EXPECT_TRUE(contact.normal.isApprox(-Vec3::UnitX()));
  EXPECT_TRUE(contact.point.isApprox(Vec3(10, 5, 2), 1e-4F)) << contact.point.transpose();
}

TEST(Sweep, StopsBeforeFloorAndCeiling) {
  const Place place({make(PrimitiveKind::room, {0, 0, 2}, {5, 5, 2})});
  const Contact floor = place.sweep(at(0, 0, 2), at(0, 0, 0));
  ASSERT_TRUE(floor.hit);
  EXPECT_NEAR(2.0F * floor.fraction, 2.0F - 0.1F - kStop, kTolerance);
  EXPECT_TRUE(floor.normal.isApprox(Vec3::UnitZ()));
  EXPECT_TRUE(floor.point.isZero(1e-4F));
  EXPECT_NEAR(2.0F * place.sweep(at(0, 0, 2), at(0, 0, 4)).fraction, 1.9F - kStop, kTolerance);
}

TEST(Sweep, HeadOnIntoABoxACylinderASphereAndATriangle) {
  const TriangleMesh triangle{{{2, -3, -3}, {2, 3, -3}, {2, 0, 5}}, {{0, 1, 2}}, {0}};
  const std::vector<std::pair<const char*, std::unique_ptr<Place>>> places = [&] {
    std::vector<std::pair<const char*, std::unique_ptr<Place>>> result;
    const auto add = [&](const char* name, std::vector<Primitive> primitives, TriangleMesh mesh = {}) {
      result.emplace_back(name, std::make_unique<Place>(std::move(primitives), std::move(mesh)));
    };
    add("box", {make(PrimitiveKind::box, {2.5F, 0, 0}, {0.5F, 1, 1})});
    add("cylinder", {make(PrimitiveKind::cylinder, {2.5F, 0, 0}, {0.5F, 0.5F, 2})});
    add("lying cylinder's cap", {make(PrimitiveKind::cylinder, {2.5F, 0, 0}, {1, 1, 0.5F}, turn(90, Vec3::UnitY()))});
    add("sphere", {make(PrimitiveKind::sphere, {2.5F, 0, 0}, Vec3::Constant(0.5F))});
    add("capsule", {make(PrimitiveKind::capsule, {2.5F, 0, 0}, {0.5F, 0.5F, 2})});
    add("lying capsule's end", {make(PrimitiveKind::capsule, {3, 0, 0}, {0.3F, 0.3F, 1}, turn(90, Vec3::UnitY()))});
    add("plane", {make(PrimitiveKind::plane, {2, 0, 0}, {1, 2, 0}, turn(90, Vec3::UnitY()))});
    add("disc", {make(PrimitiveKind::disc, {2, 0, 0}, {1, 1, 0}, turn(-90, Vec3::UnitY()))});
    add("triangle", {}, triangle);
    return result;
  }();
  for (const auto& [name, place] : places) {
    SCOPED_TRACE(name);
    const Contact contact = place->sweep(at(0, 0, 0), at(4, 0, 0));
    ASSERT_TRUE(contact.hit);
    EXPECT_FALSE(contact.inside);
    EXPECT_NEAR(4.0F * contact.fraction, 2.0F - 0.465F - kStop, kTolerance);
    EXPECT_TRUE(contact.normal.isApprox(-Vec3::UnitX(), 1e-3F)) << contact.normal.transpose();
    EXPECT_NEAR(contact.point.x(), 2.0F, 1e-3F);
  }
}

TEST(Sweep, GrazesAPillarOnlyWithinReach) {
  const Place place({make(PrimitiveKind::cylinder, {0, 0, 0}, {0.25F, 0.25F, 3})});
  const float beside = 0.25F + 0.295F;
  EXPECT_FALSE(place.sweep(at(-2, beside + 2e-4F, 0), at(2, beside + 2e-4F, 0)).hit);
  EXPECT_TRUE(place.sweep(at(-2, beside - 2e-4F, 0), at(2, beside - 2e-4F, 0)).hit);
}

TEST(Sweep, NothingIsTooThinOrTooFar) {
  const Place wall({make(PrimitiveKind::box, {5, 0, 0}, {0.005F, 5, 5})});
  const Place sheet({}, {{{5, -5, -5}, {5, 5, -5}, {5, 0, 9}}, {{0, 1, 2}}, {0}});
  for (const float length : {5.0F, 10.0F, 100.0F, 1000.0F}) {
    EXPECT_NEAR(length * wall.sweep(at(0, 0, 0), at(length, 0, 0)).fraction, 4.995F - 0.465F, 1e-3F) << length;
    EXPECT_NEAR(length * sheet.sweep(at(0, 0, 0), at(length, 0, 0)).fraction, 5.0F - 0.465F, 1e-3F) << length;
  }
  EXPECT_TRUE(sheet.sweep(at(0, 0, 0), at(1e6F, 0, 0)).hit);
}

TEST(Sweep, ASheetOfNoThicknessStopsFromBothSidesAtAnyLength) {
  // The sheet is upright or rotated about its normal, which is the direction of flight.
  for (const PrimitiveKind kind : {PrimitiveKind::plane, PrimitiveKind::disc}) {
    for (const float about : {0.0F, 33.0F}) {
      for (const Vec3& direction : {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 0, 1), Vec3(0, 0, -1), Vec3(0.48F, -0.6F, 0.64F)}) {
        const Quat facing = testing::facing(Vec3::UnitZ(), direction) * turn(about, Vec3::UnitZ());
        const Place place({make(kind, 3.0F * direction, {4, 4, 0}, facing)});
        double reach = 0.0;  // m, extent of the hull along the flight
        for (const Vec3& point : quadrotor().hull()) reach = std::max(reach, static_cast<double>(point.dot(direction)));
        for (const float length : {2.9F, 3.0F, 3.1F, 4.0F, 10.0F, 1e3F, 1e5F}) {
          const Pose there{length * direction, Quat::Identity()};
          const Contact contact = place.sweep(at(0, 0, 0), there);
          ASSERT_TRUE(contact.hit) << length;
          ASSERT_FALSE(contact.inside);
          EXPECT_NEAR(static_cast<double>(length * contact.fraction), 3.0 - reach - kStandoff,
                      3e-5 + 5e-7 * static_cast<double>(length));
          EXPECT_TRUE(contact.normal.isApprox(-direction, 1e-3F)) << contact.normal.transpose();
          if (length < 4.0F) continue;
          const Contact back = place.sweep(there, at(0, 0, 0));
          ASSERT_TRUE(back.hit) << length;
          EXPECT_TRUE(back.normal.isApprox(direction, 1e-3F)) << back.normal.transpose();
        }
        // Small steps in the same direction get no farther, and no pose on the path overlaps.
        Pose pose = at(0, 0, 0);
        for (int step = 0; step < 80; ++step) {
          const Pose next{pose.position + 0.07F * direction, turn(static_cast<float>(step), Vec3(1, 2, 3).normalized())};
          const Contact contact = place.sweep(pose, next);
          ASSERT_FALSE(contact.inside) << step;
          if (contact.hit) pose = interpolate(pose, next, contact.fraction);
          if (!contact.hit) pose = next;
          ASSERT_LT(pose.position.dot(direction), 3.0F) << step;
          ASSERT_FALSE(place.overlaps(pose)) << step;
        }
      }
    }
  }
}

TEST(Sweep, FliesBesideASheetAndAlongIt) {
  const Place plane({make(PrimitiveKind::plane, {0, 0, 0}, {1, 1, 0})});
  const Place disc({make(PrimitiveKind::disc, {0, 0, 0}, {1, 1, 0})});
  for (const Place* place : {&plane, &disc}) {
    EXPECT_FALSE(place->sweep(at(-3, 0, 0.1F + 2e-4F), at(3, 0, 0.1F + 2e-4F)).hit) << "over it";
    EXPECT_FALSE(place->sweep(at(-3, 0, -0.1F - 2e-4F), at(3, 0, -0.1F - 2e-4F)).hit) << "under it";
    EXPECT_TRUE(place->sweep(at(-3, 0, 0.1F - 2e-4F), at(3, 0, 0.1F - 2e-4F)).hit);
    EXPECT_FALSE(place->sweep(at(-3, 1.5F, 0), at(3, 1.5F, 0)).hit) << "past its edge";
    const Contact edge = place->sweep(at(-3, 0, 0), at(3, 0, 0));
    ASSERT_TRUE(edge.hit) << "onto its edge";
    EXPECT_NEAR(6.0F * edge.fraction, 2.0F - 0.465F - kStop, kTolerance);
    EXPECT_TRUE(place->overlaps(at(0, 0, 0.05F)));
  }
}

TEST(Sweep, TurningInPlaceHitsAWallAtAKnownAngle) {
  // A pole of half sizes (0.5, 0.05, 0.05) starts parallel to a wall at x = 0.3. At yaw a it reaches 0.5 sin a + 0.05 cos a.
  const Hull pole{DroneModel(oracle::corners_of_box({0.05F, 0.5F, 0.05F}))};
  const double reach = std::hypot(0.5, 0.05);
  const double angle = std::asin((0.3 - kStandoff) / reach) - std::atan2(0.05, 0.5);
  const Place solid({make(PrimitiveKind::box, {1.3F, 0, 0}, {1, 3, 3})});
  const Place room({make(PrimitiveKind::room, {-2.7F, 0, 0}, {3, 3, 3})});
  for (const Place* place : {&solid, &room}) {
    for (const float degrees : {90.0F, -90.0F, 179.0F, 60.0F}) {
      const Contact contact = sweep(place->obstacles, pole, at(0, 0, 0), at(0, 0, 0, yaw(degrees)));
      ASSERT_TRUE(contact.hit);
      EXPECT_NEAR(static_cast<double>(contact.fraction * std::abs(degrees) * kDegree), angle, 1e-4);
      EXPECT_TRUE(contact.normal.isApprox(-Vec3::UnitX(), 1e-4F));
    }
    EXPECT_FALSE(sweep(place->obstacles, pole, at(0, 0, 0), at(0, 0, 0, yaw(30))).hit);
  }
}

TEST(Sweep, HalfATurnIsSweptAllTheWay) {
  // A half turn about z moves the hull's long side through the post, although both end poses are free. A half turn about x
  // misses the post.
  const Place post({make(PrimitiveKind::cylinder, {0.35F, 0.35F, 0}, {0.02F, 0.02F, 3})});
  EXPECT_FALSE(post.overlaps(at(0, 0, 0)));
  EXPECT_TRUE(post.sweep(at(0, 0, 0), at(0, 0, 0, yaw(180))).hit);
  EXPECT_FALSE(post.overlaps(at(0, 0, 0, yaw(180))));
  EXPECT_FALSE(post.sweep(at(0, 0, 2.0F), at(0, 0, 2.0F, turn(180, Vec3::UnitX()))).hit);
}

TEST(Sweep, BeginningInsideIsReportedAndMayOnlyLeadOut) {
  const Place place({make(PrimitiveKind::room, {0, 0, 2}, {4, 4, 2}), make(PrimitiveKind::box, {1, 0, 2}, {0.5F, 0.5F, 0.5F})});
  const Contact in_box = place.sweep(at(0.2F, 0, 2), at(-2, 0, 2));
  EXPECT_TRUE(in_box.hit);
  EXPECT_TRUE(in_box.inside);
  EXPECT_EQ(in_box.fraction, 1.0F);
  EXPECT_EQ(place.sweep(at(0.2F, 0, 2), at(0.3F, 0, 2)).fraction, 0.0F) << "deeper";
  EXPECT_TRUE(in_box.normal.isApprox(-Vec3::UnitX(), 1e-3F)) << in_box.normal.transpose();
  const Contact in_wall = place.sweep(at(0, 3.9F, 2), at(0, 0, 2));
  EXPECT_TRUE(in_wall.inside);
  EXPECT_EQ(in_wall.fraction, 1.0F);
  EXPECT_EQ(place.sweep(at(0, 3.9F, 2), at(0, 3.95F, 2)).fraction, 0.0F) << "deeper";
  const Contact out_and_on = place.sweep(at(0, 3.9F, 2), at(0, -9, 2));
  EXPECT_TRUE(out_and_on.inside);
  EXPECT_GT(out_and_on.fraction, 0.5F);
  EXPECT_LT(out_and_on.fraction, 1.0F) << "the wall on the other side stops it";
  EXPECT_TRUE(in_wall.normal.isApprox(-Vec3::UnitY()));
  EXPECT_TRUE(place.overlaps(at(1, 0, 2))) << "wholly inside";
  EXPECT_TRUE(place.overlaps(at(20, 0, 2))) << "outside the room all is solid";
}

TEST(Sweep, NoMotionTouchesNothing) {
  const Place place({make(PrimitiveKind::room, {0, 0, 2}, {4, 4, 2})});
  EXPECT_FALSE(place.sweep(at(0, 0, 2), at(0, 0, 2)).hit);
  EXPECT_TRUE(place.sweep(at(0, 0, 0), at(0, 0, 0)).inside);
  Pose mirrored = at(0, 0, 2);
  mirrored.rotation.coeffs() = -mirrored.rotation.coeffs();
  EXPECT_FALSE(place.sweep(at(0, 0, 2), mirrored).hit) << "q and -q are one rotation";
}

TEST(Sweep, AtRestItMayLeaveAndSlideButNotPress) {
  const Quat tilt = turn(37, Vec3(1, 2, 3).normalized());
  const std::vector<Primitive> walls{
      make(PrimitiveKind::room, {-3, 0, 0}, {4, 20, 20}),
      make(PrimitiveKind::box, {2, 0, 0}, {1, 20, 20}),
      make(PrimitiveKind::box, {4, 8, 12}, {1, 30, 30}, tilt),
      make(PrimitiveKind::cylinder, {4, 8, 12}, {30, 30, 1}, tilt),
  };
  for (std::size_t i = 0; i < walls.size(); ++i) {
    SCOPED_TRACE(i);
    const Place place({walls[i]});
    const bool tilted = i >= 2;
    const Vec3 inwards = tilted ? tilt * (i == 2 ? Vec3::UnitX() : Vec3::UnitZ()) : Vec3::UnitX();
    const Vec3 along = inwards.unitOrthogonal();
    const Vec3 start = tilted ? Vec3(walls[i].center - 4.0F * inwards) : Vec3::Zero();
    const Pose from{start, turn(20, Vec3(3, 2, 1).normalized())};
    const Pose into{start + 6.0F * inwards, from.rotation};
    const Contact first = place.sweep(from, into);
    ASSERT_TRUE(first.hit);
    EXPECT_TRUE(first.normal.isApprox(-inwards, 1e-3F));
    Pose rest = interpolate(from, into, first.fraction);
    ASSERT_FALSE(place.overlaps(rest));
    for (int step = 0; step < 100; ++step) {
      const Pose press{rest.position + 0.1F * inwards + 0.05F * along, rest.rotation};
      const Contact pressed = place.sweep(rest, press);
      ASSERT_TRUE(pressed.hit);
      ASSERT_FALSE(pressed.inside);
      ASSERT_EQ(pressed.fraction, 0.0F);
      const Pose slid{rest.position + 0.05F * (step % 2 ? along : -along), rest.rotation};
      ASSERT_FALSE(place.sweep(rest, slid).hit) << step;
      ASSERT_FALSE(place.sweep(rest, {rest.position - 0.05F * inwards, yaw(5) * rest.rotation}).hit) << step;
      rest = slid;
    }
  }
}

TEST(Sweep, ReportsTheFirstOfSeveral) {
  const Place place({make(PrimitiveKind::box, {4, 0, 0}, {0.5F, 1, 1}),
                     make(PrimitiveKind::sphere, {2, 0, 0}, Vec3::Constant(0.5F)),
                     make(PrimitiveKind::room, {0, 0, 0}, {9, 9, 9})});
  EXPECT_NEAR(10.0F * place.sweep(at(0, 0, 0), at(10, 0, 0)).fraction, 1.5F - 0.465F, 1e-3F);
  EXPECT_NEAR(10.0F * place.sweep(at(7, 0, 0), at(-3, 0, 0)).fraction, 2.5F - 0.465F, 1e-3F);
}

TEST(Interpolate, EndsAreExactAndTheMiddleIsHalfway) {
  const Pose from = at(1, 2, 3, yaw(10));
  const Pose to = at(2, 4, 7, yaw(90));
  EXPECT_EQ(interpolate(from, to, 0.0F).position, from.position);
  EXPECT_EQ(interpolate(from, to, 1.0F).rotation.coeffs(), to.rotation.coeffs());
  const Pose middle = interpolate(from, to, 0.5F);
  EXPECT_TRUE(middle.position.isApprox(Vec3(1.5F, 3, 5)));
  EXPECT_LT(middle.rotation.angularDistance(yaw(50)), 1e-3F);
  Pose mirrored = to;
  mirrored.rotation.coeffs() = -mirrored.rotation.coeffs();
  EXPECT_LT(interpolate(from, mirrored, 0.5F).rotation.angularDistance(yaw(50)), 1e-3F);
}

}  // namespace
}  // namespace flockstep::collision
