// Surveys, places and reports in small worlds. tests/python/worlds/test_survey.py has the oracles.
#include "flockstep/survey.hpp"

#include "flockstep/planning.hpp"
#include "flockstep/world_report.hpp"
#include "planning/reach.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Two rooms of 5 x 4 x 3 m, separated by a wall with an opening of the given width. A triangle hangs in the first room.
SceneDescription two_rooms(float door) {
  SceneDescription scene;
  scene.primitives.push_back({PrimitiveKind::room, {5, 2, 1.5F}, Quat::Identity(), {5, 2, 1.5F}});
  const float half = 0.25F * (4.0F - door);
  for (const float y : {half, 4.0F - half}) {
    scene.primitives.push_back({PrimitiveKind::box, {5, y, 1.5F}, Quat::Identity(), {0.1F, half, 1.5F}});
  }
  scene.mesh.vertices = {{1, 1, 2.5F}, {2, 1, 2.5F}, {1, 2, 2.5F}};
  scene.mesh.triangles = {{0, 1, 2}};
  return scene;
}

TEST(Survey, ObjectsAreThePrimitivesAndTheMeshes) {
  SceneDescription scene = two_rooms(1.0F);
  scene.mesh.objects = {3};  // object numbers may have gaps
  const ObjectList list = objects(World(scene));
  ASSERT_EQ(list.boxes.size(), 7U);
  EXPECT_EQ(list.boxes[0].max, Vec3(10, 4, 3));
  EXPECT_TRUE(std::isnan(list.boxes[5].min.x()));
  EXPECT_EQ(list.materials[5], -1);
  EXPECT_EQ(list.boxes[6].min, Vec3(1, 1, 2.5F));
  EXPECT_EQ(list.boxes[6].max, Vec3(2, 2, 2.5F));
}

TEST(Survey, PointsCoverEqualAreas) {
  const PointCloud cloud = point_cloud(World(two_rooms(1.0F)), 0.125F);
  const auto on_triangle = std::count(cloud.objects.begin(), cloud.objects.end(), 3);
  EXPECT_NEAR(static_cast<double>(on_triangle), 0.5 / (0.125 * 0.125), 1.0);
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    if (cloud.objects[i] != 3) continue;
    EXPECT_EQ(cloud.points[i].z(), 2.5F);
    EXPECT_EQ(cloud.normals[i], Vec3(0, 0, 1));
    EXPECT_GE(cloud.points[i].x(), 1.0F);
    EXPECT_GE(cloud.points[i].y(), 1.0F);
    EXPECT_LE(cloud.points[i].x() + cloud.points[i].y(), 3.0F);
  }
}

TEST(Survey, TooManyPointsAreRefusedBeforeTheirTrianglesAreMade) {
  SceneDescription scene;
  scene.primitives.push_back({PrimitiveKind::sphere, {0, 0, 0}, Quat::Identity(), {100, 100, 100}});
  const World world(scene);
  EXPECT_REFUSED(point_cloud(world, 1e-4F), "spacing_m: ... 50,000,000");
}

TEST(Survey, GridsCoverTheWorld) {
  const World world(two_rooms(1.0F));
  const OccupancyGrid cells = occupancy(world, 0.5F);
  EXPECT_EQ(cells.grid.size, (std::array<int, 3>{20, 8, 6}));
  const DistanceGrid far = distance(world, 0.5F);
  const auto place = [&](int i, int j, int k) { return static_cast<std::size_t>((i * 8 + j) * 6 + k); };
  EXPECT_EQ(cells.occupied[place(0, 4, 3)], 1);                                   // touches a wall
  EXPECT_EQ(cells.occupied[place(6, 4, 3)], 0);                                   // in open space
  EXPECT_EQ(cells.occupied[place(2, 2, 4)] + cells.occupied[place(2, 2, 5)], 2);  // both sides of the triangle
  EXPECT_NEAR(far.distance_m[place(2, 2, 4)], 0.25F, 1e-6F);
  EXPECT_NEAR(far.distance_m[place(0, 4, 3)], 0.25F, 1e-6F);
}

TEST(Reach, PassesADoorThatIsWideEnough) {
  const DroneModel drone = DroneModel::quadrotor650();  // 0.59 m wide
  const World open(two_rooms(1.0F));
  const World closed(two_rooms(0.5F));
  for (const World* world : {&open, &closed}) {
    Reach reach(*world, drone, {2, 0.8F, 1}, world->bounds(), 0.2F);
    for (int i = 0; i < 3; ++i) {  // repeated queries agree
      EXPECT_EQ(reach.includes({8, 3, 2}), world == &open);
      EXPECT_TRUE(reach.includes({1, 3, 2}));
      EXPECT_EQ(reach.includes({9, 1, 1}), world == &open);
      EXPECT_FALSE(reach.includes({5, 0.5F, 1}));  // inside the wall
    }
  }
}

TEST(Reach, DrawnMarkersAreOnTheSameSide) {
  const World closed(two_rooms(0.5F));
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Markers markers = drawn_markers(closed, DroneModel::quadrotor650(), {.seed = seed}, 1.5F);
    EXPECT_EQ(markers.start->x() < 5, markers.goal->x() < 5);
    EXPECT_GE((*markers.goal - *markers.start).norm(), 1.5F);
    EXPECT_EQ(check(*closed.with_markers(markers), DroneModel::quadrotor650()).not_navigable, "");
  }
}

TEST(WorldReport, CountsEdgesOfWeldedTriangles) {
  SceneDescription scene;
  scene.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, -0.0F, 0}, {0, 0, 1}, {0, 0, 0}, {1, 0, 0}, {0, -1, 0}};
  scene.mesh.triangles = {{0, 1, 2}, {3, 4, 5}, {6, 7, 8}};  // three triangles with a common edge
  const WorldReport report = check(World(scene), DroneModel::quadrotor650());
  EXPECT_EQ(report.crowded_edges, 1U);
  EXPECT_EQ(report.open_edges, 6U);
  EXPECT_NE(report.not_navigable.find("markers.start: expected a point"), std::string::npos);
}

}  // namespace
}  // namespace flockstep
