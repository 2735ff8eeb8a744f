// The hull among bodies that move during the same motion: first contacts and pushes, against closed forms, an independent convex
// distance, and the sweep through a static world. batch/body_contacts_test.cpp compares first contacts with fine stepping.
#include "collision/moving_sweep.hpp"

#include "collision/moving_scenes.hpp"

namespace flockstep::collision {
namespace {

using namespace moving;

TEST(MovingSweep, ASphereRunsIntoATinyHull) {
  // |d + t v| = radius + standoff
  const Hull tiny{DroneModel(oracle::corners_of_box(Vec3::Constant(1e-3F)))};
  Random random(1);
  int hits = 0;
  for (int i = 0; i < 300; ++i) {
    const float radius = random.within(0.1F, 1.0F);
    const Pose from{random.point(2.0F), random.rotation()};
    const Pose to{random.point(2.0F), random.rotation()};
    const MovingBody ball{PrimitiveKind::sphere,
                          Vec3::Constant(radius),
                          {random.point(2.0F), random.rotation()},
                          {random.point(2.0F), random.rotation()}};
    const Eigen::Vector3d d = (from.position - ball.from.position).cast<double>();
    const Eigen::Vector3d v = (to.position - from.position - ball.to.position + ball.from.position).cast<double>();
    const double reach = static_cast<double>(radius) + kStandoff;
    if (d.norm() < reach + 0.01) continue;
    const double b = d.dot(v) / v.squaredNorm();
    const double root2 = b * b - (d.squaredNorm() - reach * reach) / v.squaredNorm();
    const double nearest = (d + std::clamp(-b, 0.0, 1.0) * v).norm();
    if (std::abs(nearest - reach) < 0.01) continue;
    const MovingContact contact = first_contact(open_air().obstacles, std::vector{ball.solid(7)}, tiny, from, to);
    ASSERT_EQ(contact.hit, nearest < reach) << i;
    if (!contact.hit) continue;
    ++hits;
    const double time = -b - std::sqrt(root2);
    // The tiny hull is up to 1.8 mm large.
    const double slope = std::abs((d + time * v).normalized().dot(v));
    ASSERT_NEAR(static_cast<double>(contact.fraction), time, 2.5e-3 / slope) << i;
    ASSERT_EQ(contact.body, 7);
    const Eigen::Vector3d center = oracle::Way{ball.from, ball.to}.position(static_cast<double>(contact.fraction));
    ASSERT_NEAR((contact.point.cast<double>() - center).norm(), static_cast<double>(radius), 1e-5) << i;
    ASSERT_GT(contact.normal.dot((from.position + contact.fraction * (to.position - from.position)) - contact.point), 0.0F);
  }
  EXPECT_GT(hits, 20);
}

TEST(MovingSweep, ABallThatTurnsFillsTheSameSpace) {
  Random random(6);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const Pose from{random.point(0.7F), random.rotation()};
    const Pose to{random.point(0.7F), random.rotation()};
    const float radius = std::pow(10.0F, random.within(-3.3F, -0.3F));
    MovingBody ball{PrimitiveKind::sphere, Vec3::Constant(radius), {random.point(1.0F), random.rotation()}, {}};
    ball.to = {ball.from.position + random.point(0.3F), random.rotation()};
    const MovingContact turning = first_contact(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), from, to);
    ball.from.rotation = ball.to.rotation;
    MovingContact standing = first_contact(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), from, to);
    ASSERT_LE((turning.velocity - standing.velocity).norm(), 3.2F * radius) << i;  // half a turn at most
    standing.velocity = turning.velocity;
    ASSERT_TRUE(same_bits(turning, standing)) << i;
    hits += turning.hit && !turning.inside;
  }
  EXPECT_GT(hits, 100);

  // A ball of 0.65 mm that turns by 149 degrees, 0.6 mm from a hull that stands.
  const Pose drone{{-0.613023579F, 0.000352323055F, 0.62301904F},
                   Quat(-0.118321374F, -0.516035199F, 0.785454392F, -0.320576191F)};
  const Vec3 center(-0.753358126F, 0.0563428551F, 0.448532552F);
  const MovingBody grain{PrimitiveKind::sphere,
                         Vec3::Constant(0.000654143631F),
                         {center, Quat(-0.64538449F, -0.266210765F, 0.433251649F, -0.570003331F)},
                         {center, Quat(0.331519872F, -0.359906733F, 0.869000316F, 0.0734856427F)}};
  EXPECT_NEAR(distance_at(grain, 0.5, drone, 1.0), 0.000618703, 1e-8);
  EXPECT_FALSE(first_contact(open_air().obstacles, std::vector{grain.solid(0)}, quadrotor_hull(), drone, drone).hit);
}

TEST(MovingSweep, AHullAndAPlateThatMeetAt50MetresPerSecond) {
  for (const float share : {0.0F, 0.3F, 0.5F, 1.0F}) {  // of the plate in the relative speed
    for (const float gap : {1e-3F, 0.01F, 0.25F, 0.49F}) {
      const float start = kFront + 0.0025F + gap;
      const std::vector<MovingSolid> bodies{plate(start, start - 0.5F * share).solid(0)};
      const Pose to{.position = {0.5F * (1.0F - share), 0, 0}};
      const MovingSweep result = sweep(open_air().obstacles, bodies, quadrotor_hull(), {}, to);
      ASSERT_TRUE(result.contact.hit);
      EXPECT_NEAR(0.5F * result.contact.fraction, gap - static_cast<float>(kStandoff), 2e-5F);
      // It stops where they meet, and the plate carries it back.
      const float met = 0.5F * (1.0F - share) * result.contact.fraction;
      EXPECT_NEAR(result.end.pose.position.x(), met - 0.5F * share * (1.0F - result.contact.fraction), 5e-5F);
      EXPECT_EQ(result.end.pushed, share > 0.0F);
      EXPECT_FALSE(result.end.jammed);
    }
  }
}

TEST(MovingSweep, AHullThatFliesAwayIsCaughtOnlyByAFasterPlate) {
  for (const float speed : {0.3F, 0.5F, 0.7F}) {
    const float start = -kFront - 0.0025F - 0.1F;
    const std::vector<MovingSolid> bodies{plate(start, start + speed).solid(0)};
    const MovingSweep result = sweep(open_air().obstacles, bodies, quadrotor_hull(), {}, {.position = {0.5F, 0, 0}});
    EXPECT_EQ(result.contact.hit, speed > 0.6F);
    EXPECT_FALSE(result.end.jammed);
    EXPECT_NEAR(result.end.pose.position.x(), std::max(0.5F, speed - 0.1F + static_cast<float>(kStandoff)), 5e-5F);
  }
}

TEST(MovingSweep, ABladeTurnsOntoATinyHullAtAKnownAngle) {
  // A blade of half thickness 1 cm along x turns about z. A point at (r, y) touches it at the angle a with
  // y cos a - r sin a = 0.01 + standoff.
  const Hull tiny{DroneModel(oracle::corners_of_box(Vec3::Constant(1e-4F)))};
  for (const float degrees : {10.0F, 60.0F, 179.0F}) {
    const MovingBody blade{PrimitiveKind::box, {2.0F, 0.01F, 0.5F}, {}, {.rotation = rotated(degrees, Vec3::UnitZ())}};
    for (const auto& [r, y] : {std::pair(0.5, 0.05), std::pair(1.5, 0.2), std::pair(1.9, 0.3), std::pair(0.1, 0.0125)}) {
      const double angle = std::atan2(y, r) - std::asin((0.01 + kStandoff + 1e-4) / std::hypot(r, y));
      const Pose there{.position = {static_cast<float>(r), static_cast<float>(y), 0}};
      const std::vector<MovingSolid> bodies{blade.solid(0)};
      const MovingSweep result = sweep(open_air().obstacles, bodies, tiny, there, there);
      ASSERT_TRUE(result.contact.hit) << degrees;
      const double met = static_cast<double>(result.contact.fraction * degrees) * std::numbers::pi / 180.0;
      EXPECT_NEAR(met * r, angle * r, 1.5e-4);
      EXPECT_TRUE(
          result.contact.normal.isApprox(rotated(result.contact.fraction * degrees, Vec3::UnitZ()) * Vec3::UnitY(), 1e-2F));
      const Vec3 speed = degrees * std::numbers::pi_v<float> / 180.0F * Vec3::UnitZ().cross(result.contact.point);
      EXPECT_TRUE(result.contact.velocity.isApprox(speed, 1e-4F));
      EXPECT_TRUE(result.end.pushed);
      EXPECT_FALSE(result.end.jammed);
      // It never slips through the blade: it ends at the leading side, or beyond the tip.
      const Vec3 local = rotated(-degrees, Vec3::UnitZ()) * result.end.pose.position;
      EXPECT_TRUE(local.y() > 0.01F || local.head<2>().norm() > 2.0F) << degrees << ": " << local.transpose();
    }
    const Pose beyond{.position = {2.2F, 0.1F, 0}};
    EXPECT_FALSE(first_contact(open_air().obstacles, std::vector{blade.solid(0)}, tiny, beyond, beyond).hit);
  }
}

TEST(MovingSweep, AtAHalfTurnTheSignsOfTheQuaternionDecide) {
  const Hull tiny{DroneModel(oracle::corners_of_box(Vec3::Constant(1e-4F)))};
  for (const float sign : {1.0F, -1.0F}) {
    const MovingBody blade{PrimitiveKind::box, {2.0F, 0.01F, 0.5F}, {}, {.rotation = Quat(0, 0, 0, sign)}};
    // The blade's tip at +x goes to +y and the other to -y, or the other way round, so each quadrant is swept by one of them.
    for (const float y : {0.3F, -0.3F}) {
      for (const float x : {1.0F, -1.0F}) {
        const Pose there{.position = {x, y, 0}};
        const MovingSweep result = sweep(open_air().obstacles, std::vector{blade.solid(0)}, tiny, there, there);
        ASSERT_TRUE(result.contact.hit);
        EXPECT_EQ(result.contact.fraction < 0.5F, sign * x * y > 0.0F);
        EXPECT_TRUE(result.end.pushed);
        EXPECT_FALSE(result.end.jammed);
      }
    }
  }
}

TEST(MovingSweep, NoMotionTouchesNothing) {
  const std::vector<MovingSolid> bodies{plate(-1, -1).solid(0)};
  const MovingSweep result = sweep(open_air().obstacles, bodies, quadrotor_hull(), {}, {});
  EXPECT_FALSE(result.contact.hit);
  EXPECT_EQ(result.contact.body, -1);
  EXPECT_EQ(result.end.pose.position, Vec3::Zero());
  EXPECT_FALSE(result.end.pushed || result.end.jammed);
  // In touch, at the standoff, bodies may move along the hull and away from it.
  const float beside = -kFront - 0.0025F - static_cast<float>(kStandoff);
  for (const Vec3& way : {Vec3(0, 0, 0), Vec3(0, 0.5F, 0.2F), Vec3(-0.3F, 0.1F, 0)}) {
    MovingBody body = plate(beside, beside);
    body.to.position += way;
    EXPECT_FALSE(sweep(open_air().obstacles, std::vector{body.solid(0)}, quadrotor_hull(), {}, {}).contact.hit);
  }
  EXPECT_EQ(first_contact(open_air().obstacles, std::vector{plate(beside, 0).solid(0)}, quadrotor_hull(), {}, {}).fraction, 0.0F);
}

TEST(MovingSweep, TheStaticWorldComesBeforeBodiesAtTheSameTime) {
  const Primitive wall{.kind = PrimitiveKind::box, .center = {1.5F, 0, 0}, .half_extents = {0.5F, 2, 2}};
  const Surroundings surroundings({wall});
  const Pose pose{wall.center, wall.rotation};
  const MovingSolid twin(wall.kind, wall.half_extents, pose, pose, 0);
  const Pose to{.position = {1, 0, 0}};
  EXPECT_EQ(first_contact(surroundings.obstacles, std::vector{twin}, quadrotor_hull(), {}, to).body, -1);
  const MovingSolid other(wall.kind, wall.half_extents, pose, pose, 4);
  EXPECT_EQ(first_contact(open_air().obstacles, std::vector{other, twin}, quadrotor_hull(), {}, to).body, 0);
  EXPECT_EQ(first_contact(open_air().obstacles, std::vector{twin, other}, quadrotor_hull(), {}, to).body, 0);
}

TEST(MovingSweep, APartOfAMotionIsThePartOfTheWhole) {
  Random random(5);
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const std::vector<MovingSolid> bodies{random_body(random, 1.0F, 0.5F, 90.0F).solid(0)};
    const Pose from{random.point(1.0F), random.rotation()};
    const Pose to = random_target(random, from, 0.5F, 0.0F);
    const MovingContact whole = first_contact(open_air().obstacles, bodies, quadrotor_hull(), from, to);
    if (!whole.hit || whole.inside || whole.fraction < 0.2F) continue;
    const float begin = random.within(0.1F, 0.8F) * whole.fraction;
    const Pose between = interpolate(from, to, begin);
    const MovingContact part =
        first_contact(open_air().obstacles, bodies, quadrotor_hull(), between, to, static_cast<double>(begin));
    ASSERT_TRUE(part.hit) << i;
    ++hits;
    ASSERT_LT((part.point - whole.point).norm(), 0.05F) << i;
    ASSERT_NEAR(begin + (1.0F - begin) * part.fraction, whole.fraction, 2e-3F) << i;
    ASSERT_LT((part.velocity - whole.velocity).norm(), 0.05F + 0.05F * whole.velocity.norm()) << i;
  }
  EXPECT_GT(hits, 100);
}

TEST(MovingSweep, ADoorIsNotPassedInEitherDirection) {
  // A door of 5 mm turns by up to a half turn about its middle, while the hull flies through the doorway.
  for (const float degrees : {5.0F, 20.0F, 90.0F, 179.0F}) {
    const MovingBody door{PrimitiveKind::box, {0.0025F, 1.0F, 2.0F}, {}, {.rotation = rotated(degrees, Vec3::UnitZ())}};
    const std::vector<MovingSolid> bodies{door.solid(0)};
    const MovingContact contact =
        first_contact(open_air().obstacles, bodies, quadrotor_hull(), {.position = {-1, 0.5F, 0}}, {.position = {1, 0.5F, 0}});
    ASSERT_TRUE(contact.hit) << degrees;
    EXPECT_LT(contact.fraction, 0.5F);
  }
}

// -- Bodies that stand still, and moving frames.

TEST(MovingSweep, BodiesThatStandStillAreObstaclesToTheBit) {
  Random random(2);
  int hits = 0, insides = 0;
  for (int place = 0; place < 60; ++place) {
    const Primitive room{.kind = PrimitiveKind::room, .half_extents = {3, 3, 2}};
    std::vector<Primitive> all{room};
    for (int i = 0; i < 6; ++i) {
      const MovingBody body = random_body(random, 2.0F, 0.0F, 0.0F);
      const Quat rotation = body.kind == PrimitiveKind::sphere ? Quat::Identity() : body.from.rotation;
      all.push_back({.kind = body.kind, .center = body.from.position, .rotation = rotation, .half_extents = body.half_extents});
    }
    const Surroundings full(all), empty({room});
    std::vector<MovingSolid> solids;
    for (const Primitive& solid : full.world.primitives()) {
      if (solid.kind == PrimitiveKind::room) continue;
      const Pose pose{solid.center, solid.rotation};
      solids.emplace_back(solid.kind, solid.half_extents, pose, pose, static_cast<int>(solids.size()));
    }
    for (int i = 0; i < 40; ++i) {
      const Pose from{random.point(2.5F), random.rotation()};
      const Pose to = random_target(random, from, 1.0F, 60.0F);
      const Contact expected = sweep(full.obstacles, quadrotor_hull(), from, to);
      const MovingSweep result = sweep(empty.obstacles, solids, quadrotor_hull(), from, to);
      ASSERT_TRUE(same_bits(expected, result.contact)) << place << ' ' << i;
      hits += expected.hit;
      insides += expected.inside;
      if (expected.inside) continue;
      ASSERT_FALSE(result.end.jammed);
      ASSERT_FALSE(result.end.pushed);
      const Pose end = expected.hit ? interpolate(from, to, expected.fraction) : to;
      ASSERT_EQ(result.end.pose.position, end.position);
    }
  }
  EXPECT_GT(hits, 300);
  EXPECT_GT(insides, 100);
}

TEST(MovingSweep, OnlyTheRelativeMotionCounts) {
  Random random(3);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    MovingBody body = random_body(random, 0.5F, 0.0F, 0.0F);
    const Pose from{random.point(1.5F), random.rotation()};
    const Pose to = random_target(random, from, 1.0F, 60.0F);
    const MovingContact still = first_contact(open_air().obstacles, std::vector{body.solid(0)}, quadrotor_hull(), from, to);
    if (still.inside) continue;
    // Both move on by the same vector. The sum is exact enough in float32.
    const Vec3 wind = random.point(2.0F);
    body.to.position += wind;
    const Pose blown{to.position + wind, to.rotation};
    const MovingContact moving = first_contact(open_air().obstacles, std::vector{body.solid(0)}, quadrotor_hull(), from, blown);
    ASSERT_EQ(still.hit, moving.hit) << i;
    if (!still.hit) continue;
    ++hits;
    ASSERT_NEAR(still.fraction, moving.fraction, 1e-3F) << i;
    ASSERT_LT((moving.point - moving.fraction * wind - still.point).norm(), 0.02F) << i;
    ASSERT_TRUE(moving.velocity.isApprox(wind, 1e-4F)) << i;
  }
  EXPECT_GT(hits, 100);
}

}  // namespace
}  // namespace flockstep::collision
