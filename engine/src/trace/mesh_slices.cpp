#include "trace/mesh_slices.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/mesh_slices.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "base/prefetch.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

class SliceTrace {
  using F = WideOf<16>;
  using I = F::Int;
  using M = F::Mask;
  using F3 = Wide3<F>;
  using Lanes = std::uint32_t;  // one bit for each of sixteen children or triangles

  static constexpr std::size_t kMostListed = 48;  // leaves; for more, it pays to skip those behind hits
  static constexpr std::size_t kMostWaiting = 1024;
  static constexpr std::size_t kFewRays = 6;  // met one by one
  static constexpr float kBeyond = 1.0001F;   // squared; boxes beyond this multiple of the farthest hit are skipped
  static constexpr float kOnPlane = 1e-12F;   // m
  static constexpr float kSlack = 1e-5F;      // of angles in turns of 4
  static constexpr std::int32_t kNobody = std::numeric_limits<std::int32_t>::max();

 public:
  SliceTrace(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays)
      : tree_(tree), first_element_(first_element), fan_(fan), rays_(rays) {}

  void trace(SliceWalk walk) {
    begin();
    if (walk == SliceWalk::ordered || !walk_listed(walk == SliceWalk::listed)) walk_ordered();
    write();
  }

 private:
  void begin() {
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 world = rotated(rays_.rotation, fan_.to_sensor.col(axis));
      for (int k = 0; k < 3; ++k) axis_[axis][k] = world[k];
      origin_[axis] = rays_.origin[axis];
    }
    for (int k = 0; k < 2; ++k) {
      for (int axis = 0; axis < 3; ++axis) edge_[k][axis] = fan_.edge[k][0] * axis_[0][axis] + fan_.edge[k][1] * axis_[1][axis];
    }
    widen_ = tree_.rounding(rays_.origin);
    farthest_ = 0.0F;
    for (std::size_t i = 0; i < fan_.count; ++i) {
      const auto ray = static_cast<std::size_t>(fan_.ray[i]);
      t_[i] = std::min(rays_.t_hit[ray], rays_.range);
      farthest_ = std::max(farthest_, t_[i]);
      id_[i] = kNobody;
    }
    for (std::size_t i = fan_.count; i < fan_.count + kRayPadding; ++i) t_[i] = -1.0F;  // nothing is nearer
  }

  // The boxes of a node, seen from the origin.
  struct Boxes {
    F3 center, half;
    F distance2;
  };

  // Returns which of a node's boxes may be met by the fan.
  HWY_INLINE Lanes look(const MeshNode& node, Boxes& b) const {
    const F half_x = F::load(node.half[0]);
    b.center = F3::load(node.center[0], node.center[1], node.center[2]) - F3{origin_[0], origin_[1], origin_[2]};
    b.half = F3{half_x, F::load(node.half[1]), F::load(node.half[2])} + F3{widen_, widen_, widen_};
    const F x = max(abs(b.center.x) - b.half.x, 0.0F), y = max(abs(b.center.y) - b.half.y, 0.0F),
            z = max(abs(b.center.z) - b.half.z, 0.0F);
    b.distance2 = x * x + y * y + z * z;
    const auto along = [&](const float* axis)
                           HWY_ATTR { return axis[0] * b.center.x + axis[1] * b.center.y + axis[2] * b.center.z; };
    const auto reach = [&](const float* axis) HWY_ATTR {
      return std::abs(axis[0]) * b.half.x + std::abs(axis[1]) * b.half.y + std::abs(axis[2]) * b.half.z;
    };
    M met = (half_x >= 0.0F) & (kBeyond * farthest_ * farthest_ >= b.distance2) & (reach(axis_[2]) >= abs(along(axis_[2])));
    if (fan_.sector != Fan::Sector::full) {
      const M first = along(edge_[0]) + reach(edge_[0]) >= 0.0F, second = along(edge_[1]) + reach(edge_[1]) >= 0.0F;
      met = met & (fan_.sector == Fan::Sector::narrow ? first & second : first | second);
    }
    return bits(met);
  }

  HWY_INLINE void fetch(std::uint32_t child) const {
    if (MeshTree::is_leaf(child)) {
      prefetch(&tree_.leaf(child), sizeof(MeshLeaf));
    } else {
      prefetch(&tree_.node(child), sizeof(MeshNode));
    }
  }

  // Returns false, and has done nothing, if there are too many leaves.
  bool walk_listed(bool any_number) {
    std::array<std::uint32_t, kMostWaiting> waiting;
    std::array<std::uint32_t, kMostListed> leaves;
    std::size_t count = 0, num_leaves = 0;
    waiting[count++] = tree_.root();
    if (MeshTree::is_leaf(tree_.root())) {
      cut(tree_.leaf(tree_.root()));
      return true;
    }
    while (count > 0) {
      const MeshNode& node = tree_.node(waiting[--count]);
      Boxes boxes;
      for (Lanes met = look(node, boxes); met != 0; met &= met - 1) {
        const std::uint32_t child = node.child[std::countr_zero(met)];
        fetch(child);
        if (!MeshTree::is_leaf(child)) {
          waiting[count++] = child;
          continue;
        }
        if (num_leaves == kMostListed) {
          if (!any_number) return false;
          for (const std::uint32_t leaf : leaves) cut(tree_.leaf(leaf));
          num_leaves = 0;
        }
        leaves[num_leaves++] = child;
      }
    }
    for (std::size_t i = 0; i < num_leaves; ++i) cut(tree_.leaf(leaves[i]));
    return true;
  }

  struct Entry {
    std::uint32_t child;
    std::uint16_t begin, end;  // rays that may meet it
    float distance2;
  };

  // Returns the angle of a point, as a fraction of a diamond: -2 to 2, from the negative first axis.
  static HWY_INLINE F angle_of(F x, F y) { return copy_sign(1.0F - x / (abs(x) + abs(y)), y); }
  // Returns the cell of an angle.
  static HWY_INLINE I cell_of(F angle) {
    constexpr float kPerCell = static_cast<float>(Fan::kCells) / 4.0F;
    return convert<I>(min(max((angle + 2.0F) * kPerCell, 0.0F), static_cast<float>(Fan::kCells - 1)));
  }

  bool is_beyond(const Entry& entry) const {
    float farthest = 0.0F;
    for (std::size_t i = entry.begin; i < entry.end; ++i) farthest = std::max(farthest, t_[i]);
    return entry.distance2 > kBeyond * farthest * farthest;
  }

  void walk_ordered() {
    std::array<Entry, kMostWaiting> waiting;
    std::size_t count = 0;
    waiting[count++] = {tree_.root(), 0, static_cast<std::uint16_t>(fan_.count), 0.0F};
    while (count > 0) {
      const Entry entry = waiting[--count];
      if (is_beyond(entry)) continue;
      if (MeshTree::is_leaf(entry.child)) {
        cut(tree_.leaf(entry.child));
        continue;
      }
      const MeshNode& node = tree_.node(entry.child);
      Boxes boxes;
      Lanes met = look(node, boxes);
      if (met == 0) continue;
      alignas(64) float distance2[16];
      alignas(64) std::int32_t begin[16], end[16];
      boxes.distance2.store(distance2);
      const Lanes part = rays_meeting(boxes, begin, end);
      const std::size_t first = count;
      for (; met != 0; met &= met - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(met));
        Entry next{node.child[i], 0, static_cast<std::uint16_t>(fan_.count), distance2[i]};
        if ((part >> i & 1U) != 0) {
          next.begin = fan_.first[begin[i]];
          next.end = fan_.first[end[i] + 1];
        }
        if (next.begin >= next.end || is_beyond(next)) continue;
        fetch(next.child);
        std::size_t at = count++;  // sorted: nearest last
        for (; at > first && waiting[at - 1].distance2 < next.distance2; --at) waiting[at] = waiting[at - 1];
        waiting[at] = next;
      }
    }
  }

  // Writes the first and the last cell of the angles at which boxes are seen. Returns for which boxes this is known; others may
  // be seen at all angles.
  HWY_INLINE Lanes rays_meeting(const Boxes& b, std::int32_t* begin, std::int32_t* end) const {
    const F x = axis_[0][0] * b.center.x + axis_[0][1] * b.center.y + axis_[0][2] * b.center.z;
    const F y = axis_[1][0] * b.center.x + axis_[1][1] * b.center.y + axis_[1][2] * b.center.z;
    const F away = sqrt(x * x + y * y), per_away = 1.0F / max(away, FLT_MIN);
    const F along_x = x * per_away, along_y = y * per_away;
    F ahead = 0.0F, aside = 0.0F;  // half extents along the way to the box's center and across
    const F half[3] = {b.half.x, b.half.y, b.half.z};
    for (std::size_t k = 0; k < 3; ++k) {
      ahead = ahead + abs(axis_[0][k] * along_x + axis_[1][k] * along_y) * half[k];
      aside = aside + abs(axis_[1][k] * along_x - axis_[0][k] * along_y) * half[k];
    }
    const F near = away - ahead;
    const F right = angle_of(along_x * near + along_y * aside, along_y * near - along_x * aside) - kSlack;
    const F left = angle_of(along_x * near - along_y * aside, along_y * near + along_x * aside) + kSlack;
    cell_of(right).store(begin);
    cell_of(left).store(end);
    return bits((near > 0.0F) & (left >= right) & (right >= -2.0F) & (2.0F >= left));
  }

  // Meets the rays with the triangles of a leaf.
  HWY_INLINE void cut(const MeshLeaf& leaf) {
    F3 corner[3];  // in the fan's frame
    M above[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const F x = F::load(leaf.corner[k][0]) - origin_[0], y = F::load(leaf.corner[k][1]) - origin_[1],
              z = F::load(leaf.corner[k][2]) - origin_[2];
      const auto along = [&](std::size_t axis) HWY_ATTR { return axis_[axis][0] * x + axis_[axis][1] * y + axis_[axis][2] * z; };
      const F height = along(2);
      above[k] = height > kOnPlane;
      corner[k] = {along(0), along(1), select(above[k], height, min(height, 0.0F))};
    }
    const M differ_01 = above[0] ^ above[1], differ_02 = above[0] ^ above[2];
    Lanes crossing = bits(differ_01 | differ_02);
    if (crossing == 0) return;
    // One corner is alone on its side.
    const M first = differ_01 & differ_02, third = without(differ_02, differ_01);
    const F3 lone = select(first, corner[0], select(third, corner[2], corner[1]));
    const F3 a = select(first, corner[1], corner[0]), b = select(third, corner[1], corner[2]);
    const auto cut_of = [&](const F3& other, F& x, F& y) HWY_ATTR {
      const F share = 1.0F / (other.z - lone.z);
      x = (lone.x * other.z - other.x * lone.z) * share;
      y = (lone.y * other.z - other.y * lone.z) * share;
    };
    F px, py, qx, qy;
    cut_of(a, px, py);
    cut_of(b, qx, qy);
    const F p_angle = angle_of(px, py), q_angle = angle_of(qx, qy);
    Segments s;
    px.store(s.px);
    py.store(s.py);
    qx.store(s.qx);
    qy.store(s.qy);
    cell_of(min(p_angle, q_angle) - kSlack).store(s.begin);
    cell_of(max(p_angle, q_angle) + kSlack).store(s.end);
    // Beside the negative first axis, the rays on its other side are met, too.
    const M beside_axis = max(abs(p_angle), abs(q_angle)) > 2.0F - 2.0F * kSlack;
    select(beside_axis, 2.0F, abs(p_angle - q_angle)).store(s.span);
    for (; crossing != 0; crossing &= crossing - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(crossing));
      const std::size_t begin = fan_.first[s.begin[i]], end = fan_.first[s.end[i] + 1];
      if (s.span[i] < 2.0F - 2.0F * kSlack) {  // less than a half turn
        if (begin < end) meet(s, i, leaf.triangle[i], begin, end);
      } else if (s.span[i] > 2.0F + 2.0F * kSlack) {  // across the negative first axis
        // The cells are those of the segment's ends moved away from the rays in question by kSlack: the next ones count, too.
        meet(s, i, leaf.triangle[i], 0, fan_.first[s.begin[i] + 2]);
        meet(s, i, leaf.triangle[i], fan_.first[s.end[i] - 1], fan_.count);
      } else {
        meet(s, i, leaf.triangle[i], 0, fan_.count);
      }
    }
  }

  // Sixteen segments from p to q, and the cells of their angles.
  struct Segments {
    alignas(64) float px[16], py[16], qx[16], qy[16], span[16];
    alignas(64) std::int32_t begin[16], end[16];
  };

  HWY_INLINE void meet(const Segments& s, std::size_t i, std::int32_t id, std::size_t begin, std::size_t end) {
    const float px = s.px[i], py = s.py[i], qx = s.qx[i], qy = s.qy[i];
    if (end - begin <= kFewRays) {
      for (std::size_t ray = begin; ray < end; ++ray) {
        const float x = fan_.x[ray], y = fan_.y[ray];
        const float p_side = x * py - y * px, q_side = x * qy - y * qx;
        if ((p_side >= 0.0F) == (q_side >= 0.0F)) continue;
        const float p_along = x * px + y * py, q_along = x * qx + y * qy;
        const float t = p_along + (q_along - p_along) * (p_side / (p_side - q_side));
        if (t < rays_.near || t > t_[ray] || (t == t_[ray] && id >= id_[ray])) continue;
        t_[ray] = t;
        id_[ray] = id;
      }
      return;
    }
    using V = WideUpTo<16>;
    using N = V::Int;
    for (std::size_t ray = begin; ray < end; ray += V::kCount) {
      const V x = V::load_unaligned(fan_.x + ray), y = V::load_unaligned(fan_.y + ray);
      const V p_side = x * py - y * px, q_side = x * qy - y * qx;
      const V p_along = x * px + y * py, q_along = x * qx + y * qy;
      const V t = p_along + (q_along - p_along) * (p_side / (p_side - q_side));
      const V before = V::load_unaligned(t_ + ray);
      const N id_before = N::load_unaligned(id_ + ray);
      const auto hit =
          ((p_side >= 0.0F) ^ (q_side >= 0.0F)) & (t >= rays_.near) & ((before > t) | ((before == t) & (id_before > id)));
      select(hit, t, before).store_unaligned(t_ + ray);
      select(hit, N(id), id_before).store_unaligned(id_ + ray);
    }
  }

  void write() {
    for (std::size_t i = 0; i < fan_.count; ++i) {
      const auto ray = static_cast<std::size_t>(fan_.ray[i]);
      if (id_[i] == kNobody || !(t_[i] < rays_.t_hit[ray])) continue;
      rays_.t_hit[ray] = t_[i];
      rays_.element[ray] = first_element_ + id_[i];
    }
  }

  const MeshTree& tree_;
  const std::int32_t first_element_;
  const Fan& fan_;
  RayBundle& rays_;
  float axis_[3][3];  // of the fan's frame, world frame
  float edge_[2][3];  // of the sector, world frame
  float origin_[3];
  float widen_;                                  // m, margin of boxes
  float farthest_;                               // m, of the hits at the beginning
  alignas(64) float t_[kMaxRays + kRayPadding];  // m, by the fan's order
  alignas(64) std::int32_t id_[kMaxRays + kRayPadding];
};

void trace_mesh_slice(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays, SliceWalk walk) {
  SliceTrace(tree, first_element, fan, rays).trace(walk);
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_mesh_slice);

namespace {

constexpr double kInPlane = 1e-9;  // largest part of a unit direction along the plane's normal

// Returns the normal of a plane that contains the directions, if they lie in one.
Eigen::Vector3d normal_of(std::span<const Eigen::Vector3d> directions) {
  for (const int axis : {2, 1, 0}) {
    const auto lies_across = [axis](const Eigen::Vector3d& direction) { return std::abs(direction[axis]) <= kInPlane; };
    if (std::ranges::all_of(directions, lies_across)) return Eigen::Vector3d::Unit(axis);
  }
  Eigen::Vector3d widest = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& direction : directions) {
    const Eigen::Vector3d across = directions.front().cross(direction);
    if (across.squaredNorm() > widest.squaredNorm()) widest = across;
  }
  return widest.normalized();  // zero if all directions are the same or opposite
}

// Returns the angle of a point, as a fraction of a diamond: -2 to 2, from the negative first axis.
double diamond_angle(double x, double y) { return std::copysign(1.0 - x / (std::abs(x) + std::abs(y)), y); }

}  // namespace

bool are_in_plane(std::span<const Eigen::Vector3d> directions) {
  const Eigen::Vector3d normal = normal_of(directions);
  return !normal.isZero() && std::ranges::all_of(directions, [&normal](const Eigen::Vector3d& direction) {
    return std::abs(normal.dot(direction)) <= kInPlane;
  });
}

Fan make_fan(std::span<const Eigen::Vector3d> directions, const Eigen::Matrix3d& mounting) {
  const Eigen::Vector3d normal = normal_of(directions);
  Eigen::Matrix3d frame;
  const Eigen::Vector3d forward = std::abs(normal.x()) < 0.9 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  frame.col(0) = (forward - forward.dot(normal) * normal).normalized();
  frame.col(1) = normal.cross(frame.col(0));
  frame.col(2) = normal;

  Fan fan;
  fan.to_sensor = (mounting * frame).cast<float>();
  fan.count = directions.size();
  struct Ray {
    double angle, x, y;
    std::int32_t number;
  };
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& direction : directions) {
    const double x = frame.col(0).dot(direction), y = frame.col(1).dot(direction);
    rays.push_back({diamond_angle(x, y), x, y, static_cast<std::int32_t>(rays.size())});
  }
  std::ranges::stable_sort(rays, {}, &Ray::angle);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    fan.x[i] = static_cast<float>(rays[i].x);
    fan.y[i] = static_cast<float>(rays[i].y);
    fan.ray[i] = rays[i].number;
  }
  for (std::size_t cell = 0; cell < std::size(fan.first); ++cell) {
    const double begin = cell > Fan::kCells - 1 ? 3.0 : static_cast<double>(cell) * 4.0 / static_cast<double>(Fan::kCells) - 2.0;
    fan.first[cell] = static_cast<std::uint16_t>(std::ranges::count_if(rays, [&](const Ray& ray) { return ray.angle < begin; }));
  }

  // The sector is what remains beside the widest gap.
  double widest = -1.0;
  std::size_t last = 0;  // before the gap
  const auto turn = [&](std::size_t i) { return std::atan2(rays[i].y, rays[i].x); };
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double gap = i + 1 < rays.size() ? turn(i + 1) - turn(i) : turn(0) + 2.0 * std::numbers::pi - turn(i);
    if (gap > widest) {
      widest = gap;
      last = i;
    }
  }
  constexpr double kMargin = 1e-4;  // rad
  const double begin = turn((last + 1) % rays.size()) - kMargin, end = turn(last) + kMargin;
  const double width = 2.0 * std::numbers::pi - widest + 2.0 * kMargin;
  fan.sector = width < std::numbers::pi - kMargin                  ? Fan::Sector::narrow
               : width > std::numbers::pi + kMargin && width < 6.0 ? Fan::Sector::wide
                                                                   : Fan::Sector::full;
  fan.edge[0][0] = static_cast<float>(-std::sin(begin));
  fan.edge[0][1] = static_cast<float>(std::cos(begin));
  fan.edge[1][0] = static_cast<float>(std::sin(end));
  fan.edge[1][1] = static_cast<float>(-std::cos(end));
  return fan;
}

void trace_mesh_slice(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays, SliceWalk walk) {
  HWY_DYNAMIC_DISPATCH(trace_mesh_slice)(tree, first_element, fan, rays, walk);
}

}  // namespace flockstep::trace
#endif
