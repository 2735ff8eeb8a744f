// The hull among bodies that move during the same motion: first contacts and pushes, against closed forms, fine stepping with an
// independent convex distance, and the sweep through a static world.
#include "collision/moving_sweep.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "collide.hpp"
#include "collision/mover.hpp"
#include "convex_oracle.hpp"
#include "random.hpp"
#include "tried.hpp"

namespace flockstep::collision {
namespace {

using testing::Random;

const Hull& quadrotor_hull() {
  static const Hull body(testing::quadrotor());
  return body;
}

std::vector<Vec3> corners_of_box(const Vec3& half) {
  std::vector<Vec3> corners;
  for (const float x : {-1.0F, 1.0F}) {
    for (const float y : {-1.0F, 1.0F}) {
      for (const float z : {-1.0F, 1.0F}) corners.emplace_back(Vec3(x, y, z).cwiseProduct(half));
    }
  }
  return corners;
}

Quat rotated(float degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisf(degrees * std::numbers::pi_v<float> / 180.0F, axis.normalized()));
}

// A static world with its collision data.
struct Surroundings {
  explicit Surroundings(std::vector<Primitive> primitives)
      : world(SceneDescription{.primitives = std::move(primitives)}), scene(world), obstacles(world, scene) {}
  World world;
  trace::Scene scene;
  Obstacles obstacles;
};

const Surroundings& open_air() {
  static const Surroundings nothing({{.kind = PrimitiveKind::sphere, .center = {1000, 0, 0}}});
  return nothing;
}

// A body and its motion, from which both the solid and the oracle are made.
struct MovingBody {
  PrimitiveKind kind = PrimitiveKind::box;
  Vec3 half_extents = Vec3::Constant(0.5F);
  Pose from;
  Pose to;

  MovingSolid solid(int index) const { return {kind, half_extents, from, to, index}; }
};

std::vector<MovingSolid> solids_of(const std::vector<MovingBody>& bodies) {
  std::vector<MovingSolid> solids;
  for (const MovingBody& body : bodies) solids.push_back(body.solid(static_cast<int>(solids.size())));
  return solids;
}

Eigen::Vector3d position_at(const Pose& from, const Pose& to, double time) {
  return (1.0 - time) * from.position.cast<double>() + time * to.position.cast<double>();
}

Eigen::Quaterniond rotation_at(const Pose& from, const Pose& to, double time) {
  return from.rotation.cast<double>().normalized().slerp(time, to.rotation.cast<double>().normalized());
}

double turn_of(const Pose& from, const Pose& to) {
  return from.rotation.cast<double>().normalized().angularDistance(to.rotation.cast<double>().normalized());
}

oracle::Support body_at(const MovingBody& body, double time) {
  const oracle::Support local = oracle::solid({.kind = body.kind, .half_extents = body.half_extents});
  const Eigen::Vector3d position = position_at(body.from, body.to, time);
  const Eigen::Matrix3d rotation = rotation_at(body.from, body.to, time).toRotationMatrix();
  return [=](const Eigen::Vector3d& d) -> Eigen::Vector3d { return position + rotation * local(rotation.transpose() * d); };
}

// Returns the hull's distance from a body at one time, or a lower bound of it that exceeds `enough`.
double distance_at(const MovingBody& body, double time, const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation,
                   double enough) {
  const double reach = body.half_extents.cast<double>().norm() + static_cast<double>(testing::quadrotor().radius());
  const double bound = (position - position_at(body.from, body.to, time)).norm() - reach;
  if (bound > enough) return bound;
  return oracle::distance(oracle::hull_at(testing::quadrotor(), position, rotation), body_at(body, time)).lower;
}

double distance_at(const MovingBody& body, double time, const Pose& pose, double enough) {
  return distance_at(body, time, pose.position.cast<double>(), pose.rotation.cast<double>(), enough);
}

bool same_bits(const Contact& a, const Contact& b) {
  return a.hit == b.hit && a.inside == b.inside && a.fraction == b.fraction && a.point == b.point && a.normal == b.normal;
}

bool same_bits(const MovingSweep& a, const MovingSweep& b) {
  return same_bits(a.contact, b.contact) && a.contact.body == b.contact.body && a.contact.velocity == b.contact.velocity &&
         a.end.pose.position == b.end.pose.position && a.end.pose.rotation.coeffs() == b.end.pose.rotation.coeffs() &&
         a.end.pushed == b.end.pushed && a.end.jammed == b.end.jammed;
}

MovingBody random_body(Random& random, float spread, float length, float most_degrees) {
  using enum PrimitiveKind;
  const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere}[static_cast<std::size_t>(random.within(0, 3.999F))];
  const auto size = [&] { return random.within(0, 1) < 0.3F ? random.within(0.0025F, 0.01F) : random.within(0.05F, 0.8F); };
  const float a = size();
  Vec3 half(a, a, kind == capsule ? a + size() : size());
  if (kind == box) half.y() = size();
  if (kind == sphere) half.setConstant(a);
  MovingBody body{kind, half, {random.point(spread), random.rotation()}, {}};
  body.to.position = body.from.position + random.point(length);
  body.to.rotation = body.from.rotation;
  if (random.within(0, 1) < 0.7F && most_degrees > 0.0F) {
    body.to.rotation = (rotated(random.within(0, most_degrees), random.direction()) * body.from.rotation).normalized();
  }
  return body;
}

Pose random_target(Random& random, const Pose& from, float length, float most_degrees) {
  Pose to{from.position + random.point(length), from.rotation};
  if (random.within(0, 1) < 0.6F && most_degrees > 0.0F) {
    to.rotation = (rotated(random.within(0, most_degrees), random.direction()) * from.rotation).normalized();
  }
  return to;
}

// -- Results known in closed form. The hull is 0.93 x 0.59 x 0.2 m.

constexpr float kFront = 0.465F;  // m, extent of the hull along x

TEST(MovingSweep, ASphereRunsIntoATinyHull) {
  // |d + t v| = radius + standoff
  const Hull tiny{DroneModel(corners_of_box(Vec3::Constant(1e-3F)))};
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
    const Eigen::Vector3d center = position_at(ball.from, ball.to, static_cast<double>(contact.fraction));
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

// A plate of 5 mm that moves along x, at most 0.5 m in a motion of 10 ms: 50 m/s.
MovingBody plate(float from, float to) {
  return {PrimitiveKind::box, {0.0025F, 3, 3}, {.position = {from, 0, 0}}, {.position = {to, 0, 0}}};
}

TEST(MovingSweep, AFastThinPlateHitsAndPushesAStandingHull) {
  constexpr float kFace = 0.0025F;
  for (const float length : {0.5F, 5.0F, 100.0F}) {
    const float start = -kFront - kFace - 0.2F;
    const std::vector<MovingSolid> bodies{plate(start, start + length).solid(0)};
    const MovingSweep result = sweep(open_air().obstacles, bodies, quadrotor_hull(), {}, {});
    ASSERT_TRUE(result.contact.hit);
    EXPECT_EQ(result.contact.body, 0);
    EXPECT_NEAR(length * result.contact.fraction, 0.2F - static_cast<float>(kStandoff), 5e-5F);
    EXPECT_TRUE(result.contact.normal.isApprox(Vec3::UnitX(), 1e-4F));
    EXPECT_NEAR(result.contact.point.x(), -kFront - static_cast<float>(kStandoff), 5e-5F);
    EXPECT_TRUE(result.contact.velocity.isApprox(Vec3(length, 0, 0)));
    EXPECT_TRUE(result.end.pushed);
    EXPECT_FALSE(result.end.jammed);
    EXPECT_NEAR(result.end.pose.position.x(), length - 0.2F + static_cast<float>(kStandoff), 5e-5F + 2e-6F * length);
    EXPECT_TRUE(result.end.pose.rotation.isApprox(Quat::Identity()));
  }
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
  const Hull tiny{DroneModel(corners_of_box(Vec3::Constant(1e-4F)))};
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
  const Hull tiny{DroneModel(corners_of_box(Vec3::Constant(1e-4F)))};
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

// -- Random bodies, compared with fine stepping and an independent distance.

// Returns the first time at which the hull is within the standoff of a body, or a value above 1. Steps by 20 um or by the
// current distance, whichever is larger.
double first_time(const std::vector<MovingBody>& bodies, const Pose& from, const Pose& to) {
  double first = 2.0;
  for (const MovingBody& body : bodies) {
    const Eigen::Vector3d way = (to.position - from.position - body.to.position + body.from.position).cast<double>();
    const double reach = body.half_extents.cast<double>().norm();
    const double speed = std::max(1e-9, way.norm() + static_cast<double>(testing::quadrotor().radius()) * turn_of(from, to) +
                                            reach * turn_of(body.from, body.to));
    for (double time = 0.0; time <= 1.0 && time < first;) {
      const double beyond = distance_at(body, time, position_at(from, to, time), rotation_at(from, to, time), 0.5) - kStandoff;
      if (beyond <= 0.0) {
        first = time;
        break;
      }
      time = time < 1.0 ? std::min(1.0, time + std::max(beyond, 2e-5) / speed) : 2.0;
    }
  }
  return first;
}

double least_distance(const std::vector<MovingBody>& bodies, double time, const Eigen::Vector3d& position,
                      const Eigen::Quaterniond& rotation) {
  double least = std::numeric_limits<double>::infinity();
  for (const MovingBody& body : bodies) least = std::min(least, distance_at(body, time, position, rotation, 0.5));
  return least;
}

double speed_of(const std::vector<MovingBody>& bodies, const Pose& from, const Pose& to) {
  double most = 0.0;
  for (const MovingBody& body : bodies) {
    most = std::max(most, (to.position - from.position - body.to.position + body.from.position).cast<double>().norm() +
                              static_cast<double>(testing::quadrotor().radius()) * turn_of(from, to) +
                              body.half_extents.cast<double>().norm() * turn_of(body.from, body.to));
  }
  return std::max(most, 1e-9);
}

void compare_with_fine_stepping(unsigned seed, long cases, float length, float most_degrees) {
  Random random(seed + 100U * testing::part_tried());
  cases = testing::times_tried(cases);
  long hits = 0, frees = 0, insides = 0;
  for (long i = 0; i < cases; ++i) {
    SCOPED_TRACE(i);
    std::vector<MovingBody> bodies;
    for (int k = 0; k < 3; ++k) bodies.push_back(random_body(random, 1.2F, length, most_degrees));
    const std::vector<MovingSolid> solids = solids_of(bodies);
    const Pose from{random.point(0.7F), random.rotation()};
    const Pose to = random.within(0, 1) < 0.3F ? from : random_target(random, from, length, most_degrees);
    const auto distance = [&](double time) {
      return least_distance(bodies, time, position_at(from, to, time), rotation_at(from, to, time));
    };
    const MovingContact contact = first_contact(open_air().obstacles, solids, quadrotor_hull(), from, to);
    const double at_first = distance(0.0);
    if (std::abs(at_first) < 2.0 * kStandoff) continue;  // different rules apply at the standoff
    ASSERT_EQ(contact.inside, at_first <= 0.0);
    if (contact.inside) {
      ++insides;
      continue;
    }
    const double expected = first_time(bodies, from, to);
    if (!contact.hit) {
      ++frees;
      ASSERT_EQ(contact.body, -1);
      if (expected <= 1.0) {  // dips of a few micrometres below the standoff are ignored
        ASSERT_GT(distance(expected), kStandoff - 3e-5);
      }
      continue;
    }
    ++hits;
    const double speed = speed_of(bodies, from, to);
    const auto ended = static_cast<double>(contact.fraction);
    const double left = distance(ended);
    ASSERT_GT(left, kStandoff - 2e-6);
    ASSERT_LT(left, kStandoff + 2e-5);
    ASSERT_LT(ended * speed, expected * speed + 5e-5) << "flew through";
    const double before = std::max(0.0, ended - 1e-3 / speed);
    if ((distance(before) - left) / 1e-3 > 0.05) {  // else it may stop earlier in the last micrometres
      ASSERT_GT(ended * speed, expected * speed - 1e-3) << "stopped early";
    }
    ASSERT_GE(contact.body, 0);
    const MovingBody& met = bodies[static_cast<std::size_t>(contact.body)];
    ASSERT_LT(std::abs(distance_at(met, ended, position_at(from, to, ended), rotation_at(from, to, ended), 0.5) - left), 1e-5);
    // The contact point is on the body and beside the hull, and moves with the body.
    const oracle::Support point = oracle::polytope({contact.point.cast<double>()});
    ASSERT_LT(oracle::distance(body_at(met, ended), point).upper, 1e-5);
    const oracle::Support hull =
        oracle::hull_at(testing::quadrotor(), position_at(from, to, ended), rotation_at(from, to, ended));
    ASSERT_LT(oracle::distance(hull, point).upper, kStandoff + 2e-4);
    ASSERT_NEAR(contact.normal.norm(), 1.0F, 1e-5F);
    ASSERT_GT(contact.normal.cast<double>().dot(hull(-contact.normal.cast<double>()) - contact.point.cast<double>()), -1e-5);
    constexpr double kTick = 1e-4;
    const Eigen::Matrix3d rotation = rotation_at(met.from, met.to, ended).toRotationMatrix();
    const Eigen::Vector3d local = rotation.transpose() * (contact.point.cast<double>() - position_at(met.from, met.to, ended));
    const Eigen::Vector3d later =
        position_at(met.from, met.to, ended + kTick) + rotation_at(met.from, met.to, ended + kTick) * local;
    const Eigen::Vector3d velocity = (later - contact.point.cast<double>()) / kTick;
    ASSERT_LT((velocity - contact.velocity.cast<double>()).norm(), 5e-3 + 1e-3 * velocity.norm());
  }
  EXPECT_GT(hits, cases / 25);
  EXPECT_GT(frees, cases / 20);
  EXPECT_GT(insides, cases / 50);
  testing::tried("encounters", hits + frees);
}

TEST(MovingSweepAgainstFineStepping, ShortMotions) { compare_with_fine_stepping(1, 1500, 0.3F, 0.0F); }
TEST(MovingSweepAgainstFineStepping, ShortTurningMotions) { compare_with_fine_stepping(2, 1000, 0.2F, 20.0F); }
TEST(MovingSweepAgainstFineStepping, LongMotions) { compare_with_fine_stepping(3, 300, 3.0F, 0.0F); }
TEST(MovingSweepAgainstFineStepping, LongTurningMotions) { compare_with_fine_stepping(4, 200, 1.0F, 180.0F); }

// -- Pushes.

TEST(Push, ABodyNeverPushesTheHullThroughAWall) {
  // A thin wall at x = 1. The plate comes from the left, turned a little or not, and presses the hull to the wall.
  const Surroundings wall({{.kind = PrimitiveKind::box, .center = {1.001F, 0, 0}, .half_extents = {0.001F, 5, 5}}});
  for (const float length : {0.1F, 0.4F, 0.5F, 0.9F, 3.0F, 50.0F}) {
    for (const float degrees : {0.0F, 1.0F, 5.0F}) {
      MovingBody pusher = plate(-kFront - 0.1F, -kFront - 0.1F + length);
      pusher.to.rotation = rotated(degrees, Vec3(0, 1, 1));
      const MovingSweep result = sweep(wall.obstacles, std::vector{pusher.solid(0)}, quadrotor_hull(), {}, {});
      EXPECT_LT(result.end.pose.position.x(), 1.0F - kFront);
      EXPECT_FALSE(overlaps(wall.obstacles, quadrotor_hull(), result.end.pose));
      if (length > 0.6F && degrees == 0.0F) {
        EXPECT_TRUE(result.end.jammed) << length;
        EXPECT_NEAR(result.end.pose.position.x(), 1.0F - kFront, 2e-4F);
      }
      if (length < 0.45F && degrees < 3.0F) {
        EXPECT_FALSE(result.end.jammed) << length;
      }
    }
  }
}

TEST(Push, AnObliqueBodyPushesTheHullAlongAWall) {
  const Surroundings wall({{.kind = PrimitiveKind::box, .center = {0, 2, 0}, .half_extents = {20, 1, 20}}});
  for (const float degrees : {20.0F, 45.0F, 70.0F}) {  // between the wall and the face of the plate
    const Pose pose{.position = {0, 0.7F, 0}};
    MovingBody pusher = plate(0, 0);
    pusher.from.rotation = pusher.to.rotation = rotated(degrees, Vec3::UnitZ());
    const Vec3 normal = pusher.from.rotation * Vec3::UnitX();
    const oracle::Support hull =
        oracle::hull_at(testing::quadrotor(), pose.position.cast<double>(), pose.rotation.cast<double>());
    const float met = normal.dot(hull(-normal.cast<double>()).cast<float>());
    pusher.from.position = (met - 0.3F) * normal;
    pusher.to.position = (met + 0.15F) * normal;
    const MovingSweep result = sweep(wall.obstacles, std::vector{pusher.solid(0)}, quadrotor_hull(), pose, pose);
    EXPECT_TRUE(result.contact.hit);
    EXPECT_FALSE(result.end.jammed) << degrees;
    EXPECT_NEAR(result.end.pose.position.x(), 0.1525F / normal.x(), 0.02F) << degrees;
    EXPECT_FALSE(overlaps(wall.obstacles, quadrotor_hull(), result.end.pose));
    EXPECT_GT(distance_at(pusher, 1.0, result.end.pose, 1.0), 0.0);
  }
}

TEST(Push, TwoBodiesSqueezeTheHullOrPushItBetweenThem) {
  MovingBody left = plate(-0.6F, -0.3F), right = plate(0.6F, 0.3F);
  const MovingSweep squeezed = sweep(open_air().obstacles, solids_of({left, right}), quadrotor_hull(), {}, {});
  EXPECT_TRUE(squeezed.contact.hit);
  EXPECT_EQ(squeezed.contact.body, 0) << "the lowest index of two at the same time";
  EXPECT_TRUE(squeezed.end.jammed);
  right.to.position.x() = 0.9F;  // gives way
  left.to.position.x() = -0.3F;
  const MovingSweep carried = sweep(open_air().obstacles, solids_of({left, right}), quadrotor_hull(), {}, {});
  EXPECT_FALSE(carried.end.jammed);
  EXPECT_NEAR(carried.end.pose.position.x(), kFront + 0.0025F - 0.3F, 2e-4F);
  // From two sides at right angles, at the same time and one after the other.
  for (const float lead : {0.0F, 0.1F, -0.1F}) {
    MovingBody below = plate(0, 0);
    below.from.rotation = below.to.rotation = rotated(90, Vec3::UnitY());  // its normal is z
    below.from.position = {0, 0, -0.3F + lead};
    below.to.position = {0, 0, 0.2F};
    const std::vector<MovingBody> both{left, below};
    const MovingSweep result = sweep(open_air().obstacles, solids_of(both), quadrotor_hull(), {}, {});
    EXPECT_FALSE(result.end.jammed) << lead;
    EXPECT_NEAR(result.end.pose.position.x(), kFront + 0.0025F - 0.3F, 3e-4F);
    EXPECT_NEAR(result.end.pose.position.z(), 0.1F + 0.0025F + 0.2F, 3e-4F);
  }
}

TEST(Push, ABodyThatBeginsInTheHullGetsNoDeeper) {
  const MovingBody ball{PrimitiveKind::sphere, Vec3::Constant(0.5F), {.position = {0.9F, 0, 0}}, {.position = {0.6F, 0, 0}}};
  const MovingSweep deeper = sweep(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), {}, {});
  EXPECT_TRUE(deeper.contact.inside);
  EXPECT_EQ(deeper.contact.body, 0);
  EXPECT_EQ(deeper.contact.fraction, 0.0F);
  EXPECT_TRUE(deeper.end.jammed) << "still inside";
  EXPECT_NEAR(deeper.end.pose.position.x(), -0.3F, 1e-4F) << "moved along";
  const Pose away{.position = {-0.5F, 0, 0}};
  const MovingSweep left = sweep(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), {}, away);
  EXPECT_TRUE(left.contact.inside);
  EXPECT_EQ(left.contact.fraction, 1.0F);
  EXPECT_FALSE(left.end.jammed);
  EXPECT_EQ(left.end.pose.position, away.position);
  const Pose slow{.position = {-0.2F, 0, 0}};
  EXPECT_EQ(sweep(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), {}, slow).contact.fraction, 0.0F);
}

TEST(Push, ABallThatBeginsInTheHullMayLeaveButGetsNoDeeper) {
  Random random(51U + 100U * testing::part_tried());
  int cases = 0, deeper = 0, flown = 0, left = 0, moved = 0;
  for (long i = 0; i < testing::times_tried(2000); ++i) {
    SCOPED_TRACE(i);
    constexpr float kRadius = 0.5F;
    MovingBody ball{PrimitiveKind::sphere, Vec3::Constant(kRadius), {}, {random.point(0.2F), random.rotation()}};
    const Pose from{0.75F * random.direction().normalized(), random.rotation()};
    const auto depth = [&](const Pose& pose, const Vec3& center) {
      const oracle::Support hull =
          oracle::hull_at(testing::quadrotor(), pose.position.cast<double>(), pose.rotation.cast<double>());
      return static_cast<double>(kRadius) - oracle::distance(hull, oracle::polytope({center.cast<double>()})).upper;
    };
    const double before = depth(from, ball.from.position);
    if (before < 1e-3 || before > 0.45) continue;
    const Pose to = random.within(0, 1) < 0.3F ? from : random_target(random, from, 0.3F, 20.0F);
    const MovingSweep result = sweep(open_air().obstacles, std::vector{ball.solid(0)}, quadrotor_hull(), from, to);
    ASSERT_TRUE(result.contact.inside);
    ASSERT_TRUE(result.contact.fraction == 0.0F || result.contact.fraction == 1.0F);
    const double after = depth(result.end.pose, ball.to.position);
    deeper += after > before + 2e-6;
    ++cases;
    // Hulls closer than kTouching count as overlapping; the oracle's distance has an error, too.
    if (std::abs(after) > 2.0 * kTouching) {
      ASSERT_EQ(result.end.jammed, after > 0.0) << after;
    }
    flown += result.contact.fraction == 1.0F;
    left += after <= 0.0;
    moved += result.end.pushed;
  }
  // In about one motion in a thousand the search for the shortest way out, penetrate(), ends at another one. The hull then gets
  // no deeper only along that.
  EXPECT_LE(deeper, cases / 200);
  EXPECT_GT(flown, 40);
  EXPECT_GT(left, 20);
  EXPECT_GT(moved, 100);
}

// The tests below put several bodies into a room with obstacles.
struct Scenario {
  std::unique_ptr<Surroundings> room;
  std::vector<Primitive> statics;
  std::vector<MovingBody> bodies;
  Pose pose;  // of the hull, free of everything

  Scenario(Random& random, int count, float length, float most_degrees) {
    statics.push_back({.kind = PrimitiveKind::room, .half_extents = Vec3(2, 1.6F, 1.2F)});
    for (int i = 0; i < 2; ++i) {
      const MovingBody solid = random_body(random, 1.5F, 0, 0);
      if (solid.kind == PrimitiveKind::sphere) continue;
      statics.push_back({.kind = solid.kind,
                         .center = solid.from.position,
                         .rotation = solid.from.rotation,
                         .half_extents = solid.half_extents});
    }
    room = std::make_unique<Surroundings>(statics);
    do {
      pose = {random.point(1.0F), random.rotation()};
    } while (static_distance(pose) < 0.01);
    while (bodies.size() < static_cast<std::size_t>(count)) {
      const MovingBody body = random_body(random, 1.5F, length, most_degrees);
      if (distance_at(body, 0.0, pose, 0.1) > 0.01) bodies.push_back(body);
    }
  }

  double static_distance(const Pose& at) const {
    const oracle::Support hull = oracle::hull_at(testing::quadrotor(), at.position.cast<double>(), at.rotation.cast<double>());
    double least = std::numeric_limits<double>::infinity();
    for (const Primitive& solid : statics) {
      if (solid.kind != PrimitiveKind::room) {
        least = std::min(least, oracle::distance(hull, oracle::solid(solid)).lower);
        continue;
      }
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d d = Eigen::Vector3d::Unit(axis);
        const auto half = static_cast<double>(solid.half_extents[axis]);
        least = std::min({least, half - hull(d)[axis], half + hull(-d)[axis]});
      }
    }
    return least;
  }
};

void push_around(unsigned seed, long scenarios, int count, float length, float most_degrees, double most_jams) {
  Random random(seed + 100U * testing::part_tried());
  scenarios = testing::times_tried(scenarios);
  constexpr int kMotions = 8;
  long pushes = 0, jams = 0, motions = 0;
  for (long i = 0; i < scenarios; ++i) {
    Scenario scenario(random, count, length, most_degrees);
    Pose pose = scenario.pose;
    bool is_free = true;
    for (int motion = 0; motion < kMotions; ++motion, ++motions) {
      SCOPED_TRACE(::testing::Message() << "scenario " << i << ", motion " << motion);
      const Pose before = pose;
      const Pose to = random.within(0, 1) < 0.5F ? pose : random_target(random, pose, 0.1F, 10.0F);
      const std::vector<MovingSolid> solids = solids_of(scenario.bodies);
      const MovingSweep result = sweep(scenario.room->obstacles, solids, quadrotor_hull(), pose, to);
      ASSERT_TRUE(!result.contact.inside || !is_free);
      pose = result.end.pose;
      ASSERT_GT(scenario.static_distance(pose), 0.0);
      double least = 1.0;
      for (const MovingBody& body : scenario.bodies) least = std::min(least, distance_at(body, 1.0, pose, 1.0));
      is_free = !result.end.jammed;
      if (is_free) {
        ASSERT_GT(least, 0.0);
      }
      pushes += result.end.pushed;
      jams += result.end.jammed;
      // The order of the bodies does not matter.
      std::vector<MovingSolid> shuffled = solids;
      std::shuffle(shuffled.begin(), shuffled.end(), random.generator());
      ASSERT_TRUE(same_bits(result, sweep(scenario.room->obstacles, shuffled, quadrotor_hull(), before, to)));
      // Next the bodies go on from where they are.
      for (MovingBody& body : scenario.bodies) {
        const MovingBody other = random_body(random, 0.0F, length, most_degrees);
        body.from = body.to;
        body.to = {body.from.position - 0.3F * body.from.position.norm() * length * body.from.position + other.to.position,
                   (other.to.rotation * other.from.rotation.conjugate() * body.from.rotation).normalized()};
      }
      if (result.end.jammed) break;
    }
  }
  EXPECT_GT(pushes, motions / 50);
  EXPECT_LT(static_cast<double>(jams), most_jams * static_cast<double>(motions));
  testing::tried("shoves", pushes);
}

TEST(PushInARoom, SlowBodies) { push_around(11, 150, 4, 0.05F, 0.0F, 0.05); }
TEST(PushInARoom, SlowTurningBodies) { push_around(12, 150, 4, 0.05F, 5.0F, 0.05); }
TEST(PushInARoom, FastBodies) { push_around(13, 150, 4, 0.5F, 0.0F, 0.2); }
TEST(PushInARoom, FastTurningBodies) { push_around(14, 150, 4, 0.5F, 60.0F, 0.2); }
TEST(PushInARoom, BodiesThatTurnHalfway) { push_around(15, 100, 3, 1.0F, 180.0F, 0.3); }

TEST(Push, OneBodyInOpenAirJamsNothing) {
  Random random(21U + 100U * testing::part_tried());
  int pushes = 0;
  for (long i = 0; i < testing::times_tried(1500); ++i) {
    SCOPED_TRACE(i);
    const float degrees = i % 2 == 0 ? 0.0F : random.within(0, 180);
    const MovingBody body = random_body(random, 1.0F, 1.0F, degrees);
    const Pose pose{random.point(1.0F), random.rotation()};
    if (distance_at(body, 0.0, pose, 0.1) < 1e-3) continue;
    const MovingSweep result = sweep(open_air().obstacles, std::vector{body.solid(0)}, quadrotor_hull(), pose, pose);
    ASSERT_FALSE(result.contact.inside);
    ASSERT_FALSE(result.end.jammed);
    ASSERT_GT(distance_at(body, 1.0, result.end.pose, 1.0), 0.3 * kStandoff);
    ASSERT_EQ(result.end.pushed, result.end.pose.position != pose.position);
    ASSERT_TRUE(result.contact.hit || !result.end.pushed);
    if (result.contact.hit && degrees == 0.0F) {  // the body has not passed through the hull
      const Eigen::Vector3d normal = result.contact.normal.cast<double>();
      const oracle::Support hull =
          oracle::hull_at(testing::quadrotor(), result.end.pose.position.cast<double>(), result.end.pose.rotation.cast<double>());
      ASSERT_GT(normal.dot(hull(-normal) - body_at(body, 1.0)(normal)), -0.02);
    }
    pushes += result.end.pushed;
  }
  EXPECT_GT(pushes, 50);
}

// Bodies press against the hull in steps and turns of all sizes, and the hull moves a little, too.
TEST(Push, PressureDoesNotErodeTheGap) {
#if defined(NDEBUG)
  constexpr long kMoves = 2000;
#else  // sanitizers and debug builds are slow
  constexpr long kMoves = 200;
#endif
  for (const float away : {0.0F, 30.0F, 1000.0F}) {
    Random random(static_cast<unsigned>(away) + 41U + 100U * testing::part_tried());
    const long moves = testing::times_tried(kMoves);
    for (const PrimitiveKind kind : {PrimitiveKind::box, PrimitiveKind::sphere, PrimitiveKind::cylinder}) {
      SCOPED_TRACE(::testing::Message() << away << " m, kind " << static_cast<int>(kind));
      Pose pose{away * Vec3(0.6F, -0.48F, 0.64F), random.rotation()};
      MovingBody body{kind, Vec3::Constant(0.4F), {pose.position + Vec3(1.5F, 0, 0), random.rotation()}, {}};
      int pushes = 0;
      for (long i = 0; i < moves; ++i) {
        const Vec3 towards = (pose.position - body.from.position).normalized();
        const float size = i < 5 || i % 100 == 0 ? 0.3F : std::pow(10.0F, random.within(-8, -2));
        body.to.position = body.from.position + size * (towards + 0.5F * random.direction());
        body.to.rotation = body.from.rotation;
        if (i % 3 != 0) body.to.rotation = (rotated(100.0F * size, random.direction()) * body.from.rotation).normalized();
        Pose to = pose;
        if (i % 2 == 0) {
          to.position += std::pow(10.0F, random.within(-8, -2.5F)) * random.direction();
          to.rotation = (rotated(random.within(0, 0.2F), random.direction()) * to.rotation).normalized();
        }
        const MovingSweep result = sweep(open_air().obstacles, std::vector{body.solid(0)}, quadrotor_hull(), pose, to);
        ASSERT_FALSE(result.contact.inside) << i;
        ASSERT_FALSE(result.end.jammed) << i;
        pose = result.end.pose;
        body.from = body.to;
        pushes += result.end.pushed;
        if (i % 50 == 49) {
          ASSERT_GT(distance_at(body, 0.0, pose, 1.0), 0.4 * kStandoff) << i;
        }
      }
      EXPECT_GT(pushes, moves / 10);
    }
  }
}

TEST(MovingSweep, AllocatesNothing) {
  Random random(31);
  const Scenario scenario(random, 8, 0.5F, 40.0F);
  const std::vector<MovingSolid> solids = solids_of(scenario.bodies);
  (void)sweep(scenario.room->obstacles, solids, quadrotor_hull(), scenario.pose, scenario.pose);  // builds what is lazy
  int pushes = 0, jams = 0;
  const std::uint64_t before = testing::allocations_of_this_thread();
  for (int i = 0; i < 1000; ++i) {
    const Pose from{random.point(1.2F), random.rotation()};
    const MovingSweep result =
        sweep(scenario.room->obstacles, solids, quadrotor_hull(), from, random_target(random, from, 0.3F, 90.0F));
    pushes += result.end.pushed;
    jams += result.end.jammed;
  }
  EXPECT_EQ(testing::allocations_of_this_thread(), before);
  EXPECT_GT(pushes, 20);
  EXPECT_GT(jams, 20);
}

}  // namespace
}  // namespace flockstep::collision
