#include "collision/obstacles.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/interrupt.hpp"

namespace flockstep::collision {

Obstacles::Obstacles(const World& world, const trace::Scene& scene, std::pmr::memory_resource& memory)
    : world_(&world), scene_(&scene), rooms_(&memory), convexes_(&memory) {
  const auto is_room = [](const Primitive& primitive) { return primitive.kind == PrimitiveKind::room; };
  rooms_.reserve(static_cast<std::size_t>(std::count_if(world.primitives().begin(), world.primitives().end(), is_room)));
  convexes_.reserve(world.primitives().size());
  for (const Primitive& primitive : world.primitives()) {
    Interrupt::poll();
    if (is_room(primitive)) {
      const auto element = static_cast<std::uint32_t>(convexes_.size());
      rooms_.push_back({element, {primitive.center - primitive.half_extents, primitive.center + primitive.half_extents}});
      convexes_.emplace_back();
    } else {
      convexes_.push_back(make_convex(primitive));
    }
  }
}

Convex Obstacles::convex(std::uint32_t element) const {
  if (element < convexes_.size()) return convexes_[element];
  const TriangleMesh& mesh = world_->triangles();
  const auto& corners = mesh.triangles[element - convexes_.size()];
  const auto at = [&mesh](std::int32_t vertex) -> const Vec3& { return mesh.vertices[static_cast<std::size_t>(vertex)]; };
  return make_triangle(at(corners[0]), at(corners[1]), at(corners[2]));
}

bool Obstacles::is_clear(const Vec3& center, float radius) const {
  for (const RoomInterior& room : rooms_) {
    const bool is_in = ((center - room.inside.min).array() > radius).all() && ((room.inside.max - center).array() > radius).all();
    if (!is_in) return false;
  }
  bool clear = true;
  for_each_near(center, radius, [&](std::uint32_t) { clear = false; });
  return clear;
}

bool Obstacles::touches(const Vec3& point, float reach) const {
  for (const RoomInterior& room : rooms_) {
    if (((point - room.inside.min).array() < reach).any() || ((room.inside.max - point).array() < reach).any()) return true;
  }
  bool touched = false;
  for_each_near(point, reach, [&](std::uint32_t element) {
    const Vec3d center = point.cast<double>();
    touched = touched || (closest_point(convex(element), center) - center).norm() < static_cast<double>(reach);
  });
  return touched;
}

NearestPoint Obstacles::nearest(const Vec3& point, float most) const {
  struct Search {
    void take(double distance, const Vec3d& at, std::uint32_t number) {
      if (!(distance < least)) return;
      least = distance;
      nearest = at;
      element = number;
    }

    const Obstacles& obstacles;
    Vec3d point;
    double least;
    Vec3d nearest = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
    std::uint32_t element = NearestPoint::kNone;
  } search{*this, point.cast<double>(), static_cast<double>(most)};
  for (const RoomInterior& room : rooms_) {
    const Vec3d low = search.point - room.inside.min.cast<double>();
    const Vec3d high = room.inside.max.cast<double>() - search.point;
    Eigen::Index axis = 0;
    const double wall = low.cwiseMin(high).minCoeff(&axis);
    Vec3d at = search.point;
    if (wall > 0.0) at[axis] = static_cast<double>((low[axis] < high[axis] ? room.inside.min : room.inside.max)[axis]);
    search.take(std::max(wall, 0.0), at, room.element);
  }
  const auto test = [](void* context, std::uint32_t element) {
    auto& s = *static_cast<Search*>(context);
    const Vec3d at = closest_point(s.obstacles.convex(element), s.point);
    s.take((at - s.point).norm(), at, element);
    return std::nextafter(static_cast<float>(s.least), std::numeric_limits<float>::max());
  };
  scene_->for_each_near(point, static_cast<float>(search.least), test, &search);
  return {search.nearest.cast<float>(), static_cast<float>(search.least), search.element};
}

}  // namespace flockstep::collision
