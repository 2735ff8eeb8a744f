#include "planning/navigable.hpp"

#include <sstream>
#include <stdexcept>
#include <string>

#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

std::string field(const World& world, const std::string& place) { return "world \"" + world.name() + "\": " + place; }

std::string coordinates(const Vec3& p) {
  std::ostringstream out;
  out << '(' << p.x() << ", " << p.y() << ", " << p.z() << ')';
  return out.str();
}

bool has_room(const World& world) {
  return !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
}

// Returns the space for markers: the bounds of the world, without an upper end if there is no room.
Aabb marked_space(const World& world) {
  Aabb box = world.bounds();
  if (!has_room(world)) box.max.z() = static_cast<float>(kMaxCoordinate);
  return box;
}

void require_inside(const World& world, const Aabb& box, const std::string& place, const Vec3& point) {
  if ((point.array() >= box.min.array()).all() && (point.array() <= box.max.array()).all()) return;
  refuse(field(world, place), "a point within the world, " + coordinates(box.min) + " to " + coordinates(box.max),
         coordinates(point));
}

}  // namespace

void require_free(const World& world, const DroneModel& drone, const std::string& place, const Vec3& point) {
  require_inside(world, open_space(world), place, point);
  if (!collision::overlaps(prepared(world).obstacles(), collision::Hull(drone), Pose{.position = point})) return;
  refuse(field(world, place), "room for the drone", coordinates(point) + ", where it touches an obstacle");
}

Aabb open_space(const World& world) {
  if (has_room(world)) return world.bounds();
  constexpr auto kEnd = static_cast<float>(kMaxCoordinate);
  return {.min = Vec3::Constant(-kEnd), .max = Vec3::Constant(kEnd)};
}

void require_navigable(const World& world, const DroneModel& drone) {
  const Markers& markers = world.markers();
  for (const auto& [marker, name] : {std::pair{&markers.start, "markers.start"}, std::pair{&markers.goal, "markers.goal"}}) {
    if (*marker) continue;
    throw std::invalid_argument(field(world, name) +
                                ": expected a point, found none (world.with_drawn_markers(seed) draws them)");
  }
  const Aabb space = marked_space(world);
  const auto require_marker = [&](const std::string& place, const Vec3& point) { require_inside(world, space, place, point); };
  require_marker("markers.start", *markers.start);
  require_free(world, drone, "markers.start", *markers.start);
  for (std::size_t i = 0; i < markers.waypoints.size(); ++i) {
    require_marker("markers.waypoints[" + std::to_string(i) + ']', markers.waypoints[i]);
  }
  require_marker("markers.goal", *markers.goal);
  if (!markers.spawn_box) return;
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Aabb& box = *markers.spawn_box;
    const Vec3 point((corner & 1U) != 0 ? box.max.x() : box.min.x(), (corner & 2U) != 0 ? box.max.y() : box.min.y(),
                     (corner & 4U) != 0 ? box.max.z() : box.min.z());
    require_marker("markers.spawn_box", point);
    require_free(world, drone, "markers.spawn_box", point);
  }
}

}  // namespace flockstep
