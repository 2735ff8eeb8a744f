#include "collision/sweep.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "collide.hpp"
#include "convex_oracle.hpp"
#include "random.hpp"
#include "tried.hpp"

namespace flockstep::collision {
namespace {

constexpr float kDegree = std::numbers::pi_v<float> / 180.0F;

const Hull& hull() {
  static const Hull body(testing::quadrotor());
  return body;
}

Primitive make(PrimitiveKind kind, const Vec3& center, const Vec3& half_extents, const Quat& rotation = Quat::Identity()) {
  return {.kind = kind, .center = center, .rotation = rotation, .half_extents = half_extents};
}

// A world and its collision data.
struct Place {
  explicit Place(std::vector<Primitive> primitives, TriangleMesh mesh = {})
      : world(describe(std::move(primitives), std::move(mesh))), scene(world), obstacles(world, scene) {}
  Contact sweep(const Pose& from, const Pose& to) const { return collision::sweep(obstacles, hull(), from, to); }
  bool overlaps(const Pose& pose) const { return collision::overlaps(obstacles, hull(), pose); }
  World world;
  trace::Scene scene;
  Obstacles obstacles;

 private:
  static SceneDescription describe(std::vector<Primitive> primitives, TriangleMesh mesh) {
    SceneDescription description;
    description.primitives = std::move(primitives);
    description.mesh = std::move(mesh);
    return description;
  }
};

Pose at(float x, float y, float z, const Quat& rotation = Quat::Identity()) { return {{x, y, z}, rotation}; }
Quat turn(float degrees, const Vec3& axis) { return Quat(Eigen::AngleAxisf(degrees * kDegree, axis)); }
Quat yaw(float degrees) { return turn(degrees, Vec3::UnitZ()); }

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
        for (const Vec3& point : testing::quadrotor().hull()) reach = std::max(reach, static_cast<double>(point.dot(direction)));
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
  std::vector<Vec3> corners;
  for (const float x : {-0.05F, 0.05F}) {
    for (const float y : {-0.5F, 0.5F}) {
      for (const float z : {-0.05F, 0.05F}) corners.emplace_back(x, y, z);
    }
  }
  const Hull pole{DroneModel(corners)};
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

// -- SceneRandom scenes, compared with fine stepping and an independent distance.

class SceneRandom {
 public:
  explicit SceneRandom(unsigned seed) : bits_(seed) {}
  float uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(bits_); }
  bool chance(float p) { return uniform(0, 1) < p; }
  Vec3 normal() {
    const float x = gauss_(bits_);
    const float y = gauss_(bits_);
    return {x, y, gauss_(bits_)};
  }
  Quat rotation() {
    const Vec3 axis = normal();
    return Quat(Eigen::AngleAxisf(uniform(0, std::numbers::pi_v<float>), axis.normalized()));
  }

 private:
  std::mt19937 bits_;
  std::normal_distribution<float> gauss_;
};

std::unique_ptr<Place> random_place(SceneRandom& random, int elements) {
  std::vector<Primitive> primitives;
  TriangleMesh mesh;
  if (random.chance(0.5F)) primitives.push_back(make(PrimitiveKind::room, 0.3F * random.normal(), Vec3(3, 2.5F, 2)));
  for (int i = 0; i < elements; ++i) {
    const Vec3 center = 0.9F * std::cbrt(static_cast<float>(elements)) * random.normal();
    // Sizes over three decades, from a wire to a wall.
    const auto size = [&] {
      return random.chance(0.2F) ? random.uniform(0.001F, 0.01F) : random.uniform(0.01F, random.chance(0.1F) ? 4.0F : 0.7F);
    };
    const float a = size();
    const float b = size();
    const Vec3 half(a, b, size());
    const Quat rotation = random.chance(0.4F) ? Quat::Identity() : random.rotation();
    switch (static_cast<int>(random.uniform(0, 7))) {
      case 0:
        primitives.push_back(make(PrimitiveKind::box, center, half, rotation));
        break;
      case 1:
        primitives.push_back(make(PrimitiveKind::cylinder, center, {a, a, half.z()}, rotation));
        break;
      case 2:
        primitives.push_back(make(PrimitiveKind::sphere, center, Vec3::Constant(a)));
        break;
      case 3:
        primitives.push_back(make(PrimitiveKind::capsule, center, {a, a, a + half.z()}, rotation));
        break;
      case 4:
        primitives.push_back(make(PrimitiveKind::plane, center, {a, b, 0}, rotation));
        break;
      case 5:
        primitives.push_back(make(PrimitiveKind::disc, center, {a, a, 0}, rotation));
        break;
      default: {
        const auto first = static_cast<std::int32_t>(mesh.vertices.size());
        for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(center + 0.7F * random.normal());
        mesh.triangles.push_back({first, first + 1, first + 2});
        mesh.materials.push_back(0);
      }
    }
  }
  return std::make_unique<Place>(std::move(primitives), std::move(mesh));
}

// Brute-force distances from a hull to everything in a world.
class Reference {
 public:
  explicit Reference(const World& world) {
    for (const Primitive& primitive : world.primitives()) {
      if (primitive.kind == PrimitiveKind::room) {
        rooms_.push_back(primitive);
      } else {
        solids_.push_back(
            {oracle::solid(primitive), primitive.center.cast<double>(), primitive.half_extents.cast<double>().norm()});
      }
    }
    const TriangleMesh& mesh = world.triangles();
    for (const auto& triangle : mesh.triangles) {
      std::vector<Eigen::Vector3d> corners;
      for (const std::int32_t vertex : triangle) {
        corners.push_back(mesh.vertices[static_cast<std::size_t>(vertex)].cast<double>());
      }
      const double reach = std::max((corners[1] - corners[0]).norm(), (corners[2] - corners[0]).norm());
      solids_.push_back({oracle::polytope(corners), corners[0], reach});
    }
  }

  // Returns the distance, or a lower bound of it that exceeds `enough`. Not positive if they overlap.
  double distance(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation, double enough) const {
    double least = std::numeric_limits<double>::infinity();
    const oracle::Support body = oracle::hull_at(testing::quadrotor(), position, rotation);
    for (const Primitive& room : rooms_) {
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d d = Eigen::Vector3d::Unit(axis);
        const double center = static_cast<double>(room.center[axis]);
        const double half = static_cast<double>(room.half_extents[axis]);
        least = std::min({least, center + half - body(d)[axis], body(-d)[axis] - (center - half)});
      }
    }
    for (const Solid& solid : solids_) {
      const double bound = (position - solid.center).norm() - solid.reach - static_cast<double>(testing::quadrotor().radius());
      least = std::min(least, bound > enough ? bound : oracle::distance(body, solid.support).lower);
    }
    return least;
  }

 private:
  struct Solid {
    oracle::Support support;
    Eigen::Vector3d center;
    double reach;
  };
  std::vector<Primitive> rooms_;
  std::vector<Solid> solids_;
};

struct Motion {
  Pose from;
  Pose to;
  Eigen::Vector3d position(double t) const { return (1 - t) * from.position.cast<double>() + t * to.position.cast<double>(); }
  Eigen::Quaterniond rotation(double t) const {
    return from.rotation.cast<double>().normalized().slerp(t, to.rotation.cast<double>().normalized());
  }
  double speed() const {  // upper bound for any point of the hull
    return (to.position - from.position).cast<double>().norm() +
           static_cast<double>(testing::quadrotor().radius()) *
               from.rotation.cast<double>().normalized().angularDistance(to.rotation.cast<double>().normalized());
  }
};

// Returns the first time at which the hull is within the standoff, or a value above 1 if there is none. Steps by 20 um or by
// the current distance, whichever is larger.
double first_time(const Reference& reference, const Motion& motion) {
  const double speed = std::max(motion.speed(), 1e-9);
  double time = 0.0;
  while (time <= 1.0) {
    const double beyond = reference.distance(motion.position(time), motion.rotation(time), 0.5) - kStandoff;
    if (beyond <= 0.0) return time;
    time = time < 1.0 ? std::min(1.0, time + std::max(beyond, 2e-5) / speed) : 2.0;
  }
  return time;
}

struct Tally {
  int hits = 0;
  int insides = 0;
  int frees = 0;
};

void compare_with_fine_stepping(SceneRandom& random, const Place& place, const Motion& motion, Tally& tally) {
  const Reference reference(place.world);
  const Contact contact = place.sweep(motion.from, motion.to);
  const double first = reference.distance(motion.position(0), motion.rotation(0), 0.5);
  if (std::abs(first) < 2.0 * kStandoff) {
    return;  // different rules apply at the standoff
  }
  ASSERT_EQ(contact.inside, first <= 0.0);
  ASSERT_EQ(place.overlaps(motion.from), contact.inside);
  if (contact.inside) {
    ++tally.insides;
    ASSERT_TRUE(contact.hit);
    ASSERT_NEAR(contact.normal.norm(), 1.0F, 1e-5F);
    return;
  }
  const double expected = first_time(reference, motion);
  const double travel = motion.speed();
  const double ended = static_cast<double>(contact.fraction);
  const double left = reference.distance(motion.position(ended), motion.rotation(ended), 0.5);
  if (!contact.hit) {
    ++tally.frees;
    ASSERT_EQ(contact.fraction, 1.0F);
    if (expected <= 1.0) {  // dips of a few micrometres below the standoff are ignored
      ASSERT_GT(reference.distance(motion.position(expected), motion.rotation(expected), 0.5), kStandoff - 3e-5);
    }
    return;
  }
  ++tally.hits;
  ASSERT_GT(left, kStandoff - 1e-6);
  ASSERT_LT(left, kStandoff + 2e-5);
  ASSERT_LT(ended * travel, expected * travel + 5e-5) << "flew through";
  // If the hull closes the last micrometres very slowly, it may stop earlier. The gap check above allows that.
  const double before = std::max(0.0, ended - 1e-3 / travel);
  const double approach = (reference.distance(motion.position(before), motion.rotation(before), 0.5) - left) / 1e-3;
  if (approach > 0.05) {
    ASSERT_GT(ended * travel, expected * travel - 1e-3) << "stopped early";
  }
  const Pose stop = interpolate(motion.from, motion.to, contact.fraction);
  ASSERT_FALSE(place.overlaps(stop));
  ASSERT_GT(reference.distance(stop.position.cast<double>(), stop.rotation.cast<double>(), 0.5), 0.5 * kStandoff);
  ASSERT_NEAR(contact.normal.norm(), 1.0F, 1e-5F);
  // The contact point is at the standoff distance from the hull, on the side that the normal points away from.
  const oracle::Support body = oracle::hull_at(testing::quadrotor(), stop.position.cast<double>(), stop.rotation.cast<double>());
  const oracle::Support point = oracle::polytope({contact.point.cast<double>()});
  ASSERT_LT(oracle::distance(body, point).upper, kStandoff + 2e-4);
  ASSERT_GT(contact.normal.cast<double>().dot(body(-contact.normal.cast<double>()) - contact.point.cast<double>()), -1e-5);
  // Moving away and then anywhere never enters an obstacle.
  Pose pose = stop;
  for (int step = 0; step < 4; ++step) {
    const Pose next{pose.position + 0.1F * random.normal(), random.chance(0.5F) ? pose.rotation : random.rotation()};
    const Contact again = place.sweep(pose, next);
    ASSERT_FALSE(again.inside);
    pose = again.hit ? interpolate(pose, next, again.fraction) : next;
    ASSERT_GT(reference.distance(pose.position.cast<double>(), pose.rotation.cast<double>(), 0.5), 0.0) << step;
  }
}

void random_cases(unsigned seed, int places, int motions, int elements, float length, float most_degrees) {
  SceneRandom random(seed + 10U * testing::part_tried());
  Tally tally;
  places = static_cast<int>(testing::times_tried(places));
  for (int i = 0; i < places; ++i) {
    const std::unique_ptr<Place> place = random_place(random, elements);
    for (int j = 0; j < motions; ++j) {
      SCOPED_TRACE(::testing::Message() << "place " << i << ", motion " << j);
      Motion motion;
      motion.from.position = 1.2F * random.normal();
      motion.from.rotation = random.rotation();
      motion.to.position = motion.from.position + length * random.uniform(0, 1) * random.normal();
      const Vec3 axis = random.normal().normalized();
      motion.to.rotation = turn(random.uniform(0, most_degrees), axis) * motion.from.rotation;
      if (random.chance(0.2F)) motion.to.position = motion.from.position;
      compare_with_fine_stepping(random, *place, motion, tally);
      if (::testing::Test::HasFatalFailure()) return;
    }
  }
  const int total = places * motions;
  EXPECT_GT(tally.hits, total / 100);
  EXPECT_GT(tally.frees, total / 50);
  EXPECT_GT(tally.insides, total / 50);
  testing::tried("motions", total);
}

TEST(SweepAgainstFineStepping, ShortMotions) { random_cases(1, 300, 20, 5, 0.3F, 0.0F); }
TEST(SweepAgainstFineStepping, ShortTurningMotions) { random_cases(2, 300, 20, 5, 0.2F, 20.0F); }
TEST(SweepAgainstFineStepping, LongMotions) { random_cases(3, 200, 10, 4, 3.0F, 0.0F); }
TEST(SweepAgainstFineStepping, LongTurningMotions) { random_cases(4, 150, 10, 4, 2.0F, 180.0F); }
TEST(SweepAgainstFineStepping, ManyElements) { random_cases(5, 20, 20, 100, 0.3F, 20.0F); }

TEST(Sweep, ResultsDependOnNothingButTheInputs) {
  // The same elements checked one by one, through the acceleration structure, and in another order.
  SceneRandom random(6);
  for (int i = 0; i < 20; ++i) {
    std::vector<Primitive> few;
    for (int k = 0; k < 12; ++k) {
      few.push_back(make(PrimitiveKind::box, 1.5F * random.normal(), Vec3(0.3F, 0.2F, 0.4F), random.rotation()));
    }
    std::vector<Primitive> reversed(few.rbegin(), few.rend());
    std::vector<Primitive> many = few;
    for (int k = 0; k < 60; ++k) {  // far away
      many.push_back(make(PrimitiveKind::sphere, {100.0F + 2.0F * static_cast<float>(k), 0, 0}, Vec3::Constant(0.5F)));
    }
    const Place a(few);
    const Place b(reversed);
    const Place c(many);
    for (int j = 0; j < 100; ++j) {
      const Pose from{1.5F * random.normal(), random.rotation()};
      const Pose to{from.position + 0.5F * random.normal(), turn(10, Vec3::UnitZ()) * from.rotation};
      const Contact first = a.sweep(from, to);
      for (const Contact& other : {a.sweep(from, to), b.sweep(from, to), c.sweep(from, to)}) {
        ASSERT_EQ(first.hit, other.hit);
        ASSERT_EQ(first.inside, other.inside);
        ASSERT_EQ(first.fraction, other.fraction);
        if (!first.inside) {  // with several overlaps, the element with the lowest index sets the normal
          ASSERT_EQ(first.normal, other.normal);
          ASSERT_EQ(first.point, other.point);
        }
      }
    }
  }
}

TEST(Sweep, AllocatesNothing) {
  SceneRandom random(7);
  for (const int elements : {10, 100}) {
    const std::unique_ptr<Place> place = random_place(random, elements);
    (void)place->overlaps(at(0, 0, 0));  // builds the acceleration structure, which is lazy
    int hits = 0;
    const std::uint64_t before = testing::allocations_of_this_thread();
    for (int i = 0; i < 2000; ++i) {
      const Pose from{random.normal(), random.rotation()};
      const Pose to{from.position + 0.3F * random.normal(), random.rotation()};
      hits += place->sweep(from, to).hit;
    }
    EXPECT_EQ(testing::allocations_of_this_thread(), before);
    EXPECT_GT(hits, 100);
  }
}

}  // namespace
}  // namespace flockstep::collision
