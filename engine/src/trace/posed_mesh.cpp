#include "trace/posed_mesh.hpp"

#include <algorithm>
#include <cmath>

namespace flockstep::trace {

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
    const float beside = ahead * ahead - length2 * least2_;  // of the half chord, times length2; negative: the ray passes by
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
