#include "trace/hulls.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "world/hull_faces.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/hulls.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;

using HullRays = WideUpTo<kRayPadding>;
using HullRays3 = Wide3<HullRays>;

constexpr float kNoHit = std::numeric_limits<float>::infinity();
constexpr float kHullRounding = 1e-5F;  // more than the relative error of a product or quotient

// The planes of a hull as seen from the origin of the rays: n / (offset - n . origin), with n in the world frame. The dot product
// with a direction is the inverse of the distance at which a ray crosses the plane. A ray enters the hull at its last crossing of
// a front plane, with the origin outside, and leaves it at its first crossing of a back plane.
class SeenPlanes {
 public:
  // origin: m, from the hull's position.
  HWY_INLINE void see(const TurnedPlanes& turned, const Vec3& origin) {
    using Faces = WideUpTo<16>;
    using Faces3 = Wide3<Faces>;
    const Faces3 o{origin.x(), origin.y(), origin.z()};
    const std::size_t count = turned.planes->count;
    front_ = 0;
    for (std::size_t i = 0; i < count; i += Faces::kCount) {
      const Faces3 normal = Faces3::load(turned.x.data() + i, turned.y.data() + i, turned.z.data() + i);
      const Faces inside =
          Faces::load(turned.planes->offset.data() + i) - dot(normal, o);  // m, distance of the origin from a plane
      constexpr float kMin = 1e-30F;                                       // its inverse is finite
      const Faces distance = select(abs(inside) < kMin, Faces(kMin), inside);
      (normal * (Faces(1.0F) / distance)).store(x_ + i, y_ + i, z_ + i);
      front_ |= std::uint64_t{bits(distance < 0.0F)} << i;
    }
    back_ = (count == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1) & ~front_;
  }

  HWY_INLINE void intersect(const HullRays3& direction, std::int32_t number, HullRays near, HullRays range, float* t_hit,
                            std::int32_t* element) const {
    const HullRays before = HullRays::load(t_hit);
    HullRays enter = kNoHit, leave = 0.0F;  // inverse distances
    for (std::uint64_t left = front_; left != 0; left &= left - 1) enter = min(enter, along(left, direction));
    if (none(enter * min(before, range) > 1.0F - kHullRounding)) return;
    for (std::uint64_t left = back_; left != 0; left &= left - 1) leave = max(leave, along(left, direction));
    const HullRays enter_m = HullRays(1.0F) / enter, leave_m = HullRays(1.0F) / leave;
    const HullRays hit = select(HullRays::Mask(front_ != 0) & (enter_m >= near), enter_m, leave_m);
    const HullRays::Mask valid = (enter > 0.0F) & (enter >= leave) & (hit >= near) & (hit <= range) & (hit < before);
    select(valid, hit, before).store(t_hit);
    select(valid, HullRays::Int(number), HullRays::Int::load(element)).store(element);
  }

 private:
  // For the plane that the lowest bit stands for.
  HWY_INLINE HullRays along(std::uint64_t left, const HullRays3& direction) const {
    const auto plane = static_cast<std::size_t>(std::countr_zero(left));
    return dot(HullRays3{x_[plane], y_[plane], z_[plane]}, direction);
  }

  std::uint64_t front_, back_;  // one bit for each plane
  alignas(64) float x_[HullPlanes::kMax], y_[HullPlanes::kMax], z_[HullPlanes::kMax];
};

// The directions of a bundle in the world frame, and their squared lengths.
struct WorldDirections {
  alignas(64) RayFloats x, y, z, squared;

  HWY_INLINE void compute(const RayBundle& rays) {
    for (std::size_t i = 0; i < rays.count; i += HullRays::kCount) {
      const HullRays3 direction = rotate(rays.rotation, HullRays3::load_unaligned(rays.x + i, rays.y + i, rays.z + i));
      direction.store(x + i, y + i, z + i);
      dot(direction, direction).store(squared + i);
    }
  }
};

// The planes of a frustum in the world frame, for the balls around hulls.
class FrustumSides {
  using Balls = WideUpTo<16>;

 public:
  static constexpr std::size_t kCount = Balls::kCount;  // hulls tested together

  template <class Planes>
  HWY_INLINE FrustumSides(const Wide3<Planes>& normal, Planes reach) {
    normal.store(x_, y_, z_);
    reach.store(reach_);
  }

  // Returns a bit for each of at most kCount hulls whose ball is not beyond a plane.
  HWY_INLINE std::uint32_t find_inside(std::span<const PosedHull> hulls, const Vec3& origin) const {
    alignas(64) float x[kCount] = {}, y[kCount] = {}, z[kCount] = {}, radius[kCount] = {};
    for (std::size_t i = 0; i < hulls.size(); ++i) {
      x[i] = hulls[i].position.x() - origin.x();
      y[i] = hulls[i].position.y() - origin.y();
      z[i] = hulls[i].position.z() - origin.z();
      radius[i] = hulls[i].radius;
    }
    const Wide3<Balls> center = Wide3<Balls>::load(x, y, z);
    const Balls far = abs(center.x) + abs(center.y) + abs(center.z);
    const Balls ball = Balls::load(radius);
    const Balls enough = ball * 1.0001F + kHullRounding * (ball + far);
    Balls::Mask is_beyond(false);
    for (std::size_t plane = 0; plane < Frustum::kPlanes; ++plane) {
      is_beyond = is_beyond | (dot(Wide3<Balls>{x_[plane], y_[plane], z_[plane]}, center) - enough > Balls(reach_[plane]));
    }
    return ~bits(is_beyond) & ((1U << hulls.size()) - 1U);
  }

 private:
  alignas(64) float x_[Frustum::kPlanes], y_[Frustum::kPlanes], z_[Frustum::kPlanes], reach_[Frustum::kPlanes];
};

void turn_planes(const HullPlanes& planes, const Mat3& to_world, TurnedPlanes& turned) {
  using Faces = WideUpTo<16>;
  for (std::size_t i = 0; i < planes.count; i += Faces::kCount) {
    const auto normal = Wide3<Faces>::load(planes.x.data() + i, planes.y.data() + i, planes.z.data() + i);
    rotate(to_world, normal).store(turned.x.data() + i, turned.y.data() + i, turned.z.data() + i);
  }
}

void meet_hulls(std::span<const PosedHull> hulls, RayBundle& rays) {
  using Planes = WideOf<Frustum::kPlanes>;
  const Frustum& frustum = *rays.frustum;
  const Wide3<Planes> normal = rotate(rays.rotation, Wide3<Planes>::load(frustum.x.data(), frustum.y.data(), frustum.z.data()));
  const Planes reach = rays.range * Planes::load(frustum.reach.data());
  const HullRays near = rays.near, range = rays.range;
  WorldDirections directions;
  SeenPlanes planes;
  bool has_directions = false;
  const auto intersect = [&](const PosedHull& hull) HWY_ATTR {
    const Vec3 center = hull.position - rays.origin;
    const float rounding = kHullRounding * (hull.radius + center.cwiseAbs().sum());  // m
    const float radius = hull.radius * 1.0001F + rounding;
    const auto beyond = [&](const auto& offset) HWY_ATTR { return dot(normal, Wide3<Planes>{offset[0], offset[1], offset[2]}); };
    hull.turned->turn(*hull.planes, hull.quat_wxyz);
    const Mat3& box = hull.turned->half_box;
    const Planes half = abs(beyond(box.col(0))) + abs(beyond(box.col(1))) + abs(beyond(box.col(2)));
    if (!none(beyond(center) - half * 1.0001F - rounding > reach)) return;
    const float squared = center.squaredNorm();
    if (!has_directions) directions.compute(rays);
    has_directions = true;
    const HullRays least = squared - radius * radius;  // <= 0: the origin is in the ball
    const HullRays3 to_center{center.x(), center.y(), center.z()};
    std::size_t close[kMaxRays / HullRays::kCount];  // the first rays of vectors in which some come close to the hull
    std::size_t num_close = 0;
    for (std::size_t i = 0; i < rays.count; i += HullRays::kCount) {
      const HullRays along = dot(to_center, HullRays3::load(directions.x + i, directions.y + i, directions.z + i));
      const HullRays enough = least * HullRays::load(directions.squared + i);
      const HullRays::Mask passes = (along > 0.0F) & (along * along * (1.0F + kHullRounding) >= enough);
      close[num_close] = i;
      num_close += none(passes | (least <= 0.0F)) ? 0 : 1;
    }
    if (num_close == 0) return;
    planes.see(*hull.turned, -center);
    for (std::size_t i = 0; i < num_close; ++i) {
      const std::size_t first = close[i];
      planes.intersect(HullRays3::load(directions.x + first, directions.y + first, directions.z + first), hull.element, near,
                       range, rays.t_hit + first, rays.element + first);
    }
  };
  constexpr std::size_t kCullThreshold = 4;
  if (hulls.size() <= kCullThreshold) {
    for (const PosedHull& hull : hulls) intersect(hull);
    return;
  }
  const FrustumSides sides(normal, reach);
  for (std::size_t first = 0; first < hulls.size(); first += FrustumSides::kCount) {
    const auto some = hulls.subspan(first, std::min(FrustumSides::kCount, hulls.size() - first));
    for (std::uint32_t left = sides.find_inside(some, rays.origin); left != 0; left &= left - 1) {
      intersect(some[static_cast<std::size_t>(std::countr_zero(left))]);
    }
  }
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(turn_planes);
HWY_EXPORT(meet_hulls);

HullPlanes::HullPlanes(std::span<const Vec3> points) {
  const std::vector<HullFace> faces = hull_faces(points, kMax);
  count = faces.size();
  offset.fill(1.0F);
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = static_cast<float>(faces[i].normal.x());
    y[i] = static_cast<float>(faces[i].normal.y());
    z[i] = static_cast<float>(faces[i].normal.z());
    offset[i] = static_cast<float>(faces[i].offset);
  }
  for (const Vec3& point : points) half_extents = half_extents.cwiseMax(point.cwiseAbs());
}

Vec3 HullPlanes::normal_at(const Vec3& point) const {
  std::size_t face = 0;
  float highest = -std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < count; ++i) {
    const float height = x[i] * point.x() + y[i] * point.y() + z[i] * point.z() - offset[i];
    if (height <= highest) continue;
    highest = height;
    face = i;
  }
  return {x[face], y[face], z[face]};
}

void TurnedPlanes::compute(const HullPlanes& to_turn, const float* quat) {
  planes = &to_turn;
  std::copy_n(quat, 4, quat_wxyz.begin());
  const Mat3 to_world = Quat(quat[0], quat[1], quat[2], quat[3]).toRotationMatrix();
  for (int axis = 0; axis < 3; ++axis) half_box.col(axis) = to_turn.half_extents[axis] * to_world.col(axis);
  HWY_DYNAMIC_DISPATCH(turn_planes)(to_turn, to_world, *this);
}

void trace_hulls(std::span<const PosedHull> hulls, RayBundle& rays) { HWY_DYNAMIC_DISPATCH(meet_hulls)(hulls, rays); }

}  // namespace flockstep::trace
#endif
