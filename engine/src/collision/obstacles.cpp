#include "collision/obstacles.hpp"

#include <limits>

namespace swiftlet::collision {

namespace {

constexpr std::size_t kFew = 64;    // elements looked at one after the other: a tree is no faster for fewer
constexpr float kRounding = 1e-5F;  // of the coordinates: bounds are this much wider, so that no rounding hides a contact

Aabb widened(const Vec3& low, const Vec3& high) {
  const Vec3 margin = kRounding * (Vec3::Ones() + low.cwiseAbs().cwiseMax(high.cwiseAbs()));
  return {low - margin, high + margin};
}

Aabb bounds_of(const Convex& convex) {
  Vec3d low;
  Vec3d high;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3d local = convex.rotation.transpose().col(axis);
    high[axis] = convex.center[axis] + local.dot(support(convex, local));
    low[axis] = convex.center[axis] + local.dot(support(convex, -local));
  }
  return widened(low.cast<float>(), high.cast<float>());
}

}  // namespace

Obstacles::Obstacles(const World& world) : world_(&world) {
  const std::span<const Primitive> primitives = world.primitives();
  const std::size_t elements = primitives.size() + world.triangles().triangles.size();
  many_ = elements > kFew;
  convexes_.resize(primitives.size());
  std::size_t place = 0;
  for (std::uint32_t element = 0; element < elements; ++element) {
    const bool is_primitive = element < primitives.size();
    if (is_primitive && primitives[element].kind == PrimitiveKind::room) {
      const Primitive& room = primitives[element];
      rooms_.push_back({element, {room.center - room.half_extents, room.center + room.half_extents}});
      continue;
    }
    if (is_primitive) {
      convexes_[element] = make_convex(primitives[element]);
    }
    if (!many_) {
      add_bounds(place++, element, bounds_of(convex(element)));
    }
  }
}

void Obstacles::add_bounds(std::size_t place, std::uint32_t element, const Aabb& bounds) {
  const std::size_t i = place % kWidth;
  if (i == 0) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Block& block = blocks_.emplace_back();
    for (auto* low : {&block.min_x, &block.min_y, &block.min_z}) {
      low->fill(kFar);
    }
    for (auto* high : {&block.max_x, &block.max_y, &block.max_z}) {
      high->fill(kFar);
    }
    block.element.fill(0);
  }
  Block& block = blocks_.back();
  block.min_x[i] = bounds.min.x();
  block.min_y[i] = bounds.min.y();
  block.min_z[i] = bounds.min.z();
  block.max_x[i] = bounds.max.x();
  block.max_y[i] = bounds.max.y();
  block.max_z[i] = bounds.max.z();
  block.element[i] = element;
}

Convex Obstacles::convex(std::uint32_t element) const {
  if (element < convexes_.size()) {
    return convexes_[element];
  }
  const TriangleMesh& mesh = world_->triangles();
  const auto& corners = mesh.triangles[element - convexes_.size()];
  const auto at = [&mesh](std::int32_t vertex) -> const Vec3& { return mesh.vertices[static_cast<std::size_t>(vertex)]; };
  return make_triangle(at(corners[0]), at(corners[1]), at(corners[2]));
}

}  // namespace swiftlet::collision
