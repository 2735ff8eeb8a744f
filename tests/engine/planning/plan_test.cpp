#include "collide.hpp"
#include "convex_oracle.hpp"
#include "flockstep/planning.hpp"
#include "planning/lattice.hpp"
#include "planning/navigable.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Vec2d = Eigen::Vector2d;

constexpr float kHalfLength = 0.4F;
constexpr float kHalfWidth = 0.3F;
constexpr float kHalfHeight = 0.1F;

// A box-shaped drone. The region that an obstacle blocks for its centre is known exactly.
DroneModel box_drone() { return DroneModel(oracle::corners_of_box({kHalfLength, kHalfWidth, kHalfHeight})); }

Primitive room(const Vec3& size) {
  return Primitive{.kind = PrimitiveKind::room, .center = size / 2.0F, .half_extents = size / 2.0F};
}

Primitive box(const Vec3& center, const Vec3& size) { return Primitive{.center = center, .half_extents = size / 2.0F}; }

SceneDescription scene(std::vector<Primitive> primitives) {
  SceneDescription description;
  description.primitives = std::move(primitives);
  return description;
}

double length(const std::vector<Vec3>& path) {
  double sum = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) sum += (path[i] - path[i - 1]).cast<double>().norm();
  return sum;
}

void expect_clear(const World& world, const DroneModel& drone, const std::vector<Vec3>& path) {
  for (std::size_t i = 1; i < path.size(); ++i) {
    EXPECT_FALSE(testing::sweep(world, drone, Pose{.position = path[i - 1]}, Pose{.position = path[i]}).hit) << "leg " << i;
  }
}

// Plans a path, checks it, and compares its length with the optimum. The path may be longer by `excess`, and shorter only by
// the sweep's tolerance at each corner.
void expect_shortest(const World& world, const Vec3& start, const std::vector<Vec3>& goals, double shortest, double excess) {
  const DroneModel drone = box_drone();
  const auto path = plan(world, drone, start, goals);
  ASSERT_TRUE(path);
  EXPECT_EQ(path->front(), start);
  EXPECT_EQ(path->back(), goals.back());
  expect_clear(world, drone, *path);
  EXPECT_GT(length(*path), shortest - 5e-3);
  EXPECT_LT(length(*path), shortest * (1.0 + excess));
}

TEST(Plan, FreeSpaceIsCrossedStraight) {
  const World world(scene({room({10, 6, 3})}));
  const auto path = plan(world, box_drone(), Vec3(1, 1, 1), std::vector<Vec3>{{9, 5, 2}, {9, 5, 1}, {9, 5, 1}});
  ASSERT_TRUE(path);
  EXPECT_EQ(*path, (std::vector<Vec3>{{1, 1, 1}, {9, 5, 2}, {9, 5, 1}, {9, 5, 1}}));
}

TEST(Plan, RoundAFullHeightBox) {
  // Around a 1 x 1 m box the drone's centre must stay out of 1.8 x 1.6 m. y = 3 is the middle between both routes.
  const World world(scene({room({10, 6, 3}), box({5, 3, 1.5F}, {1, 1, 3})}));
  const double flat = 1.8 + 2.0 * std::hypot(2.1, 0.8);
  expect_shortest(world, {2, 3, 1}, {{8, 3, 1}}, flat, 0.003);
  // The same with a climb. Seen from above the path is the same.
  expect_shortest(world, {2, 3, 0.5F}, {{8, 3, 2.5F}}, std::hypot(flat, 2.0), 0.003);
}

TEST(Plan, OverAWall) {
  // A wall 1 m high and 0.2 m thick across the room. The path crosses it at z = 1.1 for 1 m.
  const World world(scene({room({10, 3, 3}), box({5, 1.5F, 0.5F}, {0.2F, 3, 1})}));
  expect_shortest(world, {2, 1.5F, 0.5F}, {{8, 1.5F, 0.5F}}, 1.0 + 2.0 * std::hypot(2.5, 0.6), 0.003);
}

TEST(Plan, AroundABallInTheOpen) {
  // Without a room, the path over the top is the shortest for a flat drone. Its corners keep it above z = r + half height over
  // the middle. The lower bound is a string over a ball of radius r + half height, the upper bound the path around the box that
  // encloses ball and drone.
  const Primitive ball{.kind = PrimitiveKind::sphere, .center = {0, 0, 0}, .half_extents = Vec3::Constant(0.5F)};
  const World world(scene({ball}));
  const DroneModel drone = box_drone();
  const auto path = plan(world, drone, Vec3(-3, 0, 0), std::vector<Vec3>{{3, 0, 0}});
  ASSERT_TRUE(path);
  expect_clear(world, drone, *path);
  const double reach = 0.5 + kHalfHeight;
  EXPECT_GT(length(*path), 2.0 * (std::sqrt(9.0 - reach * reach) + reach * std::asin(reach / 3.0)) - 1e-3);
  EXPECT_LT(length(*path), 1.8 + 2.0 * std::hypot(2.1, 0.6));
}

TEST(Plan, ThroughAWindowInAMesh) {
  // A wall of strips with two triangles each, around a 1.6 x 1.6 m window centred at y = 2.5, z = 1.5.
  SceneDescription description = scene({room({8, 6, 3})});
  const auto strip = [&](float y0, float y1, float z0, float z1) {
    const auto first = static_cast<std::int32_t>(description.mesh.vertices.size());
    for (const auto& [y, z] : {std::pair{y0, z0}, {y1, z0}, {y1, z1}, {y0, z1}}) description.mesh.vertices.emplace_back(4, y, z);
    description.mesh.triangles.push_back({first, first + 1, first + 2});
    description.mesh.triangles.push_back({first, first + 2, first + 3});
  };
  strip(0, 1.7F, 0, 3);
  strip(3.3F, 6, 0, 3);
  strip(1.7F, 3.3F, 0, 0.7F);
  strip(1.7F, 3.3F, 2.3F, 3);
  const World world(description);
  // The centre must pass y <= 3.3 - 0.3 from x = 3.6 to x = 4.4.
  expect_shortest(world, {1, 4.5F, 1.5F}, {{7, 4.5F, 1.5F}}, 0.8 + 2.0 * std::hypot(2.6, 1.5), 0.003);
}

TEST(Plan, GapsNarrowerThanTheDroneAreBlocked) {
  const auto hall = [](float gap) {
    return scene({room({10, 6, 3}), box({5, 1.5F - gap / 4, 1.5F}, {1, 3 - gap / 2, 3}),
                  box({5, 4.5F + gap / 4, 1.5F}, {1, 3 - gap / 2, 3})});
  };
  const std::vector<Vec3> goal{{8, 3, 1}};
  EXPECT_FALSE(plan(World(hall(0.58F)), box_drone(), Vec3(2, 3, 1), goal));
  EXPECT_TRUE(plan(World(hall(0.62F)), box_drone(), Vec3(2, 3, 1), goal));
  EXPECT_TRUE(plan(World(hall(0.62F)), box_drone(), Vec3(2, 2, 1), goal));  // off the gap's axis
}

TEST(Plan, NoPathLeavesOrEntersASolid) {
  const World world(scene({room({10, 6, 3}), box({5, 3, 1.5F}, {1, 1, 3})}));
  EXPECT_FALSE(plan(world, box_drone(), Vec3(5, 3.6F, 1), std::vector<Vec3>{{8, 3, 1}}));
  EXPECT_FALSE(plan(world, box_drone(), Vec3(2, 3, 1), std::vector<Vec3>{{5, 3.6F, 1}}));
  EXPECT_FALSE(plan(world, box_drone(), Vec3(2, 3, 1), std::vector<Vec3>{{8, 3, 1}, {50, 3, 1}}));
}

// The oracle: the shortest path through a visibility graph, with its own plane geometry. Its nodes are points on the outlines
// of the regions that the pillars block for the drone's centre. Such a region is a rectangle of the drone's size, grown by the
// radius.
class VisibilityGraph {
 public:
  VisibilityGraph(const Vec2d& size, std::vector<Vec2d> pillars, double radius)
      : size_(size), pillars_(std::move(pillars)), radius_(radius) {}

  double shortest(const Vec2d& start, const Vec2d& goal) const {
    std::vector<Vec2d> nodes{start, goal};
    constexpr int kRimPoints = 40;
    constexpr double kOutside = 1.004;  // keeps chords between rim points clear of the rim
    for (const Vec2d& pillar : pillars_) {
      for (int i = 0; i < kRimPoints; ++i) {
        const double angle = 2.0 * std::numbers::pi * (i + 0.5) / kRimPoints;
        const Vec2d direction(std::cos(angle), std::sin(angle));
        const Vec2d corner(std::copysign(kHalfLength, direction.x()), std::copysign(kHalfWidth, direction.y()));
        const Vec2d point = pillar + corner + kOutside * radius_ * direction;
        if (is_clear(point, point)) nodes.push_back(point);
      }
    }
    std::vector<double> cost(nodes.size(), std::numeric_limits<double>::infinity());
    std::vector<bool> done(nodes.size(), false);
    cost[0] = 0.0;
    for (;;) {
      std::size_t best = nodes.size();
      for (std::size_t i = 0; i < nodes.size(); ++i) {
        if (!done[i] && std::isfinite(cost[i]) && (best == nodes.size() || cost[i] < cost[best])) best = i;
      }
      if (best == nodes.size()) return std::numeric_limits<double>::infinity();
      if (best == 1) return cost[1];
      done[best] = true;
      for (std::size_t i = 0; i < nodes.size(); ++i) {
        const double through = cost[best] + (nodes[i] - nodes[best]).norm();
        if (!done[i] && through < cost[i] && is_clear(nodes[best], nodes[i])) cost[i] = through;
      }
    }
  }

 private:
  bool is_clear(const Vec2d& a, const Vec2d& b) const {
    const Vec2d half(kHalfLength, kHalfWidth);
    for (const Vec2d& end : {a, b}) {
      if ((end - half).minCoeff() < 0.0 || (size_ - end - half).minCoeff() < 0.0) return false;
    }
    return std::all_of(pillars_.begin(), pillars_.end(),
                       [&](const Vec2d& pillar) { return distance_to_rectangle(a - pillar, b - pillar, half) >= radius_; });
  }

  // Returns the distance from the segment ab to the rectangle with these half sizes around the origin.
  static double distance_to_rectangle(const Vec2d& a, const Vec2d& b, const Vec2d& half) {
    // Clip the segment to the rectangle, axis by axis.
    const Vec2d along = b - a;
    double enter = 0.0;
    double leave = 1.0;
    for (int axis = 0; axis < 2; ++axis) {
      if (along[axis] == 0.0) {
        if (std::abs(a[axis]) > half[axis]) leave = -1.0;
        continue;
      }
      const double t = (-half[axis] - a[axis]) / along[axis];
      const double u = (half[axis] - a[axis]) / along[axis];
      enter = std::max(enter, std::min(t, u));
      leave = std::min(leave, std::max(t, u));
    }
    if (enter <= leave) return 0.0;
    // Two disjoint convex shapes are nearest at a corner of one of them.
    double distance = std::min((a.cwiseAbs() - half).cwiseMax(0.0).norm(), (b.cwiseAbs() - half).cwiseMax(0.0).norm());
    for (const Vec2d& sign : {Vec2d(1, 1), Vec2d(1, -1), Vec2d(-1, 1), Vec2d(-1, -1)}) {
      const Vec2d corner = sign.cwiseProduct(half);
      const double t = std::clamp((corner - a).dot(along) / std::max(along.squaredNorm(), 1e-12), 0.0, 1.0);
      distance = std::min(distance, (corner - a - t * along).norm());
    }
    return distance;
  }

  Vec2d size_;
  std::vector<Vec2d> pillars_;
  double radius_;
};

TEST(Plan, IsAsShortAsTheVisibilityGraphInPillarFields) {
  Random random(3);
  constexpr double kRadius = 0.25;
  for (int round = 0; round < 4; ++round) {
    std::vector<Vec2d> pillars;
    std::vector<Primitive> primitives{room({10, 8, 3})};
    while (pillars.size() < 9) {
      const Vec2d center(random.within(2.2F, 7.8F), random.within(0.5F, 7.5F));
      if (std::any_of(pillars.begin(), pillars.end(), [&](const Vec2d& p) { return (p - center).norm() < 1.5; })) continue;
      pillars.push_back(center);
      primitives.push_back(Primitive{.kind = PrimitiveKind::cylinder,
                                     .center = Vec3(static_cast<float>(center.x()), static_cast<float>(center.y()), 1.5F),
                                     .half_extents = Vec3(kRadius, kRadius, 1.5F)});
    }
    const World world(scene(primitives));
    const double shortest = VisibilityGraph({10, 8}, pillars, kRadius).shortest({1, 4}, {9, 4});
    ASSERT_TRUE(std::isfinite(shortest));
    SCOPED_TRACE("round " + std::to_string(round));
    expect_shortest(world, {1, 4, 1.5F}, {{9, 4, 1.5F}}, shortest, 0.01);
  }
}

TEST(Plan, BadArgumentsAreRefused) {
  const World world(scene({room({10, 6, 3})}));
  const DroneModel drone = box_drone();
  const Vec3 start(2, 3, 1);
  const std::vector<Vec3> goals{{8, 3, 1}};
  const auto message = [&](const Vec3& from, const std::vector<Vec3>& to, float cell, const World& where) {
    return refusal([&] { plan(where, drone, from, to, cell); });
  };
  EXPECT_TRUE(names(message(Vec3(kNan, 0, 0), goals, 0.1F, world), "start: ... coordinates"));
  EXPECT_TRUE(names(message(start, {}, 0.1F, world), "goals: ... point"));
  EXPECT_TRUE(names(message(start, {goals[0], Vec3(0, 0, kNan)}, 0.1F, world), "goals[1]: ... coordinates"));
  EXPECT_TRUE(names(message(start, goals, 0.0F, world), "cell_m: ... 0 ... 0.000000"));
  EXPECT_TRUE(names(message(start, goals, kNan, world), "cell_m: ... 0 ... nan"));
  // The start is enclosed in so little space that a search of even the finest possible grid ends soon.
  const World shut(scene({room({10, 6, 3}), box({1.3F, 3, 1.5F}, {0.55F, 2, 3}), box({2.7F, 3, 1.5F}, {0.55F, 2, 3}),
                          box({2, 2.375F, 1.5F}, {2, 0.6F, 3}), box({2, 3.625F, 1.5F}, {2, 0.6F, 3})}));
  EXPECT_EQ(message(start, goals, 0.01F, shut), "accepted");  // there is no path
  EXPECT_TRUE(names(message(start, goals, 1e-6F, shut), "cell_m: ... 33554432"));
  EXPECT_EQ(message(start, goals, 1e-6F, World(scene({room({10, 6, 3}), box({5, 3, 1.5F}, {1, 1, 3})}))), "accepted");
}

// A room with obstacles of every kind, tilted and level.
World clutter(unsigned seed) {
  Random random(seed);
  const auto place = [&] { return Vec3(random.within(0, 8), random.within(0, 6), random.within(0, 3)); };
  SceneDescription scene;
  scene.primitives.push_back({.kind = PrimitiveKind::room, .center = {4, 3, 1.5F}, .half_extents = {4, 3, 1.5F}});
  for (const PrimitiveKind kind : {PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::capsule, PrimitiveKind::sphere}) {
    for (int i = 0; i < 5; ++i) {
      const float radius = random.within(0.05F, 0.3F);
      Vec3 half(radius, radius, kind == PrimitiveKind::sphere ? radius : radius + random.within(0.0F, 0.5F));
      if (kind == PrimitiveKind::box) half.y() = random.within(0.05F, 0.5F);
      const bool is_turned = i % 2 == 0 && kind != PrimitiveKind::sphere;
      const Quat rotation = is_turned ? random.rotation() : Quat::Identity();
      scene.primitives.push_back({.kind = kind, .center = place(), .rotation = rotation, .half_extents = half});
    }
  }
  for (std::int32_t i = 0; i < 60; i += 3) {
    const Vec3 corner = place();
    for (int j = 0; j < 3; ++j) scene.mesh.vertices.push_back(corner + random.point(1));
    scene.mesh.triangles.push_back({i, i + 1, i + 2});
  }
  return World(std::move(scene));
}

TEST(Lattice, AgreesWithTheSweepOnFreeSpace) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const World world = clutter(seed);
    const FreeSpace space(world, DroneModel::quadrotor650());
    Random random(seed);
    const auto place = [&] { return Vec3(random.within(-0.2F, 8.2F), random.within(-0.2F, 6.2F), random.within(-0.2F, 3.2F)); };
    for (const float cell : {0.1F, 0.3F, 1.0F}) {
      Lattice lattice(space, world.bounds(), {4, 3, 1.5F}, {1, 1, 1}, cell, false);
      int clear = 0;
      for (int i = 0; i < 1000; ++i) {
        const Vec3 from = place();
        const Vec3 to = i % 3 == 0 ? from : Vec3(from + (i % 3 == 1 ? 0.2F : 1.0F) * (place() - from));
        const bool expected = from == to ? space.is_free(from) : space.is_free_leg(from, to);
        EXPECT_EQ(lattice.is_clear(from, to), expected) << from.transpose() << " to " << to.transpose() << ", cell " << cell;
        clear += static_cast<int>(expected);
      }
      EXPECT_GT(clear, 50);
      EXPECT_LT(clear, 950);
    }
  }
}

TEST(Lattice, NodesAreMultiplesOfTheCellFromTheStart) {
  const World world = clutter(1);
  const FreeSpace space(world, DroneModel::quadrotor650());
  const Vec3 start(2, 3, 1);
  const Vec3 goal(7.13F, 3.2F, 1.4F);
  Lattice lattice(space, world.bounds(), start, goal, 0.25F, false);
  EXPECT_EQ(lattice.position(lattice.start()), start);
  EXPECT_EQ(lattice.position(Lattice::kGoal), goal);
  int count = 0;
  lattice.for_each_neighbour(lattice.start(), [&](std::int32_t node) {
    const Vec3 away = lattice.position(node) - start;
    EXPECT_FLOAT_EQ(away.lpNorm<Eigen::Infinity>(), 0.25F);
    ++count;
  });
  EXPECT_EQ(count, 26);
  // The goal and the nodes around its nearest node are neighbours, in both directions.
  count = 0;
  lattice.for_each_neighbour(Lattice::kGoal, [&](std::int32_t node) {
    bool back = false;
    lattice.for_each_neighbour(node, [&](std::int32_t neighbour) { back |= neighbour == Lattice::kGoal; });
    EXPECT_TRUE(back);
    ++count;
  });
  EXPECT_EQ(count, 27);
}

SceneDescription navigable() {
  SceneDescription description;
  description.name = "hall";
  description.primitives = {
      Primitive{.kind = PrimitiveKind::room, .center = {5, 5, 2}, .half_extents = {5, 5, 2}},
      Primitive{.kind = PrimitiveKind::cylinder, .center = {5, 5, 2}, .half_extents = {0.25F, 0.25F, 2}},
  };
  description.markers.start = Vec3(2, 5, 2);
  description.markers.waypoints = {Vec3(5, 7, 2)};
  description.markers.goal = Vec3(8, 5, 2);
  description.markers.spawn_box = Aabb{{1.5F, 4, 1}, {2.5F, 6, 3}};
  return description;
}

TEST(Markers, AWorldWithMarkersInFreeSpaceIsNavigable) {
  EXPECT_NO_THROW(require_navigable(World(navigable()), DroneModel::quadrotor650()));
}

TEST(Markers, MayBeInTheSkyButNotAboveARoom) {
  SceneDescription yard = navigable();
  yard.primitives.erase(yard.primitives.begin());
  yard.primitives.push_back(Primitive{.kind = PrimitiveKind::box, .center = {5, 5, -0.5F}, .half_extents = {5, 5, 0.5F}});
  for (Vec3* const place : {&*yard.markers.start, &yard.markers.waypoints[0], &*yard.markers.goal}) place->z() = 30.0F;
  EXPECT_NO_THROW(require_navigable(World(yard), DroneModel::quadrotor650()));
  SceneDescription room = yard;
  room.primitives.insert(room.primitives.begin(), navigable().primitives[0]);
  EXPECT_THROW(require_navigable(World(room), DroneModel::quadrotor650()), std::invalid_argument);
  yard.markers.start->x() = 11.0F;  // beyond the floor's edge
  EXPECT_THROW(require_navigable(World(yard), DroneModel::quadrotor650()), std::invalid_argument);
}

TEST(Markers, WorldsThatCannotBeNavigatedAreNamedWithTheMarker) {
  struct Case {
    std::function<void(Markers&)> spoil;
    std::string message;
  };
  const std::vector<Case> cases{
      {[](Markers& m) { m.start.reset(); }, "start: ... point"},
      {[](Markers& m) { m.goal.reset(); }, "goal: ... point"},
      {[](Markers& m) { m.start = Vec3(5, 5, 2); }, "start: ... (5, 5, 2)"},
      {[](Markers& m) { m.start = Vec3(5, 5.5F, 2); }, "start: ... (5, 5.5, 2)"},
      {[](Markers& m) { m.start = Vec3(0.2F, 5, 2); }, "start: ... (0.2, 5, 2)"},
      {[](Markers& m) { m.start = Vec3(-3, 5, 2); }, "start: ... (0, 0, 0) ... (10, 10, 4) ... (-3, 5, 2)"},
      {[](Markers& m) { m.goal = Vec3(8, 5, 4.5F); }, "goal: ... (0, 0, 0) ... (10, 10, 4) ... (8, 5, 4.5)"},
      {[](Markers& m) { m.waypoints.emplace_back(8, 50, 2); }, "waypoints[1]: ... (0, 0, 0) ... (10, 10, 4) ... (8, 50, 2)"},
      {[](Markers& m) { m.spawn_box->max.x() = 5; }, "spawn_box: ... (5, 6, 1)"},
  };
  for (const Case& bad : cases) {
    SceneDescription description = navigable();
    bad.spoil(description.markers);
    if (bad.message.starts_with("spawn_box")) description.primitives[1].center.y() = 6;
    EXPECT_REFUSED(require_navigable(World(description), DroneModel::quadrotor650()), "world \"hall\": markers." + bad.message);
  }
}

}  // namespace
}  // namespace flockstep
