#include "scenario/navigable.hpp"

#include <sstream>
#include <stdexcept>
#include <string>

#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "compiled/compiled_world.hpp"

namespace flockstep {
namespace {

std::string field(const World& world, const std::string& marker) { return "world \"" + world.name() + "\": markers." + marker; }

std::string text(const Vec3& p) {
  std::ostringstream out;
  out << '(' << p.x() << ", " << p.y() << ", " << p.z() << ')';
  return out.str();
}

// Where a drone may be: a room holds it; without one the sky is open.
Aabb flown_space(const World& world) {
  Aabb box = world.bounds();
  const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
  if (!has_room) box.max.z() = static_cast<float>(kMaxCoordinate);
  return box;
}

void require_inside(const World& world, const std::string& marker, const Vec3& point) {
  const Aabb box = flown_space(world);
  if ((point.array() >= box.min.array()).all() && (point.array() <= box.max.array()).all()) return;
  refuse(field(world, marker), "a point within the world, " + text(box.min) + " to " + text(box.max), text(point));
}

void require_free(const World& world, const DroneModel& drone, const std::string& marker, const Vec3& point) {
  require_inside(world, marker, point);
  if (!collision::overlaps(compiled(world).obstacles(), collision::Hull(drone), Pose{.position = point})) return;
  refuse(field(world, marker), "room for the drone", text(point) + ", where it touches an obstacle");
}

}  // namespace

void require_navigable(const World& world, const DroneModel& drone) {
  const Markers& markers = world.markers();
  if (!markers.start) throw std::invalid_argument(field(world, "start") + ": expected a point, found none");
  if (!markers.goal) throw std::invalid_argument(field(world, "goal") + ": expected a point, found none");
  require_free(world, drone, "start", *markers.start);
  for (std::size_t i = 0; i < markers.waypoints.size(); ++i) {
    require_inside(world, "waypoints[" + std::to_string(i) + ']', markers.waypoints[i]);
  }
  require_inside(world, "goal", *markers.goal);
  if (!markers.spawn_box) return;
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Aabb& box = *markers.spawn_box;
    require_free(world, drone, "spawn_box",
                 Vec3((corner & 1U) != 0 ? box.max.x() : box.min.x(), (corner & 2U) != 0 ? box.max.y() : box.min.y(),
                      (corner & 4U) != 0 ? box.max.z() : box.min.z()));
  }
}

}  // namespace flockstep
