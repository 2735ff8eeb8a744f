// Pushes of moving bodies, which lead out of them and never into a wall.
#include "allocation_counter.hpp"
#include "collision/moving_scenes.hpp"

namespace flockstep::collision {
namespace {

using namespace moving;

std::vector<MovingSolid> solids_of(const std::vector<MovingBody>& bodies) {
  std::vector<MovingSolid> solids;
  for (const MovingBody& body : bodies) solids.push_back(body.solid(static_cast<int>(solids.size())));
  return solids;
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
    const oracle::Support hull = oracle::hull_at(quadrotor(), pose);
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
  Random random(51U + 100U * part_tried());
  int deeper = 0, flown = 0, left = 0, moved = 0;
  for (long i = 0; i < times_tried(2000); ++i) {
    SCOPED_TRACE(i);
    constexpr float kRadius = 0.5F;
    MovingBody ball{PrimitiveKind::sphere, Vec3::Constant(kRadius), {}, {random.point(0.2F), random.rotation()}};
    const Pose from{0.75F * random.direction().normalized(), random.rotation()};
    const auto depth = [&](const Pose& pose, const Vec3& center) {
      const oracle::Support hull = oracle::hull_at(quadrotor(), pose);
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
    // Hulls closer than kTouching count as overlapping; the oracle's distance has an error, too.
    if (std::abs(after) > 2.0 * kTouching) {
      ASSERT_EQ(result.end.jammed, after > 0.0) << after;
    }
    flown += result.contact.fraction == 1.0F;
    left += after <= 0.0;
    moved += result.end.pushed;
  }
  EXPECT_EQ(deeper, 0);
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
    const oracle::Support hull = oracle::hull_at(quadrotor(), at);
    double least = std::numeric_limits<double>::infinity();
    for (const Primitive& solid : statics) least = std::min(least, oracle::distance_from(hull, solid));
    return least;
  }
};

void push_around(unsigned seed, long scenarios, int count, float length, float most_degrees, double most_jams) {
  Random random(seed + 100U * part_tried());
  scenarios = times_tried(scenarios);
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
  Random random(21U + 100U * part_tried());
  int pushes = 0;
  for (long i = 0; i < times_tried(1500); ++i) {
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
      const oracle::Support hull = oracle::hull_at(quadrotor(), result.end.pose);
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
    Random random(static_cast<unsigned>(away) + 41U + 100U * part_tried());
    const long moves = times_tried(kMoves);
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
  const std::uint64_t before = allocations_of_this_thread();
  for (int i = 0; i < 1000; ++i) {
    const Pose from{random.point(1.2F), random.rotation()};
    const MovingSweep result =
        sweep(scenario.room->obstacles, solids, quadrotor_hull(), from, random_target(random, from, 0.3F, 90.0F));
    pushes += result.end.pushed;
    jams += result.end.jammed;
  }
  EXPECT_EQ(allocations_of_this_thread(), before);
  EXPECT_GT(pushes, 20);
  EXPECT_GT(jams, 20);
}

}  // namespace
}  // namespace flockstep::collision
