// Guarantees of all playgrounds, bundled and generated: comfortable gaps, a straight flight that crashes, and a free path.
#include <map>
#include <set>

#include "bodies/body_script.hpp"
#include "collide.hpp"
#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/scenes.hpp"
#include "flockstep/world.hpp"
#include "planning/navigable.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Vec2 = Eigen::Vector2f;

std::vector<Vec3> route(const World& world) {
  std::vector<Vec3> markers{*world.markers().start};
  markers.insert(markers.end(), world.markers().waypoints.begin(), world.markers().waypoints.end());
  markers.push_back(*world.markers().goal);
  return markers;
}

std::vector<Primitive> pillars(const World& world) {
  EXPECT_EQ(world.primitives()[0].kind, PrimitiveKind::room);
  return {world.primitives().begin() + 1, world.primitives().end()};
}

bool is_clear(const World& world, const DroneModel& drone, const Vec3& from, const Vec3& to) {
  return !testing::sweep(world, drone, Pose{.position = from}, Pose{.position = to}).hit;
}

bool straight_flight_crashes(const World& world, const DroneModel& drone) {
  const std::vector<Vec3> markers = route(world);
  for (std::size_t i = 1; i < markers.size(); ++i) {
    if (!is_clear(world, drone, markers[i - 1], markers[i])) return true;
  }
  return false;
}

// Smallest distance between surfaces, seen from above.
float smallest_gap(const std::vector<Primitive>& cylinders) {
  float gap = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < cylinders.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Vec2 between = (cylinders[i].center - cylinders[j].center).head<2>();
      gap = std::min(gap, between.norm() - cylinders[i].half_extents.x() - cylinders[j].half_extents.x());
    }
  }
  return gap;
}

float smallest_marker_clearance(const World& world) {
  float clearance = std::numeric_limits<float>::infinity();
  for (const Primitive& pillar : pillars(world)) {
    for (const Vec3& marker : route(world)) {
      clearance = std::min(clearance, Vec2((pillar.center - marker).head<2>()).norm() - pillar.half_extents.x());
    }
  }
  return clearance;
}

void expect_full_height(const World& world) {
  for (const Primitive& pillar : pillars(world)) {
    EXPECT_EQ(pillar.kind, PrimitiveKind::cylinder);
    EXPECT_TRUE(pillar.rotation.isApprox(Quat::Identity()));
    EXPECT_EQ(pillar.center.z(), world.primitives()[0].center.z());
    EXPECT_EQ(pillar.half_extents.z(), world.primitives()[0].half_extents.z());
  }
}

void expect_way_through(const World& world, const DroneModel& drone) {
  const std::vector<Vec3> markers = route(world);
  const auto path = plan(world, drone, markers[0], std::span(markers).subspan(1));
  ASSERT_TRUE(path);
  for (std::size_t i = 1; i < path->size(); ++i) EXPECT_TRUE(is_clear(world, drone, (*path)[i - 1], (*path)[i]));
  for (const Vec3& marker : markers) EXPECT_NE(std::find(path->begin(), path->end(), marker), path->end());
}

// ------------------------------------------------------------------------------------------------------- bundled playgrounds

// Start, waypoints and goal, from the positions published in the thesis, with the room centred on them.
const std::map<std::string, std::vector<Vec3>> kRoutes{
    {"train-1", {{2.15F, 6.15F, 1.38F}, {4.85F, 7.25F, 1.88F}, {9.05F, 7.85F, 3.17F}, {11.85F, 6.15F, 1.57F}}},
    {"train-2",
     {{1.92F, 10.30F, 2.62F},
      {4.12F, 8.00F, 3.27F},
      {4.53F, 4.90F, 2.33F},
      {7.83F, 3.70F, 0.97F},
      {10.93F, 5.80F, 1.88F},
      {12.07F, 8.00F, 2.62F}}},
    {"train-3",
     {{2.53F, 2.67F, 2.62F}, {5.47F, 5.88F, 2.67F}, {6.72F, 7.92F, 2.88F}, {9.32F, 9.68F, 1.77F}, {11.47F, 11.32F, 2.62F}}},
    {"train-4",
     {{2.78F, 7.03F, 2.62F}, {4.67F, 7.38F, 1.18F}, {7.33F, 6.38F, 2.98F}, {9.38F, 8.03F, 1.07F}, {11.22F, 5.97F, 2.62F}}},
    {"train-5", {{2.30F, 6.92F, 2.62F}, {5.50F, 6.08F, 3.98F}, {8.65F, 8.12F, 2.98F}, {11.70F, 5.88F, 2.62F}}},
    {"validation-1", {{2.30F, 6.97F, 2.62F}, {5.85F, 7.22F, 3.98F}, {11.70F, 6.78F, 2.62F}}},
    {"validation-2", {{2.30F, 5.50F, 3.12F}, {5.50F, 8.50F, 2.27F}, {8.15F, 6.10F, 2.98F}, {11.70F, 8.50F, 1.98F}}},
    {"camera-train-1", {{2.30F, 7.70F, 3.12F}, {11.70F, 6.30F, 3.12F}}},
    {"camera-train-2", {{2.30F, 5.83F, 3.12F}, {11.70F, 8.18F, 3.12F}}},
    {"camera-validation-1", {{2.30F, 6.03F, 3.12F}, {11.70F, 7.97F, 3.12F}}},
    {"camera-validation-2", {{2.30F, 8.20F, 3.12F}, {11.70F, 5.80F, 3.12F}}},
};

class ShippedPlayground : public ::testing::TestWithParam<std::string> {
 protected:
  std::shared_ptr<const World> world_ = World::load(std::string(FLOCKSTEP_SCENES) + "/playground/" + GetParam() + ".json");
  DroneModel drone_ = DroneModel::quadrotor650();
};

TEST_P(ShippedPlayground, HasTheRoomAndTheMarkersOfTheThesis) {
  EXPECT_EQ(world_->bounds().min, Vec3(0, 0, 0));
  EXPECT_EQ(world_->bounds().max, Vec3(14, 14, 5.25F));
  EXPECT_EQ(world_->markers().radius, 0.25F);
  EXPECT_EQ(route(*world_), kRoutes.at(GetParam()));
  EXPECT_NO_THROW(require_navigable(*world_, drone_));
}

TEST_P(ShippedPlayground, HasPillarsWithComfortableGaps) {
  expect_full_height(*world_);
  const std::vector<Primitive> all = pillars(*world_);
  EXPECT_GE(all.size(), 10U);
  EXPECT_LE(all.size(), 14U);
  for (const Primitive& pillar : all) EXPECT_EQ(pillar.half_extents.x(), 0.25F);
  EXPECT_GE(smallest_gap(all), 1.4F);
  EXPECT_GE(smallest_marker_clearance(*world_), 0.9F);
}

TEST_P(ShippedPlayground, BlocksTheStraightFlightAndHasAPath) {
  EXPECT_TRUE(straight_flight_crashes(*world_, drone_));
  expect_way_through(*world_, drone_);
}

std::vector<std::string> names(bool with_camera) {
  std::vector<std::string> list;
  for (const auto& [name, markers] : kRoutes) {
    if (with_camera == name.starts_with("camera")) list.push_back(name);
  }
  return list;
}

std::string test_name(const ::testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Lidar, ShippedPlayground, ::testing::ValuesIn(names(false)), test_name);
INSTANTIATE_TEST_SUITE_P(Camera, ShippedPlayground, ::testing::ValuesIn(names(true)), test_name);

class CameraPlayground : public ShippedPlayground {};

// The camera task's drone moves 0.1 m per step forward, left or right, never back.
TEST_P(CameraPlayground, CanBeFlownOnlyForwards) {
  constexpr float kStep = 0.1F;
  constexpr float kReached = 0.5F;
  const Vec3 start = *world_->markers().start;
  const Vec3 goal = *world_->markers().goal;
  const auto at = [&](int forward, int left) {
    return Vec3(start + Vec3(kStep * static_cast<float>(forward), kStep * static_cast<float>(left), 0.0F));
  };
  std::set<int> row{0};  // reachable positions, in steps to the left, after `forward` steps
  bool reached = false;
  for (int forward = 0; !row.empty() && !reached && at(forward, 0).x() < goal.x() + kReached; ++forward) {
    std::set<int> reachable = row;
    for (const int entry : row) {
      for (const int side : {-1, 1}) {
        int left = entry;
        while (is_clear(*world_, drone_, at(forward, left), at(forward, left + side))) {
          left += side;
          if (!reachable.insert(left).second) break;
        }
      }
    }
    row.clear();
    for (const int left : reachable) {
      reached |= (at(forward, left) - goal).norm() < kReached;
      if (is_clear(*world_, drone_, at(forward, left), at(forward + 1, left))) row.insert(left);
    }
  }
  EXPECT_TRUE(reached);
}

// Checks free places between start and goal from which the goal is within a horizontal field of view of 90 degrees.
TEST_P(CameraPlayground, ShowsItsGoalFromMostPlaces) {
  const Vec3 goal = *world_->markers().goal;
  int seen = 0;
  int places = 0;
  for (float x = 2.3F; x < goal.x() - 0.5F; x += 0.25F) {
    for (float y = 3.0F; y <= 11.0F; y += 0.25F) {
      const Vec3 place(x, y, goal.z());
      if (std::abs(goal.y() - y) > goal.x() - x || testing::overlaps(*world_, drone_, Pose{.position = place})) continue;
      ++places;
      const Vec2 along = (goal - place).head<2>();
      const std::vector<Primitive> all = pillars(*world_);
      seen += std::none_of(all.begin(), all.end(), [&](const Primitive& pillar) {
        const Vec2 to_pillar = (pillar.center - place).head<2>();
        const float t = std::clamp(to_pillar.dot(along) / along.squaredNorm(), 0.0F, 1.0F);
        return (to_pillar - t * along).norm() < pillar.half_extents.x();
      });
    }
  }
  EXPECT_GT(static_cast<double>(seen) / places, 0.65);
}

INSTANTIATE_TEST_SUITE_P(Camera, CameraPlayground, ::testing::ValuesIn(names(true)), test_name);

// ------------------------------------------------------------------------------------------------------ generated playgrounds

void expect_obstacle_course(const World& world, int num_pillars) {
  const DroneModel drone = DroneModel::quadrotor650();
  EXPECT_EQ(pillars(world).size(), static_cast<std::size_t>(num_pillars));
  EXPECT_GE(smallest_marker_clearance(world), 0.9F - 1e-5F);
  EXPECT_NO_THROW(require_navigable(world, drone));
  EXPECT_EQ(straight_flight_crashes(world, drone), num_pillars > 0);
  expect_way_through(world, drone);
}

TEST(GeneratedPlayground, KeepsItsGuarantees) {
  std::set<std::size_t> waypoints;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const auto world = playground({.seed = seed});
    EXPECT_EQ(world->name(), "playground/seed-" + std::to_string(seed));
    EXPECT_EQ(world->bounds().max, Vec3(14, 14, 5.25F));
    expect_full_height(*world);
    expect_obstacle_course(*world, 12);
    EXPECT_GE(smallest_gap(pillars(*world)), 1.4F - 1e-5F);
    waypoints.insert(world->markers().waypoints.size());
  }
  EXPECT_EQ(waypoints, (std::set<std::size_t>{1, 2, 3, 4}));
}

TEST(GeneratedPlayground, ManySizesAndNumbersOfPillars) {
  std::vector<PlaygroundConfig> configs;
  for (const int count : {0, 1, 30, 60, 120, 200}) configs.push_back({.seed = 5, .pillars = count});
  configs.push_back({.seed = 5, .pillars = 1, .size_m = {6, 6, 1.5F}});
  configs.push_back({.seed = 5, .pillars = 6, .size_m = {8, 8, 3}});
  configs.push_back({.seed = 5, .pillars = 20, .size_m = {40, 10, 8}});
  configs.push_back({.seed = 5, .pillars = 12, .pillar_radius_m = 0.5F});
  configs.push_back({.seed = 5, .pillars = 12, .pillar_radius_m = 0.05F});
  for (const PlaygroundConfig& config : configs) {
    SCOPED_TRACE(std::to_string(config.pillars) + " pillars, " + std::to_string(config.size_m[0]) + " m");
    const auto world = playground(config);
    expect_obstacle_course(*world, config.pillars);
    EXPECT_GT(smallest_gap(pillars(*world)), 0.0F);
  }
}

// FNV-1a, 64 bits.
std::uint64_t hash(const std::string& text) {
  std::uint64_t value = 0xcbf29ce484222325U;
  for (const char c : text) value = (value ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  return value;
}

TEST(GeneratedPlayground, EachSeedIsOneWorld) {
  EXPECT_EQ(playground({.seed = 7})->to_json(), playground({.seed = 7})->to_json());
  EXPECT_NE(playground({.seed = 7})->to_json(), playground({.seed = 8})->to_json());
  EXPECT_NE(playground({.seed = 7})->to_json(), playground({.seed = 7 + (std::uint64_t{1} << 32U)})->to_json());
  // The same on every machine. If this changes, published seeds give different worlds.
  EXPECT_EQ(hash(playground({.seed = 0})->to_json()), 10824598738912704581U);
  EXPECT_EQ(hash(playground({.seed = 1, .pillars = 40})->to_json()), 10314493496929844638U);
}

TEST(GeneratedPlayground, BadConfigsAreRefused) {
  const std::vector<std::pair<PlaygroundConfig, std::string>> cases{
      {{.pillars = -1}, "pillars: ... [0, 200] ... -1"},
      {{.pillars = 201}, "pillars: ... [0, 200] ... 201"},
      {{.size_m = {5, 14, 5}}, "size_m[0]: ... [6, 200] ... 5"},
      {{.size_m = {14, kNan, 5}}, "size_m[1]: ... [6, 200] ... nan"},
      {{.size_m = {14, 14, 1}}, "size_m[2]: ... [1.5, 100] ... 1"},
      {{.size_m = {14, 14, std::numeric_limits<float>::infinity()}}, "size_m[2]: ... [1.5, 100] ... inf"},
      {{.pillar_radius_m = 0}, "pillar_radius_m: ... >= 0.01 ... 0"},
      {{.pillar_radius_m = 1.5F}, "pillar_radius_m: ... 1 ... 1.5"},
      {{.pillar_radius_m = kNan}, "pillar_radius_m: ... >= 0.01 ... nan"},
  };
  for (const auto& tried : cases) EXPECT_REFUSED(playground(tried.first), "playground: " + tried.second);
}

TEST(GeneratedPlayground, TooManyPillarsAreRefused) {
  EXPECT_REFUSED(playground({.pillars = 200, .size_m = {6, 6, 2}, .pillar_radius_m = 0.4F}),
                 "playground: pillars: ... 6 ... 6 ... 200");
}

// -- Worlds that are generated with bodies: none ever touches the static world, except the floor under wheels, and the static
// world is that without bodies.

// The corners of a box around a body.
DroneModel box_around(const BodyConfig& body) {
  std::vector<Vec3> corners;
  if (body.mesh) {
    constexpr float kAboveFloor = 0.05F;  // m
    Aabb box = body.mesh->bounds();
    box.min.z() += kAboveFloor;
    for (int i = 0; i < 8; ++i) {
      corners.emplace_back((i & 1 ? box.max : box.min).x(), (i & 2 ? box.max : box.min).y(), (i & 4 ? box.max : box.min).z());
    }
    return DroneModel(corners);
  }
  const Vec3 half = 0.5F * Vec3(body.size_m[0], body.size_m[1], body.size_m[2]);
  const float round = body.shape == BodyShape::box ? 1.0F : 0.70F;  // inside of a cylinder
  for (int i = 0; i < 8; ++i) {
    corners.emplace_back((i & 1 ? round : -round) * half.x(), (i & 2 ? round : -round) * half.y(), (i & 4 ? 1 : -1) * half.z());
  }
  return DroneModel(corners);
}

void expect_free_ways(const World& world) {
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  for (const BodyConfig& body : world.bodies()) {
    SCOPED_TRACE(world.name() + ", " + body.name);
    const bodies::BodyScript script(body);
    EXPECT_TRUE(script.moves() || body.name == "door");  // some stay open
    const collision::Hull hull(box_around(body));
    for (std::int64_t episode = 0; episode < 3; ++episode) {
      for (int i = 0; i < 300; i += kThinning) {
        const bodies::Moment moment = script.at(0.37 * i, {.seed = 5, .episode = episode});
        ASSERT_FALSE(collision::overlaps(obstacles, hull, moment.pose)) << moment.pose.position.transpose();
      }
    }
  }
}

TEST(Movers, NeverTouchTheStaticWorld) {
  for (const char* name : {"living_playground/seed-1", "living_playground/seed-2", "living_playground/seed-3",
                           "living_warehouse/seed-1", "living_office/seed-1", "living_office/seed-2", "living_city/seed-1"}) {
    const auto world = load_scene(name, {});
    EXPECT_GE(world->bodies().size(), 3U) << name;
    expect_free_ways(*world);
  }
}

TEST(Movers, LeaveTheStaticWorldUnchanged) {
  EXPECT_EQ(playground({.seed = 4, .movers = 5})->with_bodies({})->content_hash(), playground({.seed = 4})->content_hash());
  EXPECT_EQ(warehouse({.seed = 4, .forklifts = 3})->with_bodies({})->content_hash(), warehouse({.seed = 4})->content_hash());
  // An office with people has doors that move instead of leaves that stand open.
  const auto still = office({.seed = 4}), living = office({.seed = 4, .walkers = 4});
  EXPECT_EQ(living->primitives().size(), still->primitives().size());
  EXPECT_LT(living->triangles().triangles.size(), still->triangles().triangles.size());
  EXPECT_TRUE(living->bounds().min == still->bounds().min && living->bounds().max == still->bounds().max);
}

TEST(Movers, TheSameSeedGivesTheSameBodies) {
  const auto a = playground({.seed = 9, .movers = 5}), b = playground({.seed = 9, .movers = 5});
  EXPECT_EQ(a->bodies().size(), 5U);
  EXPECT_EQ(a->content_hash(), b->content_hash());
  EXPECT_NE(a->content_hash(), playground({.seed = 9, .movers = 4})->content_hash());
}

TEST(Movers, LeaveRoomForTheStart) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto world = playground({.seed = seed, .movers = 8});
    const Vec3 start = *world->markers().start;
    for (const BodyConfig& body : world->bodies()) {
      const bodies::BodyScript script(body);
      for (int i = 0; i < 100; ++i) {
        const Vec3 position = script.at(0.31 * i, {.seed = seed}).pose.position;
        ASSERT_GT((position - start).head<2>().norm(), 1.0F) << seed;
      }
    }
  }
}

}  // namespace
}  // namespace flockstep
