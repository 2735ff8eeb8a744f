#include "trace/mesh_slices.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/mesh_slices.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "base/near_memory.hpp"
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

  static constexpr std::size_t kMaxListed = 80;     // leaves; for more, it pays to skip those behind hits
  static constexpr std::size_t kCutThreshold = 16;  // leaves; if so few are cut in order, to list them is faster
  static constexpr std::size_t kMaxWaiting = 1024;
  static_assert(kMaxWaiting >= 1 + (kTreeWidth - 1) * MeshTree::kMaxDepth);
  static constexpr std::size_t kRayThreshold = 4;
  static constexpr float kBeyond = 1.0001F;   // squared; boxes beyond this multiple of the farthest hit are skipped
  static constexpr float kOnPlane = 1e-12F;   // m; corners above the plane are higher, which bounds the reciprocals of heights
  static constexpr float kNearest = -1e-30F;  // m, no hit and no box is nearer; its square is 0
  static constexpr float kSlack = 1e-4F;      // rad, error of angles
  static constexpr float kMaxAngle = std::numbers::pi_v<float> - 2.0F * kSlack;
  static constexpr std::int32_t kNoTriangle = std::numeric_limits<std::int32_t>::max();

 public:
  SliceTrace(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays)
      : tree_(tree), first_element_(first_element), fan_(fan), rays_(rays) {}

  bool trace(SliceWalk walk) {
    begin();
    const bool is_listed = walk != SliceWalk::ordered && walk_listed(walk == SliceWalk::listed);
    const std::size_t cuts = is_listed ? 0 : walk_ordered();
    write();
    return cuts > kCutThreshold;
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
    num_cells_ = static_cast<float>(fan_.cells);
    // In an even fan, the ray of a cell precedes all other angles in it, so a search begins one cell later.
    to_begin_ = (fan_.is_even ? 1.0F : 0.0F) - kSlack * fan_.per_rad;
    to_end_ = 1.0F + kSlack * fan_.per_rad;
    farthest_ = 0.0F;
    for (std::size_t i = 0; i < fan_.count; ++i) {
      const auto ray = static_cast<std::size_t>(fan_.ray[i]);
      t_[i] = std::min(rays_.t_hit[ray], rays_.range);
      farthest_ = std::max(farthest_, t_[i]);
      id_[i] = kNoTriangle;
    }
    std::fill_n(t_ + fan_.count, kRayPadding, kNearest);
    std::fill_n(id_ + fan_.count, kRayPadding, kNoTriangle);
  }

  // The boxes of a node, seen from the origin.
  struct Boxes {
    F3 center, half;
    F distance2;
  };

  HWY_INLINE F along(const float* axis, const F3& v) const { return axis[0] * v.x + axis[1] * v.y + axis[2] * v.z; }
  HWY_INLINE F reach(const float* axis, const F3& half) const {
    return std::abs(axis[0]) * half.x + std::abs(axis[1]) * half.y + std::abs(axis[2]) * half.z;
  }

  // Returns which of a node's boxes are in range and intersect the plane.
  HWY_INLINE M boxes_in_reach(const MeshNode& node, Boxes& b) const {
    const F half_x = F::load(node.half[0]);
    b.center = F3::load(node.center[0], node.center[1], node.center[2]) - F3{origin_[0], origin_[1], origin_[2]};
    b.half = F3{half_x, F::load(node.half[1]), F::load(node.half[2])} + F3{widen_, widen_, widen_};
    const F x = max(abs(b.center.x) - b.half.x, 0.0F), y = max(abs(b.center.y) - b.half.y, 0.0F),
            z = max(abs(b.center.z) - b.half.z, 0.0F);
    b.distance2 = x * x + y * y + z * z;
    return (half_x >= 0.0F) & (kBeyond * farthest_ * farthest_ >= b.distance2) &
           (reach(axis_[2], b.half) >= abs(along(axis_[2], b.center)));
  }

  // Returns which of a node's boxes also intersect the sector.
  HWY_INLINE Lanes boxes_in_sector(const MeshNode& node) const {
    Boxes b;
    const M met = boxes_in_reach(node, b);
    if (fan_.sector == Fan::Sector::full) return bits(met);
    const auto is_before = [&](const float* edge) HWY_ATTR { return along(edge, b.center) + reach(edge, b.half) >= 0.0F; };
    const M first = is_before(edge_[0]), second = is_before(edge_[1]);
    return bits(met & (fan_.sector == Fan::Sector::narrow ? first & second : first | second));
  }

  // Returns false, and has done nothing, if there are too many leaves.
  bool walk_listed(bool any_number) {
    std::array<std::uint32_t, kMaxWaiting> waiting;
    std::array<std::uint32_t, kMaxListed> leaves;
    std::size_t count = 0, num_leaves = 0;
    waiting[count++] = tree_.root();
    if (MeshTree::is_leaf(tree_.root())) {
      cut(tree_.leaf(tree_.root()));
      return true;
    }
    while (count > 0) {
      const MeshNode& node = tree_.node(waiting[--count]);
      for (Lanes met = boxes_in_sector(node); met != 0; met &= met - 1) {
        const std::uint32_t child = node.child[std::countr_zero(met)];
        tree_.fetch(child);
        if (!MeshTree::is_leaf(child)) {
          waiting[count++] = child;
          continue;
        }
        if (num_leaves == kMaxListed) {
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
    std::uint16_t begin, end;  // rays that may hit it
    float distance2;
  };

  // Returns the angle of a point (rad) to within kSlack.
  static HWY_INLINE F angle_of(F x, F y) {
    // With the slope of 45 degrees as the middle, tan(angle - pi / 4) = (y - x) / (y + x). The polynomial is the arc tangent,
    // with an error of at most 8.2e-5.
    const F across = abs(x), up = abs(y), u = (up - across) / (up + across), v = u * u;
    const F turn = u * (0.999213812F + v * (-0.321174967F + v * (0.146264458F + v * -0.0389865107F)));
    const F quarter = std::numbers::pi_v<float> / 4.0F;
    return copy_sign(select(x >= 0.0F, quarter + turn, 3.0F * quarter - turn), y);
  }

  // Writes the first cell of rays from one angle on, and the cell after the last one of rays up to another angle. Returns where
  // these rays may exist. The angles may be off by kSlack.
  HWY_INLINE Lanes cells_between(F from, F to, std::int32_t* begin, std::int32_t* end) const {
    const auto cell = [&](F position) HWY_ATTR { return convert<I>(min(max(position, 0.0F), num_cells_)); };
    const I first = cell((from - fan_.begin_rad) * fan_.per_rad + to_begin_),
            last = cell((to - fan_.begin_rad) * fan_.per_rad + to_end_);
    first.store(begin);
    last.store(end);
    return bits(last > first);
  }

  // Returns true if all rays that may hit a box have nearer hits.
  HWY_INLINE bool is_beyond(const Entry& entry) const {
    if (entry.begin == entry.end) return true;
    const std::size_t begin = entry.begin, last = entry.end - std::size_t{1};
    const auto is_nearer = [&entry](float t) { return kBeyond * t * t < entry.distance2; };
    const float farthest = std::max(t_[begin], t_[last]);
    if (last - begin <= 3) {  // one by one, as in intersect()
      return is_nearer(std::max(farthest, std::max(t_[std::min(begin + 1, last)], t_[std::min(begin + 2, last)])));
    }
    if (!is_nearer(farthest)) return false;
    using V = WideUpTo<16>;
    auto met = V(0.0F) > 0.0F;
    for (std::size_t i = begin; i <= last; i += V::kCount) {
      const V t = V::load_unaligned(t_ + i);
      met = met | (t * t * kBeyond >= entry.distance2);
    }
    return none(met);
  }

  // Returns the number of leaves that were cut.
  std::size_t walk_ordered() {
    std::size_t cuts = 0;
    std::array<Entry, kMaxWaiting> waiting;
    std::size_t count = 0;
    waiting[count++] = {tree_.root(), 0, static_cast<std::uint16_t>(fan_.count), 0.0F};
    while (count > 0) {
      const Entry entry = waiting[--count];
      if (is_beyond(entry)) continue;
      if (MeshTree::is_leaf(entry.child)) {
        cut(tree_.leaf(entry.child));
        ++cuts;
        continue;
      }
      const MeshNode& node = tree_.node(entry.child);
      Boxes boxes;
      Lanes met = bits(boxes_in_reach(node, boxes));
      if (met == 0) continue;
      alignas(64) std::int32_t begin[16], end[16];
      const Lanes known = rays_hitting(boxes, met, begin, end);
      if (met == 0) continue;
      // The farthest goes first onto the stack: the place of a child is the number of nearer ones, from the end.
      const F distances2 = numbered_by_lane(max(boxes.distance2, FLT_MIN));
      alignas(64) float distance2[16];
      distances2.store(distance2);
      const std::size_t last = count + static_cast<std::size_t>(std::popcount(met)) - 1;
      count = last + 1;
      for (Lanes left = met; left != 0; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        const bool is_known = (known >> i & 1U) != 0;
        const auto nearer = static_cast<std::size_t>(std::popcount(met & bits(distance2[i] > distances2)));
        tree_.fetch(node.child[i]);
        waiting[last - nearer] = {node.child[i], is_known ? fan_.first[begin[i]] : std::uint16_t{0},
                                  is_known ? fan_.first[end[i]] : static_cast<std::uint16_t>(fan_.count), distance2[i]};
      }
    }
    return cuts;
  }

  // Replaces the last four bits of each number by its lane, so that no two are equal.
  static HWY_INLINE F numbered_by_lane(F a) { return bit_cast<F>((bit_cast<I>(a) & ~15) | I::iota()); }

  // Removes boxes that no ray hits. Writes the cells of the rays that may hit the others, and returns for which they are known.
  HWY_INLINE Lanes rays_hitting(const Boxes& b, Lanes& met, std::int32_t* begin, std::int32_t* end) const {
    // The box in the plane, along the fan's axes; the corners at which it begins and ends.
    const F x = along(axis_[0], b.center), y = along(axis_[1], b.center);
    const F wide = reach(axis_[0], b.half), high = reach(axis_[1], b.half);
    const F x0 = x - wide, x1 = x + wide, y0 = y - high, y1 = y + high;
    const M is_left = y0 > 0.0F, is_right = 0.0F > y1, is_ahead = x0 > 0.0F, is_behind = 0.0F > x1;
    const F right = angle_of(select(is_left, x1, x0), select(is_behind | without(is_right, is_ahead), y1, y0));
    const F left = angle_of(select(is_right, x1, x0), select(is_behind | without(is_left, is_ahead), y0, y1));
    const Lanes known = bits((is_left | is_right | is_ahead) & (right >= -kMaxAngle) & (kMaxAngle >= left));
    met &= cells_between(right, left, begin, end) | ~known;
    return known;
  }

  // Meets the rays with the triangles of a leaf.
  HWY_INLINE void cut(const MeshLeaf& leaf) {
    const auto corner = [&](std::size_t k) HWY_ATTR {
      return F3{F::load(leaf.corner[k][0]) - origin_[0], F::load(leaf.corner[k][1]) - origin_[1],
                F::load(leaf.corner[k][2]) - origin_[2]};
    };
    const F height[3] = {along(axis_[2], corner(0)), along(axis_[2], corner(1)), along(axis_[2], corner(2))};
    const M above[3] = {height[0] > kOnPlane, height[1] > kOnPlane, height[2] > kOnPlane};
    const M differ_01 = above[0] ^ above[1], differ_02 = above[0] ^ above[2];
    Lanes crossing = bits(differ_01 | differ_02);
    if (crossing == 0) return;
    F3 at[3];  // in the fan's frame
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] = {along(axis_[0], corner(k)), along(axis_[1], corner(k)), select(above[k], height[k], min(height[k], 0.0F))};
    }
    // One corner is alone on its side.
    const M first = differ_01 & differ_02, third = without(differ_02, differ_01);
    const F3 lone = select(first, at[0], select(third, at[2], at[1]));
    const F3 a = select(first, at[1], at[0]), b = select(third, at[1], at[2]);
    const auto cut_of = [&](const F3& other, F& x, F& y) HWY_ATTR {
      const F share = 1.0F / (other.z - lone.z);
      x = (lone.x * other.z - other.x * lone.z) * share;
      y = (lone.y * other.z - other.y * lone.z) * share;
    };
    F ax, ay, bx, by;
    cut_of(a, ax, ay);
    cut_of(b, bx, by);
    const M is_b_nearer = abs(ax) + abs(ay) > abs(bx) + abs(by);
    const F px = select(is_b_nearer, bx, ax), py = select(is_b_nearer, by, ay);
    const F qx = select(is_b_nearer, ax, bx), qy = select(is_b_nearer, ay, by);
    const F p_angle = angle_of(px, py), q_angle = angle_of(qx, qy);
    Segments s;
    px.store(s.px);
    py.store(s.py);
    qx.store(s.qx);
    qy.store(s.qy);
    const Lanes seen = cells_between(min(p_angle, q_angle), max(p_angle, q_angle), s.begin, s.end);
    // Segments that cross the negative first axis, or touch the origin.
    const Lanes around = crossing & ~bits((kMaxAngle > abs(p_angle - q_angle)) & (kMaxAngle > max(abs(p_angle), abs(q_angle))));
    for (crossing &= seen | around; crossing != 0; crossing &= crossing - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(crossing));
      if ((around >> i & 1U) != 0) {
        intersect(s, i, leaf.triangle[i], 0, fan_.count);
      } else {
        intersect(s, i, leaf.triangle[i], fan_.first[s.begin[i]], fan_.first[s.end[i]]);
      }
    }
  }

  // Sixteen segments from p to q, and the cells of their angles. p is nearer to the origin: distances are computed from there, so
  // that their error is small compared with the distance, and a hit ahead never seems to be behind.
  struct Segments {
    alignas(64) float px[16], py[16], qx[16], qy[16];
    alignas(64) std::int32_t begin[16], end[16];
  };

  // Few rays are tested one by one: vectors would have to wait for hits that have just been stored.
  HWY_INLINE void intersect(const Segments& s, std::size_t i, std::int32_t id, std::size_t begin, std::size_t end) {
    if (end - begin <= kRayThreshold) {
      meet_by<WideUpTo<1>>(s, i, id, begin, end);
    } else {
      meet_by<WideUpTo<16>>(s, i, id, begin, end);
    }
  }

  template <class V>
  HWY_INLINE void meet_by(const Segments& s, std::size_t i, std::int32_t id, std::size_t begin, std::size_t end) {
    using N = typename V::Int;
    const float px = s.px[i], py = s.py[i], qx = s.qx[i], qy = s.qy[i];
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
      if (id_[i] == kNoTriangle || !(t_[i] < rays_.t_hit[ray])) continue;
      rays_.t_hit[ray] = t_[i];
      rays_.element[ray] = first_element_ + id_[i];
    }
  }

  const MeshTree& tree_;
  const std::int32_t first_element_;
  const Fan& fan_;
  RayBundle& rays_;
  float axis_[3][3];  // axes of the fan's frame, world frame
  float edge_[2][3];  // edges of the sector, world frame
  float origin_[3];
  float num_cells_, to_begin_, to_end_;          // see cells_between()
  float widen_;                                  // m, margin of boxes
  float farthest_;                               // m, of the hits at the beginning
  alignas(64) float t_[kMaxRays + kRayPadding];  // m, by the fan's order
  alignas(64) std::int32_t id_[kMaxRays + kRayPadding];
};

bool trace_mesh_slice(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays, SliceWalk walk) {
  return SliceTrace(tree, first_element, fan, rays).trace(walk);
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_mesh_slice);

namespace {

constexpr double kInPlane = 1e-6;  // largest part of a unit direction along the plane's normal; that of rounded angles is less

// Returns the normal of the plane that is nearest to the directions.
Eigen::Vector3d normal_of(std::span<const Eigen::Vector3d> directions) {
  for (const int axis : {2, 1, 0}) {
    const auto lies_across = [axis](const Eigen::Vector3d& direction) { return std::abs(direction[axis]) <= kInPlane; };
    if (std::ranges::all_of(directions, lies_across)) return Eigen::Vector3d::Unit(axis);
  }
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& direction : directions) squares += direction * direction.transpose();
  Eigen::Vector3d normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(squares).eigenvectors().col(0);  // least eigenvalue
  Eigen::Index largest = 0;
  normal.cwiseAbs().maxCoeff(&largest);
  return normal[largest] < 0.0 ? Eigen::Vector3d(-normal) : normal;
}

}  // namespace

bool are_in_plane(std::span<const Eigen::Vector3d> directions) {
  const Eigen::Vector3d normal = normal_of(directions);
  return std::ranges::all_of(directions,
                             [&normal](const Eigen::Vector3d& direction) { return std::abs(normal.dot(direction)) <= kInPlane; });
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
    rays.push_back({std::atan2(y, x), x, y, static_cast<std::int32_t>(rays.size())});
  }
  std::ranges::stable_sort(rays, {}, &Ray::angle);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    fan.x[i] = static_cast<float>(rays[i].x);
    fan.y[i] = static_cast<float>(rays[i].y);
    fan.ray[i] = rays[i].number;
  }
  const double begin = rays.front().angle, step = (rays.back().angle - begin) / static_cast<double>(rays.size() - 1);
  fan.is_even = step > 1e-3 && std::ranges::all_of(rays, [&](const Ray& ray) {
                  return std::abs(begin + step * static_cast<double>(&ray - rays.data()) - ray.angle) < 1e-6;
                });
  fan.cells = fan.is_even ? rays.size() : Fan::kMaxCells;
  const double first = fan.is_even ? begin : -std::numbers::pi;
  const double cell = fan.is_even ? step : 2.0 * std::numbers::pi / static_cast<double>(fan.cells);
  fan.begin_rad = static_cast<float>(first);
  fan.per_rad = static_cast<float>(1.0 / cell);
  for (std::size_t i = 0; i <= fan.cells; ++i) {
    const double at = fan.is_even ? 0.5 : 0.0;  // even fans' rays lie at the beginnings of the cells, up to rounding
    const double end = i == fan.cells ? std::numeric_limits<double>::infinity() : first + cell * (static_cast<double>(i) - at);
    fan.first[i] = static_cast<std::uint16_t>(std::ranges::lower_bound(rays, end, {}, &Ray::angle) - rays.begin());
  }

  // The sector is what remains beside the widest gap.
  double widest = -1.0;
  std::size_t last = 0;  // before the gap
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double next = i + 1 < rays.size() ? rays[i + 1].angle : rays.front().angle + 2.0 * std::numbers::pi;
    const double gap = next - rays[i].angle;
    if (gap > widest) {
      widest = gap;
      last = i;
    }
  }
  if (rays.size() > 1) {
    fan.between_rad = static_cast<float>((2.0 * std::numbers::pi - widest) / static_cast<double>(rays.size() - 1));
  }
  constexpr double kMargin = 1e-4;  // rad
  const double right = rays[(last + 1) % rays.size()].angle - kMargin, left = rays[last].angle + kMargin;
  const double width = 2.0 * std::numbers::pi - widest + 2.0 * kMargin;
  fan.sector = width < std::numbers::pi - kMargin                  ? Fan::Sector::narrow
               : width > std::numbers::pi + kMargin && width < 6.0 ? Fan::Sector::wide
                                                                   : Fan::Sector::full;
  fan.edge[0][0] = static_cast<float>(-std::sin(right));
  fan.edge[0][1] = static_cast<float>(std::cos(right));
  fan.edge[1][0] = static_cast<float>(std::sin(left));
  fan.edge[1][1] = static_cast<float>(-std::cos(left));
  return fan;
}

bool trace_mesh_slice(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays, SliceWalk walk) {
  return HWY_DYNAMIC_DISPATCH(trace_mesh_slice)(tree, first_element, fan, rays, walk);
}

}  // namespace flockstep::trace
#endif
