#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "collide.hpp"
#include "flockstep/planning.hpp"

namespace flockstep {
namespace {

using Vec2d = Eigen::Vector2d;

constexpr float kHalfLength = 0.4F;
constexpr float kHalfWidth = 0.3F;
constexpr float kHalfHeight = 0.1F;

// A box-shaped drone. The region that an obstacle blocks for its centre is known exactly.
DroneModel box_drone() {
  std::vector<Vec3> hull;
  for (const float x : {-kHalfLength, kHalfLength}) {
    for (const float y : {-kHalfWidth, kHalfWidth}) {
      for (const float z : {-kHalfHeight, kHalfHeight}) hull.emplace_back(x, y, z);
    }
  }
  return DroneModel(std::move(hull));
}

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
  std::mt19937 random(3);
  const auto draw = [&random](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  constexpr double kRadius = 0.25;
  for (int round = 0; round < 4; ++round) {
    std::vector<Vec2d> pillars;
    std::vector<Primitive> primitives{room({10, 8, 3})};
    while (pillars.size() < 9) {
      const Vec2d center(draw(2.2, 7.8), draw(0.5, 7.5));
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
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto message = [&](const Vec3& from, const std::vector<Vec3>& to, float cell, const World& where) -> std::string {
    try {
      plan(where, drone, from, to, cell);
      return "accepted";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_EQ(message(Vec3(nan, 0, 0), goals, 0.1F, world), "start: expected finite coordinates, got NaN or infinity");
  EXPECT_EQ(message(start, {}, 0.1F, world), "goals: expected at least one point, got none");
  EXPECT_EQ(message(start, {goals[0], Vec3(0, 0, nan)}, 0.1F, world),
            "goals[1]: expected finite coordinates, got NaN or infinity");
  EXPECT_EQ(message(start, goals, 0.0F, world), "cell_m: expected a number > 0, got 0.000000");
  EXPECT_EQ(message(start, goals, nan, world), "cell_m: expected a number > 0, got nan");
  // The start is enclosed in so little space that a search of even the finest possible grid ends soon.
  const World shut(scene({room({10, 6, 3}), box({1.3F, 3, 1.5F}, {0.55F, 2, 3}), box({2.7F, 3, 1.5F}, {0.55F, 2, 3}),
                          box({2, 2.375F, 1.5F}, {2, 0.6F, 3}), box({2, 3.625F, 1.5F}, {2, 0.6F, 3})}));
  EXPECT_EQ(message(start, goals, 0.01F, shut), "accepted");  // there is no path
  EXPECT_EQ(
      message(start, goals, 1e-6F, shut).rfind("cell_m: expected a spacing at which a search of 33554432 cells is enough", 0),
      0U);
  EXPECT_EQ(message(start, goals, 1e-6F, World(scene({room({10, 6, 3}), box({5, 3, 1.5F}, {1, 1, 3})}))), "accepted");
}

}  // namespace
}  // namespace flockstep
