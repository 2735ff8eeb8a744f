#include "planning/navigable.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

namespace flockstep {
namespace {

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
      {[](Markers& m) { m.start.reset(); }, "start: expected a point, found none (world.with_drawn_markers(seed) draws them)"},
      {[](Markers& m) { m.goal.reset(); }, "goal: expected a point, found none (world.with_drawn_markers(seed) draws them)"},
      {[](Markers& m) { m.start = Vec3(5, 5, 2); },
       "start: expected room for the drone, got (5, 5, 2), where it touches an obstacle"},
      {[](Markers& m) { m.start = Vec3(5, 5.5F, 2); },
       "start: expected room for the drone, got (5, 5.5, 2), where it touches an obstacle"},
      {[](Markers& m) { m.start = Vec3(0.2F, 5, 2); },
       "start: expected room for the drone, got (0.2, 5, 2), where it touches an obstacle"},
      {[](Markers& m) { m.start = Vec3(-3, 5, 2); },
       "start: expected a point within the world, (0, 0, 0) to (10, 10, 4), got (-3, 5, 2)"},
      {[](Markers& m) { m.goal = Vec3(8, 5, 4.5F); },
       "goal: expected a point within the world, (0, 0, 0) to (10, 10, 4), got (8, 5, 4.5)"},
      {[](Markers& m) { m.waypoints.emplace_back(8, 50, 2); },
       "waypoints[1]: expected a point within the world, (0, 0, 0) to (10, 10, 4), got (8, 50, 2)"},
      {[](Markers& m) { m.spawn_box->max.x() = 5; },
       "spawn_box: expected room for the drone, got (5, 6, 1), where it touches an obstacle"},
  };
  for (const Case& bad : cases) {
    SceneDescription description = navigable();
    bad.spoil(description.markers);
    if (bad.message.starts_with("spawn_box")) description.primitives[1].center.y() = 6;
    try {
      require_navigable(World(description), DroneModel::quadrotor650());
      ADD_FAILURE() << "accepted: " << bad.message;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), "world \"hall\": markers." + bad.message);
    }
  }
}

}  // namespace
}  // namespace flockstep
