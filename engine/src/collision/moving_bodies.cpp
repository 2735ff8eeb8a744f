#include "collision/moving_bodies.hpp"

#include "collision/moving_sweep.hpp"
#include "trace/near_balls.hpp"

namespace flockstep::collision {
namespace {

Pose pose_in(const float* position, const float* quat_wxyz, std::size_t number) {
  const float *const p = position + 3 * number, *const q = quat_wxyz + 4 * number;
  return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
}

MovingSolid solid_between(const MovingBodies& bodies, std::size_t number, const Pose& from, const Pose& to) {
  const auto index = static_cast<int>(number);
  if (const Corners* const hull = bodies.hulls == nullptr ? nullptr : bodies.hulls[number]) return {*hull, from, to, index};
  const Primitive& solid = *bodies.solids[number];
  return {solid.kind, solid.half_extents, from, to, index};
}

}  // namespace

bool overlaps_body(const MovingBodies& bodies, const Obstacles& obstacles, const Hull& hull, const Pose& pose) {
  for (std::size_t number = 0; number < bodies.count; ++number) {
    if (bodies.reach[number] < 0.0F) continue;
    const Pose there = pose_in(bodies.position, bodies.quat_wxyz, number);
    const float reach = bodies.reach[number] + hull.radius();
    if ((there.position - pose.position).squaredNorm() > reach * reach) continue;
    const MovingSolid standing = solid_between(bodies, number, there, there);
    if (first_contact(obstacles, {&standing, 1}, hull, pose, pose).body >= 0) return true;
  }
  return false;
}

std::span<const MovingSolid> NearSolids::gather(const MovingBodies& bodies, const Vec3& origin, float range_m) {
  solids_.clear();
  if (bodies.count == 0) return {};
  if (found_.size() < bodies.count) {
    found_.resize(bodies.count);
    solids_.reserve(bodies.count);
  }
  const trace::Balls balls{bodies.position, bodies.reach, bodies.count, bodies.readable};
  const std::size_t count = trace::find_near_balls(balls, origin, range_m, found_.data());
  for (const std::uint32_t number : std::span(found_).first(count)) {
    solids_.push_back(solid_between(bodies, number, pose_in(bodies.from_position, bodies.from_quat, number),
                                    pose_in(bodies.position, bodies.quat_wxyz, number)));
  }
  return solids_;
}

}  // namespace flockstep::collision
