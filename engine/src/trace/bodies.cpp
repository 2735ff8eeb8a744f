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

namespace {

// A ball around the origin of the mesh's frame that contains it, wider than the rounding errors of the test.
class MeshBall {
 public:
  MeshBall(float radius, const Vec3& origin) : origin_(origin), distance2_(origin.squaredNorm()) {
    const float wider = radius * 1.0001F + 1e-5F * (radius + std::sqrt(distance2_));
    least2_ = distance2_ - wider * wider;
  }

  // Returns true if the ray may be in the ball before it ends at `end` (in lengths of the direction).
  bool may_hold(const Vec3& direction, float end) const {
    if (least2_ <= 0.0F) return true;  // the origin is inside
    const float length2 = direction.squaredNorm();
    const float ahead = -origin_.dot(direction);
    if (!(ahead > 0.0F)) return false;
    const float beside = ahead * ahead - length2 * least2_;  // half chord squared, times length2; negative: the ray passes by
    if (beside < -1e-5F * ahead * ahead) return false;
    return (ahead - std::sqrt(std::max(beside, 0.0F))) * 0.9999F <= end * length2;
  }

 private:
  Vec3 origin_;
  float distance2_, least2_;
};

void add(const Vec3& origin, const Vec3& direction, float range, float t_hit, std::size_t number, MeshRays& to) {
  RayBlock& rays = to.rays;
  const std::size_t i = rays.count++;
  rays.org_x[i] = origin.x();
  rays.org_y[i] = origin.y();
  rays.org_z[i] = origin.z();
  rays.dir_x[i] = direction.x();
  rays.dir_y[i] = direction.y();
  rays.dir_z[i] = direction.z();
  rays.range[i] = range;
  rays.t_hit[i] = t_hit;
  rays.element[i] = -1;
  to.of[i] = number;
}

}  // namespace

void select_rays(const PosedMesh& mesh, const RayBundle& bundle, MeshRays& selected) {
  selected.rays.count = 0;
  selected.rays.near = bundle.near;
  const Vec3 origin = mesh.local_point(bundle.origin);
  const Mat3 rotation = mesh.local_rotation(bundle.rotation);
  const MeshBall ball(mesh.radius, origin);
  for (std::size_t i = 0; i < bundle.count; ++i) {
    const Vec3 direction = rotated(rotation, {bundle.x[i], bundle.y[i], bundle.z[i]});
    if (!ball.may_hold(direction, std::min(bundle.t_hit[i], bundle.range))) continue;
    add(origin, direction, bundle.range, bundle.t_hit[i], i, selected);
  }
}

void select_rays(const PosedMesh& mesh, const RayBlock& block, MeshRays& selected) {
  selected.rays.count = 0;
  selected.rays.near = block.near;
  for (std::size_t i = 0; i < block.count; ++i) {
    const Vec3 origin = mesh.local_point({block.org_x[i], block.org_y[i], block.org_z[i]});
    const Vec3 direction = rotated(mesh.to_local, {block.dir_x[i], block.dir_y[i], block.dir_z[i]});
    if (!MeshBall(mesh.radius, origin).may_hold(direction, std::min(block.t_hit[i], block.range[i]))) continue;
    add(origin, direction, block.range[i], block.t_hit[i], i, selected);
  }
}

bool is_beside(const PosedMesh& mesh, const RayBundle& bundle) {
  const Frustum& frustum = *bundle.frustum;
  const Vec3 offset = mesh.position - bundle.origin;
  const Vec3 center = bundle.rotation.transpose() * offset;
  const float margin = mesh.radius * 1.0001F + 1e-5F * (mesh.radius + offset.norm());
  for (std::size_t i = 0; i < Frustum::kPlanes; ++i) {
    const float outside = frustum.x[i] * center.x() + frustum.y[i] * center.y() + frustum.z[i] * center.z();
    if (outside - margin > bundle.range * frustum.reach[i]) return true;
  }
  return false;
}

}  // namespace flockstep::trace
