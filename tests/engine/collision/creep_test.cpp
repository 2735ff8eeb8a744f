// A hull at rest against an obstacle: repeated pushes and turns bring it no closer, and it can always leave.

#include "collide.hpp"
#include "collision/clearing.hpp"
#include "collision/sweep.hpp"
#include "convex_oracle.hpp"
#include "meshes.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep::collision {
namespace {

using oracle::Vec3d;
using namespace testing;

// An obstacle in +x direction from a point.
struct Obstacle {
  std::string name;
  SceneDescription scene;
  std::function<double(const oracle::Support& hull)> distance;  // m, lower bound
};

Obstacle solid(const std::string& name, PrimitiveKind kind, const Vec3& center, const Vec3& half_extents, const Quat& rotation) {
  const Primitive primitive{.kind = kind, .center = center, .rotation = rotation, .half_extents = half_extents};
  SceneDescription scene;
  scene.primitives = {primitive};
  return {name, scene,
          [shape = oracle::solid(primitive)](const oracle::Support& hull) { return oracle::distance(hull, shape).lower; }};
}

std::vector<oracle::Support> triangles_of(const TriangleMesh& mesh) {
  std::vector<oracle::Support> triangles;
  for (const auto& triangle : mesh.triangles) {
    std::vector<Vec3d> corners;
    for (const std::int32_t index : triangle) corners.push_back(mesh.vertices[static_cast<std::size_t>(index)].cast<double>());
    triangles.push_back(oracle::polytope(corners));
  }
  return triangles;
}

std::vector<Obstacle> obstacles_at(const Vec3& point) {
  using enum PrimitiveKind;
  const Quat turned(Eigen::AngleAxisf(0.7F, Vec3(1, 2, 3).normalized()));
  const Vec3 center = point + Vec3(4, 0, 0);
  std::vector<Obstacle> all{
      solid("box", box, center, {1, 2, 2}, turned), solid("upright box", box, center, {1, 2, 2}, Quat::Identity()),
      solid("sphere", sphere, center, {2, 2, 2}, Quat::Identity()), solid("cylinder", cylinder, center, {1, 1, 3}, turned),
      solid("capsule", capsule, center, {1, 1, 3}, turned)};

  SceneDescription in_room;
  in_room.primitives = {{.kind = room, .center = point, .half_extents = Vec3(3, 40, 40)}};
  const double wall = static_cast<double>(point.x()) + 3.0;
  all.push_back({"wall of a room", in_room, [wall](const oracle::Support& hull) { return wall - hull(Vec3d::UnitX()).x(); }});

  SceneDescription of_triangles;  // a wavy wall
  constexpr int kCells = 6;
  for (int i = 0; i <= kCells; ++i) {
    for (int j = 0; j <= kCells; ++j) {
      const Vec3 across(0.3F * std::sin(static_cast<float>(3 * i + j)), static_cast<float>(i) - 3.0F,
                        static_cast<float>(j) - 3.0F);
      of_triangles.mesh.vertices.push_back(center + across);
    }
  }
  add_squares(of_triangles.mesh, 0, kCells, kCells);
  all.push_back({"triangles", of_triangles, [triangles = triangles_of(of_triangles.mesh)](const oracle::Support& hull) {
                   double least = std::numeric_limits<double>::infinity();
                   for (const auto& triangle : triangles) least = std::min(least, oracle::distance(hull, triangle).lower);
                   return least;
                 }});
  return all;
}

Quat small_turn(Random& random, float least_rad, float most_rad) {
  const float angle = least_rad * std::pow(most_rad / least_rad, random.within(0, 1));
  return Quat(Eigen::AngleAxisf(angle, random.direction().normalized()));
}

oracle::Support hull_of(const Pose& pose) { return oracle::hull_at(quadrotor(), pose); }

// Moves like Batch::move().
Pose moved(const Obstacles& obstacles, const Hull& hull, const Pose& from, const Pose& to, Contact& contact) {
  contact = sweep(obstacles, hull, from, to);
  return contact.hit ? interpolate(from, to, contact.fraction) : to;
}

class Creep : public ::testing::TestWithParam<float> {};

// Moves mainly towards the obstacle, with steps and turns of all sizes and some sideways steps.
TEST_P(Creep, PushesAndTurnsDoNotErodeTheGap) {
  const Vec3 point = GetParam() * Vec3(0.6F, -0.48F, 0.64F);
  const Hull hull(quadrotor());
  const std::vector<Obstacle> all = obstacles_at(point);
#if defined(NDEBUG)
  constexpr long kMoves = 100'000;
#else  // sanitizers and debug builds are slow
  constexpr long kMoves = 10'000;
#endif
  const long moves = times_tried(kMoves) / 6 / static_cast<long>(all.size());  // six places
  Random random(static_cast<unsigned>(GetParam()) + 1U + 100'000U * part_tried());
  for (const Obstacle& obstacle : all) {
    SCOPED_TRACE(obstacle.name);
    const World world(obstacle.scene);
    const Obstacles& obstacles = prepared(world).obstacles();
    Contact contact;
    Pose pose{point, random.rotation()};
    long stuck = 0;
    for (long i = 0; i < moves; ++i) {
      if (i % 2000 == 0)
        pose = moved(obstacles, hull, {point, random.rotation()}, {point + Vec3(6, 0, 0), pose.rotation}, contact);
      const float size = std::pow(10.0F, random.within(-8, -2.5F));
      const Vec3 way = random.within(0, 1) < 0.7F ? Vec3(Vec3(1, 0, 0) + 0.3F * random.direction()) : random.direction();
      Pose target{pose.position + size * way, pose.rotation};
      if (i % 3 != 0) target.rotation = (pose.rotation * small_turn(random, 1e-8F, 1e-3F)).normalized();
      pose = moved(obstacles, hull, pose, target, contact);
      ASSERT_FALSE(contact.inside) << i;
      if (i % 1000 == 999) {
        ASSERT_GE(obstacle.distance(hull_of(pose)), 0.4 * kStandoff) << i;
        Contact leaving;
        moved(obstacles, hull, pose, {pose.position - Vec3(0.1F, 0, 0), pose.rotation}, leaving);
        stuck += leaving.hit;
      }
    }
    EXPECT_EQ(stuck, 0) << "of motions straight away";
  }
  testing::tried("moves", moves * static_cast<long>(all.size()));
}

INSTANTIATE_TEST_SUITE_P(FromTheOrigin, Creep, ::testing::Values(0.0F, 8.0F, 30.0F, 100.0F, 1000.0F, 10000.0F));

// Found after about ten million moves: Bullet's distance search for one of these triangles converges from no starting point.
TEST(Creep, AHullBesideATriangleThatIsHardToMeasureIsNotInside) {
  const std::vector<Obstacle> all = obstacles_at(30.0F * Vec3(0.6F, -0.48F, 0.64F));
  const Obstacle& triangles = all.back();
  ASSERT_EQ(triangles.name, "triangles");
  const World world(triangles.scene);
  const Pose from{{0x1.562df2p+4F, -0x1.cccccp+3F, 0x1.333338p+4F},
                  {-0x1.f1cd68p-8F, 0x1.5196fp-2F, 0x1.d8238ap-1F, -0x1.9e30cp-3F}};
  const Pose to{{0x1.562dfcp+4F, -0x1.cccc92p+3F, 0x1.33334ep+4F},
                {-0x1.fc6122p-8F, 0x1.517424p-2F, 0x1.d82658p-1F, -0x1.9e6bdap-3F}};
  EXPECT_NEAR(triangles.distance(hull_of(from)), 9.11e-5, 1e-6);
  EXPECT_FALSE(sweep(prepared(world).obstacles(), Hull(quadrotor()), from, to).inside);
}

// Penetration depth of the hull.
double depth_in_wall(const Pose& pose) { return hull_of(pose)(Vec3d::UnitX()).x() - 3.0; }
double depth_in_sphere(const Pose& pose) {
  const oracle::Support center = [](const Vec3d&) { return Vec3d(4, 0, 0); };
  return 2.0 - oracle::distance(hull_of(pose), center).upper;
}

TEST(Inside, MayMoveOutNeverDeeper) {
#if defined(NDEBUG)
  constexpr int kRounds = 200;
#else
  constexpr int kRounds = 16;
#endif
  const Hull hull(quadrotor());
  for (const bool in_room : {true, false}) {
    SCOPED_TRACE(in_room);
    const auto all = obstacles_at(Vec3::Zero());
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&](const Obstacle& o) { return o.name == (in_room ? "wall of a room" : "sphere"); });
    const World world(found->scene);
    const Obstacles& obstacles = prepared(world).obstacles();
    Random random(7);
    int came_out = 0;
    for (int round = 0; round < kRounds; ++round) {
      Pose pose{Vec3(random.within(2.2F, 2.9F), random.within(-0.2F, 0.2F), random.within(-0.2F, 0.2F)), random.rotation()};
      const auto depth = [&] { return in_room ? depth_in_wall(pose) : depth_in_sphere(pose); };
      if (depth() < 1e-3) continue;
      bool inside = true;
      for (int i = 0; i < 400 && inside; ++i) {
        const double before = depth();
        const float size = std::pow(10.0F, random.within(-6, -1));
        Pose target{pose.position + size * random.direction(), pose.rotation};
        if (i % 2 != 0) target.rotation = (pose.rotation * small_turn(random, 1e-6F, 0.1F)).normalized();
        Contact contact;
        pose = moved(obstacles, hull, pose, target, contact);
        inside = contact.inside;
        if (inside) {
          ASSERT_LE(depth(), before + 2e-6) << i;
        }
        ASSERT_TRUE(contact.fraction == 0.0F || contact.fraction == 1.0F || !inside);
      }
      came_out += !inside;
      if (inside) {  // along the contact normal
        Contact contact;
        pose = moved(obstacles, hull, pose, pose, contact);
        moved(obstacles, hull, pose, {pose.position + 2.0F * contact.normal, pose.rotation}, contact);
        EXPECT_EQ(contact.fraction, 1.0F);
      }
    }
    EXPECT_GT(came_out, kRounds / 4);
  }
}

// A mesh has no inside: at its edges the ways out of its triangles cross.
TEST(Inside, IsLedOutOfAMesh) {
  TriangleMesh mesh;
  add_box(mesh, Vec3::Zero(), Vec3::Constant(0.5F));
  const auto world = make_world({}, {}, mesh);
  const Obstacles& obstacles = prepared(*world).obstacles();
  const DroneModel x500 = DroneModel::load("x500");
  const Hull hull(x500);
  Random random(8U + part_tried());
  const long starts = times_tried(5000 / kThinning);
  for (long start = 0; start < starts; ++start) {
    const Vec3 inwards = -random.direction().normalized();
    Pose pose{-1.5F * inwards, start % 2 == 0 ? Quat::Identity() : random.rotation()};
    while (!overlaps(obstacles, hull, pose)) pose.position += random.within(0.001F, 0.05F) * inwards;
    for (int step = 0; step < 125 && overlaps(obstacles, hull, pose); ++step) {
      const Vec3 before = pose.position;
      pose = led_out(obstacles, {}, hull, pose, 0.01);
      ASSERT_LT((pose.position - before).norm(), 0.01001F) << start;
    }
    for (const oracle::Support& triangle : triangles_of(mesh)) {
      ASSERT_GT(oracle::distance(oracle::hull_at(x500, pose), triangle).lower, 0.0) << start;
    }
  }
}

TEST(Inside, IsNotLedThroughSomethingElse) {
  const auto box = [](float x, float half_x) { return primitive(PrimitiveKind::box, {x, 0, 0}, {half_x, 1, 1}); };
  const auto world = make_world({box(0.0F, 1.0F), box(0.5F, 0.01F)});
  const Obstacles& obstacles = prepared(*world).obstacles();
  const Hull cube{DroneModel(oracle::corners_of_box(Vec3::Constant(0.05F)))};
  const Pose from{.position = {0.2F, 0, 0}};
  EXPECT_NEAR(led_out(obstacles, {}, cube, from, 0.1).position.x(), 0.3F, 1e-6F);
  EXPECT_NEAR(led_out(obstacles, {}, cube, from, 2.0).position.x(), 0.49 - 0.05 - kStandoff, 1e-5);
}

}  // namespace
}  // namespace flockstep::collision
