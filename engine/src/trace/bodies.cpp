#include "trace/bodies.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "trace/near_balls.hpp"

namespace flockstep::trace {
namespace {

// Returns the shape of a body at its pose. Its bits are those of the same solid in a world, except the bounding box: if the body
// is turned, this is the box around its ball, which takes less time to compute than a tight one.
Shape shape_of(const Bodies& bodies, std::size_t number) {
  const Primitive& solid = *bodies.solids[number];
  const float* const p = bodies.position + 3 * number;
  const float* const q = bodies.quat_wxyz + 4 * number;
  Shape shape;
  shape.kind = shape_kind_of(solid.kind);
  const bool is_turned = q[0] != 1.0F || q[1] != 0.0F || q[2] != 0.0F || q[3] != 0.0F;
  shape.aligned = solid.kind == PrimitiveKind::sphere || !is_turned;
  shape.box_center = {p[0], p[1], p[2]};
  shape.box_half = shape.aligned ? solid.half_extents : Vec3::Constant(bodies.radius[number]);
  shape.box_half += 1e-5F * (Vec3::Ones() + shape.box_center.cwiseAbs() + shape.box_half);
  if (!shape.aligned) shape.to_local = Quat(q[0], q[1], q[2], q[3]).toRotationMatrix().transpose();
  for (int axis = 0; axis < 3; ++axis) {
    shape.center[axis] = p[axis];
    shape.half_extents[axis] = solid.half_extents[axis];
  }
  return shape;
}

// True if the shape's own bounding box may be within range of a point in its frame.
bool is_within(const Shape& shape, const std::array<float, 3>& local, float range_m) {
  float squared = 0.0F, extent = 1.0F + range_m;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float beside = std::max(std::abs(local[axis]) - shape.half_extents[axis], 0.0F);
    squared += beside * beside;
    extent += std::abs(shape.center[axis]) + shape.half_extents[axis];
  }
  const float reach = range_m + 1e-5F * extent;  // more than the rounding of `local`
  return squared <= reach * reach;
}

}  // namespace

Primitive posed_solid(const Bodies& bodies, std::size_t number) {
  Primitive solid = *bodies.solids[number];
  const float* const p = bodies.position + 3 * number;
  const float* const q = bodies.quat_wxyz + 4 * number;
  solid.center = {p[0], p[1], p[2]};
  if (solid.kind != PrimitiveKind::sphere) solid.rotation = Quat(q[0], q[1], q[2], q[3]);  // a turned one is the same
  return solid;
}

PosedMesh posed_mesh(const Bodies& bodies, std::size_t number) {
  const float* const p = bodies.position + 3 * number;
  const float* const q = bodies.quat_wxyz + 4 * number;
  return {.scene = bodies.mesh(number),
          .position = {p[0], p[1], p[2]},
          .to_local = Quat(q[0], q[1], q[2], q[3]).toRotationMatrix().transpose(),
          .radius = bodies.radius[number],
          .element = bodies.first_element + static_cast<std::int32_t>(number)};
}

void append_shapes(const Bodies& bodies, std::vector<NumberedShape>& shapes) {
  if (bodies.solids == nullptr) return;
  shapes.reserve(shapes.size() + bodies.count);
  for (std::size_t i = 0; i < bodies.count; ++i) {
    if (bodies.is_visible(i) && bodies.mesh(i) == nullptr)
      shapes.push_back({shape_of(bodies, i), bodies.first_element + static_cast<std::int32_t>(i)});
  }
}

void append_meshes(const Bodies& bodies, std::vector<PosedMesh>& meshes) {
  for (std::size_t i = 0; i < bodies.count; ++i) {
    if (bodies.is_visible(i) && bodies.mesh(i) != nullptr) meshes.push_back(posed_mesh(bodies, i));
  }
}

void NearBodies::gather(const Bodies& bodies, const Bodies& drones, const Vec3& origin, float near_m, float range_m) {
  clear();
  const std::size_t most = bodies.count + drones.count;
  if (found_.size() < most + BallColumns::kPadding) {
    found_.resize(most + BallColumns::kPadding);
    shapes_.reserve(most);
    candidates_.reserve(most);
    meshes_.reserve(most);
    hulls_.reserve(most);
  }
  add(bodies, origin, near_m, range_m);
  add(drones, origin, near_m, range_m);
}

void NearBodies::add(const Bodies& bodies, const Vec3& origin, float near_m, float range_m) {
  if (bodies.count == 0) return;
  if (bodies.common_hull != nullptr && turned_.size() < bodies.count) turned_.resize(bodies.count);
  const std::size_t count = bodies.slices != nullptr ? bodies.slices->find(origin, range_m, found_.data())
                                                     : find_near_balls(bodies.balls(), origin, range_m, found_.data());
  for (const std::uint32_t number : std::span(found_).first(count)) {
    if (number == bodies.hidden) continue;
    if (bodies.common_hull != nullptr) {
      const float* const p = bodies.position + 3 * number;
      hulls_.push_back({.planes = bodies.common_hull,
                        .turned = &turned_[number],
                        .quat_wxyz = bodies.quat_wxyz + 4 * number,
                        .position = {p[0], p[1], p[2]},
                        .radius = bodies.radius[number],
                        .element = bodies.first_element + static_cast<std::int32_t>(number)});
      continue;
    }
    if (bodies.mesh(number) != nullptr) {
      meshes_.push_back(posed_mesh(bodies, number));
      continue;
    }
    shapes_.push_back(shape_of(bodies, number));
    const Shape& shape = shapes_.back();
    Candidate& candidate = candidates_.emplace_back();
    set_candidate(candidate, shape, bodies.first_element + static_cast<std::int32_t>(number), origin);
    if (!is_within(shape, candidate.local_origin, range_m)) {  // only its ball is
      shapes_.pop_back();
      candidates_.pop_back();
      continue;
    }
    candidate.hint = hint_at_solid(shape, candidate.local_origin, near_m);
  }
}

}  // namespace flockstep::trace
