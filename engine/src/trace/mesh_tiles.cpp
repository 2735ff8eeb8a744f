#include "trace/mesh_tiles.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/mesh_tiles.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/prefetch.hpp"

#ifndef FLOCKSTEP_TRACE_MESH_TILES_COMMON
#define FLOCKSTEP_TRACE_MESH_TILES_COMMON
namespace flockstep::trace {

using Bits = std::uint32_t;  // one for each of sixteen rays, sub-tiles or triangles

struct Corner {
  double x, y, z;
};

// The sign of a * d - b * c, exact: products are rounded so that a greater one never becomes the lesser.
inline int sign_of_difference(double a, double d, double b, double c) {
  const double p = a * d, q = b * c;
  if (p != q) return p > q ? 1 : -1;
  const double rest = std::fma(a, d, -p) - std::fma(b, c, -q);
  return rest > 0.0 ? 1 : rest < 0.0 ? -1 : 0;
}

// Whether the ray (1, u, v) or its opposite goes through the triangle, its edges and corners included. Along the ray every corner
// becomes a point of a plane, rounded, but to the same point in each triangle that has it; the rest is exact.
inline bool hits_exactly(float u, float v, const std::array<Corner, 3>& corners) {
  std::array<double, 3> x, y;
  for (std::size_t k = 0; k < 3; ++k) {
    x[k] = corners[k].y - static_cast<double>(u) * corners[k].x;
    y[k] = corners[k].z - static_cast<double>(v) * corners[k].x;
  }
  int least = 1, most = -1;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const int sign = sign_of_difference(x[k], y[next], y[k], x[next]);
    least = std::min(least, sign);
    most = std::max(most, sign);
  }
  return (least >= 0 || most <= 0) && least != -most;  // all 0: the triangle has no area
}

}  // namespace flockstep::trace
#endif

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Sixteen floats, in as many vectors as they take.
using D = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<D>;
constexpr std::size_t kLanes = hn::MaxLanes(D());
constexpr std::size_t kParts = 16 / kLanes;

struct F {
  hn::Vec<D> part[kParts];
};
struct M {  // which of the sixteen
  hn::Mask<D> part[kParts];
};

#define FLOCKSTEP_EACH(Result, expression)                              \
  Result result;                                                        \
  for (std::size_t p = 0; p < kParts; ++p) result.part[p] = expression; \
  return result
HWY_INLINE F load(const float* from) { FLOCKSTEP_EACH(F, hn::Load(D(), from + p * kLanes)); }
HWY_INLINE F all(float value) { FLOCKSTEP_EACH(F, hn::Set(D(), value)); }
HWY_INLINE F operator+(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Add(a.part[p], b.part[p])); }
HWY_INLINE F operator-(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Sub(a.part[p], b.part[p])); }
HWY_INLINE F operator*(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Mul(a.part[p], b.part[p])); }
HWY_INLINE F operator/(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Div(a.part[p], b.part[p])); }
HWY_INLINE F least(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Min(a.part[p], b.part[p])); }
HWY_INLINE F most(const F& a, const F& b) { FLOCKSTEP_EACH(F, hn::Max(a.part[p], b.part[p])); }
HWY_INLINE F magnitude(const F& a) { FLOCKSTEP_EACH(F, hn::Abs(a.part[p])); }
HWY_INLINE F select(const M& mask, const F& yes, const F& no) {
  FLOCKSTEP_EACH(F, hn::IfThenElse(mask.part[p], yes.part[p], no.part[p]));
}
HWY_INLINE M operator>=(const F& a, const F& b) { FLOCKSTEP_EACH(M, hn::Ge(a.part[p], b.part[p])); }
HWY_INLINE M operator>(const F& a, const F& b) { FLOCKSTEP_EACH(M, hn::Gt(a.part[p], b.part[p])); }
HWY_INLINE M operator==(const F& a, const F& b) { FLOCKSTEP_EACH(M, hn::Eq(a.part[p], b.part[p])); }
HWY_INLINE M operator&(const M& a, const M& b) { FLOCKSTEP_EACH(M, hn::And(a.part[p], b.part[p])); }
HWY_INLINE M operator|(const M& a, const M& b) { FLOCKSTEP_EACH(M, hn::Or(a.part[p], b.part[p])); }
#undef FLOCKSTEP_EACH

HWY_INLINE void store(const F& a, float* to) {
  for (std::size_t p = 0; p < kParts; ++p) hn::Store(a.part[p], D(), to + p * kLanes);
}
HWY_INLINE void store_where(const M& mask, const F& a, float* to) {
  for (std::size_t p = 0; p < kParts; ++p) hn::BlendedStore(a.part[p], mask.part[p], D(), to + p * kLanes);
}
HWY_INLINE void store_where(const M& mask, std::int32_t value, std::int32_t* to) {
  for (std::size_t p = 0; p < kParts; ++p) {
    hn::BlendedStore(hn::Set(DI(), value), hn::RebindMask(DI(), mask.part[p]), DI(), to + p * kLanes);
  }
}
HWY_INLINE M is_above(const std::int32_t* values, std::int32_t value) {
  M result;
  for (std::size_t p = 0; p < kParts; ++p) {
    result.part[p] = hn::RebindMask(D(), hn::Gt(hn::Load(DI(), values + p * kLanes), hn::Set(DI(), value)));
  }
  return result;
}
HWY_INLINE Bits bits(const M& mask) {
  Bits result = 0;
  for (std::size_t p = 0; p < kParts; ++p) {
    std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(D(), mask.part[p], bytes);
    result |= (static_cast<Bits>(bytes[0]) | static_cast<Bits>(bytes[1]) << 8U) << (p * kLanes);
  }
  return result;
}
HWY_INLINE bool none(const M& mask) {
  for (std::size_t p = 0; p < kParts; ++p) {
    if (!hn::AllFalse(D(), mask.part[p])) return false;
  }
  return true;
}
HWY_INLINE float least_of(const F& a) {
  hn::Vec<D> result = a.part[0];
  for (std::size_t p = 1; p < kParts; ++p) result = hn::Min(result, a.part[p]);
  return hn::GetLane(hn::MinOfLanes(D(), result));
}
HWY_INLINE float most_of(const F& a) {
  hn::Vec<D> result = a.part[0];
  for (std::size_t p = 1; p < kParts; ++p) result = hn::Max(result, a.part[p]);
  return hn::GetLane(hn::MaxOfLanes(D(), result));
}

struct F3 {
  F x, y, z;
};
HWY_INLINE F3 operator+(const F3& a, const F3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
HWY_INLINE F3 operator-(const F3& a, const F3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
HWY_INLINE F3 cross(const F3& a, const F3& b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
HWY_INLINE F largest(const F3& a) { return most(most(magnitude(a.x), magnitude(a.y)), magnitude(a.z)); }

constexpr float kRounding = 0x1p-20F;  // some roundings of a sum of products, relative to the magnitude of its terms
constexpr float kWiden = 0x1p-18F;     // of coordinates: more than a turned corner or box is off
constexpr float kBeyond = 1.0001F;     // what begins farther than this times the farthest hit is left out
constexpr float kTiny = 1e-12F;        // m
constexpr float kWide = 1e30F;
constexpr std::int32_t kNobody = std::numeric_limits<std::int32_t>::max();
constexpr std::size_t kRays = 256;
constexpr int kFewSubs = 2;          // sub-tiles whose rays are looked at one by one
constexpr std::size_t kFewRays = 2;  // rays that go on alone

// Where sixteen things are in the tile's picture, at least: least and most u, least and most v, and the least depth.
struct Rectangles {
  F u0, u1, v0, v1, near;
};
struct StoredRectangles {
  alignas(64) float u0[16], u1[16], v0[16], v1[16], near[16];

  HWY_INLINE explicit StoredRectangles(const Rectangles& r) {
    store(r.u0, u0);
    store(r.u1, u1);
    store(r.v0, v0);
    store(r.v1, v1);
    store(r.near, near);
  }
};

// Sixteen triangles of a leaf in the tile's frame. value(u, v) = of_1 + of_u u + of_v v.
struct Linear {
  alignas(64) float of_1[16], of_u[16], of_v[16];

  HWY_INLINE void set(const F& a, const F& b, const F& c) {
    store(a, of_1);
    store(b, of_u);
    store(c, of_v);
  }
  // Of one triangle for sixteen rays; of sixteen triangles for one ray.
  HWY_INLINE F of_one(std::size_t triangle, const F& u, const F& v) const {
    return (all(of_1[triangle]) + all(of_u[triangle]) * u) + all(of_v[triangle]) * v;
  }
  HWY_INLINE F of_all(float u, float v) const { return (load(of_1) + load(of_u) * all(u)) + load(of_v) * all(v); }
};
struct Facets {
  Linear edge[3];                  // what is at least 0 inside, raised by `slack`
  alignas(64) float slack[3][16];  // more than rounding may change it by within the tile
  Linear depth;                    // 1 / the depth, not yet between:
  alignas(64) float least[16], most[16];
  alignas(64) float corner[3][3][16];
  alignas(64) float normal[3][16];
  Bits slivers;  // seen so nearly edge-on that rounding may decide which side is seen
};

class TileTrace {
 public:
  TileTrace(const MeshTree& tree, std::int32_t first_element, RayBundle& rays, HitDetails& details)
      : tree_(tree), first_element_(first_element), rays_(rays), details_(details) {}

  void trace() {
    begin();
    if (used_ == 0) return;
    if (MeshTree::is_leaf(tree_.root())) {
      visit(tree_.leaf(tree_.root()), used_, nullptr, 0);
    } else {
      visit(tree_.node(tree_.root()));
    }
    write();
  }

 private:
  // Sub-tile k is that of row k / 4 and column k % 4; its rays lie together, row by row.
  static std::size_t place(std::size_t row, std::size_t column) {
    return 64 * (row / 4) + 16 * (column / 4) + 4 * (row % 4) + column % 4;
  }

  void begin() {
    for (std::size_t i = 0; i < 3; ++i) {
      origin_[i] = rays_.origin[static_cast<Eigen::Index>(i)];
      for (std::size_t j = 0; j < 3; ++j) {
        to_tile_[i][j] = rays_.rotation(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i));
      }
    }
    const float largest = std::max({std::abs(origin_[0]), std::abs(origin_[1]), std::abs(origin_[2])});
    widen_ = kWiden * (tree_.extent() + largest);
    most_w_ = rays_.near > 0.0F ? 1.0F / rays_.near : FLT_MAX;
    const float least_w = std::max(1.0F / rays_.range, FLT_MIN);

    const std::size_t rows = (rays_.count / 16 + 3) / 4 * 4;
    used_ = (1U << rows) - 1U;
    std::fill(rays_.t_hit + rays_.count, rays_.t_hit + 16 * rows, -1.0F);  // of rows that fill up the last sub-tiles
    std::fill_n(id_, kRays, kNobody);
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < 16; column += 4) {
        const std::size_t from = 16 * row + column, to = place(row, column);
        std::memcpy(u_ + to, rays_.y + from, 4 * sizeof(float));
        std::memcpy(v_ + to, rays_.z + from, 4 * sizeof(float));
        std::memcpy(w_ + to, rays_.t_hit + from, 4 * sizeof(float));
      }
    }
    std::fill_n(w_of_, 16, FLT_MAX);
    std::fill_n(u0_, 16, kWide);
    std::fill_n(v0_, 16, kWide);
    std::fill_n(u1_, 16, -kWide);
    std::fill_n(v1_, 16, -kWide);
    for (std::size_t sub = 0; sub < rows; ++sub) {
      const F u = load(u_ + 16 * sub), v = load(v_ + 16 * sub), t = load(w_ + 16 * sub);
      const F w = select(t >= all(0.0F), most(all(1.0F) / t, all(least_w)), all(FLT_MAX));
      store(w, w_ + 16 * sub);
      w_of_[sub] = least_of(w);
      u0_[sub] = least_of(u);
      u1_[sub] = most_of(u);
      v0_[sub] = least_of(v);
      v1_[sub] = most_of(v);
    }
    whole_u_[0] = least_of(load(u0_));
    whole_u_[1] = most_of(load(u1_));
    whole_v_[0] = least_of(load(v0_));
    whole_v_[1] = most_of(load(v1_));
    largest_u_ = std::max(std::abs(whole_u_[0]), std::abs(whole_u_[1]));
    largest_v_ = std::max(std::abs(whole_v_[0]), std::abs(whole_v_[1]));
    margin_ = kRounding * (1.0F + std::max(largest_u_, largest_v_));
    w_of_all_ = least_of(load(w_of_));
  }

  HWY_INLINE F3 turned(const F3& v) const {
    const auto along = [&](std::size_t i) HWY_ATTR {
      return (all(to_tile_[i][0]) * v.x + all(to_tile_[i][1]) * v.y) + all(to_tile_[i][2]) * v.z;
    };
    return {along(0), along(1), along(2)};
  }

  // Which of sixteen are in view, as far as this tells.
  HWY_INLINE Bits in_view(const Rectangles& r) const {
    return bits((r.u1 >= all(whole_u_[0])) & (all(whole_u_[1]) >= r.u0) & (r.v1 >= all(whole_v_[0])) &
                (all(whole_v_[1]) >= r.v0) & (all(kBeyond) >= r.near * all(w_of_all_)));
  }
  // Which sub-tiles one of sixteen may be hit in.
  HWY_INLINE Bits subs_in(const StoredRectangles& r, std::size_t i) const {
    return bits((load(u1_) >= all(r.u0[i])) & (all(r.u1[i]) >= load(u0_)) & (load(v1_) >= all(r.v0[i])) &
                (all(r.v1[i]) >= load(v0_)) & (all(kBeyond) >= all(r.near[i]) * load(w_of_)));
  }

  HWY_INLINE Bits look(const MeshNode& node, Rectangles& r) const {
    const F widen = all(widen_);
    const F3 center = turned(
        {load(node.center[0]) - all(origin_[0]), load(node.center[1]) - all(origin_[1]), load(node.center[2]) - all(origin_[2])});
    const F half[3] = {load(node.half[0]), load(node.half[1]), load(node.half[2])};
    const auto reach = [&](std::size_t i) HWY_ATTR {
      return ((all(std::abs(to_tile_[i][0])) * half[0] + all(std::abs(to_tile_[i][1])) * half[1]) +
              all(std::abs(to_tile_[i][2])) * half[2]) +
             widen;
    };
    const F x = reach(0), y = reach(1), z = reach(2);
    r.near = center.x - x;
    const F far = center.x + x;
    const F a = all(1.0F) / most(r.near, all(kTiny)), b = all(1.0F) / most(far, all(kTiny));
    const F left = center.y - y, right = center.y + y, below = center.z - z, above = center.z + z, margin = all(margin_);
    r.u0 = least(left * a, left * b) - margin;
    r.u1 = most(right * a, right * b) + margin;
    r.v0 = least(below * a, below * b) - margin;
    r.v1 = most(above * a, above * b) + margin;
    return in_view(r) & bits((far > all(0.0F)) & (half[0] >= all(0.0F)));
  }

  void visit(const MeshNode& node) {
    Rectangles rectangles;
    Bits children = look(node, rectangles);
    if (children == 0) return;
    const StoredRectangles stored(rectangles);
    // Near ones first. Their depths are keys that sort as integers do.
    std::array<std::uint64_t, 16> order;
    std::size_t count = 0;
    for (; children != 0; children &= children - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(children));
      const std::uint64_t key = std::uint64_t{std::bit_cast<std::uint32_t>(std::max(stored.near[lane], 0.0F))} << 32U | lane;
      std::size_t at = count++;
      for (; at > 0 && order[at - 1] > key; --at) order[at] = order[at - 1];
      order[at] = key;
    }
    fetch(node.child[order[0] & 15U]);
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t lane = order[i] & 15U;
      if (stored.near[lane] * w_of_all_ > kBeyond) return;
      if (i + 1 < count) fetch(node.child[order[i + 1] & 15U]);
      const Bits subs = subs_in(stored, lane);
      if (subs == 0) continue;
      const std::uint32_t child = node.child[lane];
      std::size_t count_in = kRays;
      if (std::popcount(subs) <= kFewSubs) {
        count_in = 0;
        for (Bits left = subs; left != 0; left &= left - 1) {
          const auto sub = static_cast<std::size_t>(std::countr_zero(left));
          count_in += static_cast<std::size_t>(std::popcount(rays_in(stored, lane, sub)));
        }
        if (count_in == 0) continue;
      }
      if (MeshTree::is_leaf(child)) {
        visit(tree_.leaf(child), subs, &stored, lane);
      } else if (count_in <= kFewRays) {
        for (Bits left = subs; left != 0; left &= left - 1) {
          const auto sub = static_cast<std::size_t>(std::countr_zero(left));
          for (Bits rays = rays_in(stored, lane, sub); rays != 0; rays &= rays - 1) {
            descend(16 * sub + static_cast<std::size_t>(std::countr_zero(rays)), tree_.node(child));
          }
        }
        refresh(subs);
      } else {
        visit(tree_.node(child));
      }
    }
  }

  // Large trees are not in the nearest caches.
  HWY_INLINE void fetch(std::uint32_t child) const {
    if (MeshTree::is_leaf(child)) {
      prefetch(&tree_.leaf(child), sizeof(MeshLeaf));
    } else {
      prefetch(&tree_.node(child), sizeof(MeshNode));
    }
  }

  // Which of a sub-tile's rays may hit one of sixteen.
  HWY_INLINE Bits rays_in(const StoredRectangles& r, std::size_t i, std::size_t sub) const {
    const F u = load(u_ + 16 * sub), v = load(v_ + 16 * sub);
    return bits((u >= all(r.u0[i])) & (all(r.u1[i]) >= u) & (v >= all(r.v0[i])) & (all(r.v1[i]) >= v) &
                (all(kBeyond) >= all(r.near[i]) * load(w_ + 16 * sub)));
  }

  // How far the farthest hits are, after those of some sub-tiles have come nearer.
  HWY_INLINE void refresh(Bits changed) {
    for (; changed != 0; changed &= changed - 1) {
      const auto sub = static_cast<std::size_t>(std::countr_zero(changed));
      w_of_[sub] = least_of(load(w_ + 16 * sub));
    }
    w_of_all_ = least_of(load(w_of_));
  }

  // One ray goes on alone.
  void descend(std::size_t ray, const MeshNode& node) {
    F enter = all(0.0F), leave = all(kBeyond / w_[ray]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float along = (to_tile_[0][axis] + to_tile_[1][axis] * u_[ray]) + to_tile_[2][axis] * v_[ray];
      const float inverse = 1.0F / (std::abs(along) < kTiny ? std::copysign(kTiny, along) : along);
      const F middle = (load(node.center[axis]) - all(origin_[axis])) * all(inverse);
      const F reach = (load(node.half[axis]) + all(2.0F * widen_)) * all(std::abs(inverse));
      enter = most(enter, middle - reach);
      leave = least(leave, middle + reach);
    }
    alignas(64) float near[16];
    store(enter, near);
    Bits children = bits((leave >= enter) & (load(node.half[0]) >= all(0.0F)));
    while (children != 0) {  // the nearest first; there are few
      std::size_t lane = 16;
      for (Bits left = children; left != 0; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        if (lane == 16 || near[i] < near[lane]) lane = i;
      }
      children &= ~(Bits{1} << lane);
      if (near[lane] * w_[ray] > kBeyond) return;
      const std::uint32_t child = node.child[lane];
      if (MeshTree::is_leaf(child)) {
        Rectangles rectangles;
        Facets facets;
        const MeshLeaf& leaf = tree_.leaf(child);
        if (const Bits seen = turn(leaf, facets, rectangles); seen != 0) test_ray(facets, leaf, seen, ray);
      } else {
        descend(ray, tree_.node(child));
      }
    }
  }

  // Of a leaf in the tile's frame; returns which of its triangles are in view.
  HWY_INLINE Bits turn(const MeshLeaf& leaf, Facets& facets, Rectangles& r) const {
    F3 c[3];
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = turned({load(leaf.corner[k][0]) - all(origin_[0]), load(leaf.corner[k][1]) - all(origin_[1]),
                     load(leaf.corner[k][2]) - all(origin_[2])});
    }
    const F one = all(1.0F), zero = all(0.0F), wide = all(kWide), margin = all(margin_);
    r.near = least(least(c[0].x, c[1].x), c[2].x);
    const F far = most(most(c[0].x, c[1].x), c[2].x);
    const M ahead = r.near > all(kTiny);
    F u[3], v[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const F inverse = one / c[k].x;
      u[k] = c[k].y * inverse;
      v[k] = c[k].z * inverse;
    }
    r.u0 = select(ahead, least(least(u[0], u[1]), u[2]) - margin, zero - wide);
    r.u1 = select(ahead, most(most(u[0], u[1]), u[2]) + margin, wide);
    r.v0 = select(ahead, least(least(v[0], v[1]), v[2]) - margin, zero - wide);
    r.v1 = select(ahead, most(most(v[0], v[1]), v[2]) + margin, wide);
    const Bits seen = in_view(r) & bits(far > zero);
    if (seen == 0) return 0;
    store(select(ahead, one / far, zero), facets.least);
    store(select(ahead, one / r.near, all(FLT_MAX)), facets.most);

    // Twice the cross product of two corners: of the edge seen from its other triangle it differs in sign and in nothing else.
    // Each of its coordinates is off by some roundings of the largest product that it may be made of.
    const F picture = all(2.0F * kRounding * (1.0F + largest_u_ + largest_v_));
    F3 edge[3];
    F slack[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const F3 sum = c[(k + 1) % 3] + c[k], difference = c[(k + 1) % 3] - c[k];
      edge[k] = cross(sum, difference);
      slack[k] = picture * largest(sum) * largest(difference);
    }
    const F3 along = c[1] - c[0], across = c[2] - c[1];
    const F3 normal = cross(along, across);
    const F height = (normal.x * c[0].x + normal.y * c[0].y) + normal.z * c[0].z;
    const M is_clear = magnitude(height) > all(6.0F * kRounding) * largest(along) * largest(across) * largest(c[0]);
    facets.slivers = ~bits(is_clear) & 0xFFFFU;
    const F side = select(height >= zero, one, zero - one);
    for (std::size_t k = 0; k < 3; ++k) {
      store(slack[k], facets.slack[k]);
      facets.edge[k].set(side * edge[k].x + slack[k], side * edge[k].y, side * edge[k].z);
    }
    const F inverse = one / height;
    facets.depth.set(select(is_clear, normal.x * inverse, zero), select(is_clear, normal.y * inverse, zero),
                     select(is_clear, normal.z * inverse, zero));
    store(normal.x, facets.normal[0]);
    store(normal.y, facets.normal[1]);
    store(normal.z, facets.normal[2]);
    for (std::size_t k = 0; k < 3; ++k) {
      store(c[k].x, facets.corner[k][0]);
      store(c[k].y, facets.corner[k][1]);
      store(c[k].z, facets.corner[k][2]);
    }
    return seen;
  }

  // box: that of the leaf, one of sixteen in a node; null for the root.
  void visit(const MeshLeaf& leaf, Bits subs, const StoredRectangles* boxes, std::size_t box) {
    Rectangles rectangles;
    Facets facets;
    const Bits seen = turn(leaf, facets, rectangles);
    if (seen == 0) return;
    Bits changed = 0;
    if (boxes != nullptr && std::popcount(subs) <= kFewSubs) {
      // Rays by triangles or triangles by rays, what is fewer.
      for (Bits left = subs; left != 0; left &= left - 1) {
        const auto sub = static_cast<std::size_t>(std::countr_zero(left));
        Bits rays = rays_in(*boxes, box, sub);
        const Bits triangles =
            seen & bits((rectangles.u1 >= all(u0_[sub])) & (all(u1_[sub]) >= rectangles.u0) & (rectangles.v1 >= all(v0_[sub])) &
                        (all(v1_[sub]) >= rectangles.v0) & (all(kBeyond) >= rectangles.near * all(w_of_[sub])));
        bool any = false;
        if (std::popcount(rays) < std::popcount(triangles)) {
          for (; rays != 0; rays &= rays - 1) {
            any |= test_ray(facets, leaf, triangles, 16 * sub + static_cast<std::size_t>(std::countr_zero(rays)));
          }
        } else {
          for (Bits each = triangles; each != 0; each &= each - 1) {
            const auto i = static_cast<std::size_t>(std::countr_zero(each));
            any |= test(facets, leaf.triangle[i], i, sub);
          }
        }
        if (any) changed |= left & (~left + 1U);
      }
    } else {
      const StoredRectangles stored(rectangles);
      for (Bits left = seen; left != 0; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        Bits in = subs & subs_in(stored, i);
        if (std::popcount(in) > 1) in &= subs_within(facets, i);
        for (; in != 0; in &= in - 1) {
          if (test(facets, leaf.triangle[i], i, static_cast<std::size_t>(std::countr_zero(in)))) changed |= in & (~in + 1U);
        }
      }
    }
    if (changed != 0) refresh(changed);
  }

  // Which sub-tiles are not all outside of one edge of a triangle, or all behind it.
  HWY_INLINE Bits subs_within(const Facets& facets, std::size_t i) const {
    if ((facets.slivers >> i & 1U) != 0) return 0xFFFFU;
    const F u = all(0.5F) * (load(u0_) + load(u1_)), v = all(0.5F) * (load(v0_) + load(v1_));
    const F reach_u = all(0.5F) * (load(u1_) - load(u0_)) + all(margin_),
            reach_v = all(0.5F) * (load(v1_) - load(v0_)) + all(margin_);
    const auto highest = [&](const Linear& edge) HWY_ATTR {
      return (edge.of_one(i, u, v) + all(std::abs(edge.of_u[i])) * reach_u) + all(std::abs(edge.of_v[i])) * reach_v;
    };
    const F edges =
        least(least(highest(facets.edge[0]) + all(facets.slack[0][i]), highest(facets.edge[1]) + all(facets.slack[1][i])),
              highest(facets.edge[2]) + all(facets.slack[2][i]));
    return bits(edges >= all(0.0F));
  }

  // The rays of a sub-tile and one triangle. Whether one has hit it.
  HWY_INLINE bool test(const Facets& facets, std::int32_t triangle, std::size_t i, std::size_t sub) {
    const F u = load(u_ + 16 * sub), v = load(v_ + 16 * sub), best = load(w_ + 16 * sub);
    const F a = facets.edge[0].of_one(i, u, v), b = facets.edge[1].of_one(i, u, v), c = facets.edge[2].of_one(i, u, v);
    const F w = least(most(facets.depth.of_one(i, u, v), all(facets.least[i])), all(facets.most[i]));
    const bool is_sliver = (facets.slivers >> i & 1U) != 0;
    M hit = (w >= best) & (all(most_w_) >= w);
    if (!is_sliver) hit = hit & (least(least(a, b), c) >= all(0.0F));
    if (none(hit)) return false;
    hit = hit & ((w > best) | is_above(id_ + 16 * sub, triangle));
    const M is_certain =
        (a > all(2.0F * facets.slack[0][i])) & (b > all(2.0F * facets.slack[1][i])) & (c > all(2.0F * facets.slack[2][i]));
    Bits taken = bits(hit);
    if (Bits uncertain = is_sliver ? taken : taken & ~bits(is_certain); uncertain != 0) {
      alignas(64) float keep[16];
      store(select(hit, all(1.0F), all(0.0F)), keep);
      for (; uncertain != 0; uncertain &= uncertain - 1) {
        const auto lane = static_cast<std::size_t>(std::countr_zero(uncertain));
        if (!hits(facets, i, 16 * sub + lane)) keep[lane] = 0.0F;
      }
      hit = load(keep) > all(0.0F);
      taken = bits(hit);
    }
    if (taken == 0) return false;
    store_where(hit, w, w_ + 16 * sub);
    store_where(hit, triangle, id_ + 16 * sub);
    for (std::size_t axis = 0; axis < 3; ++axis) store_where(hit, all(facets.normal[axis][i]), n_[axis] + 16 * sub);
    const F weight = all(1.0F) / most((a + b) + c, all(FLT_MIN));
    store_where(hit, least(c * weight, all(1.0F)), b_ + 16 * sub);
    store_where(hit, least(a * weight, all(1.0F)), c_ + 16 * sub);
    return true;
  }

  // One ray and the triangles of a leaf. Whether it has hit one.
  HWY_INLINE bool test_ray(const Facets& facets, const MeshLeaf& leaf, Bits triangles, std::size_t ray) {
    const F a = facets.edge[0].of_all(u_[ray], v_[ray]), b = facets.edge[1].of_all(u_[ray], v_[ray]),
            c = facets.edge[2].of_all(u_[ray], v_[ray]);
    const F w = least(most(facets.depth.of_all(u_[ray], v_[ray]), load(facets.least)), load(facets.most));
    const M inside = least(least(a, b), c) >= all(0.0F);
    Bits hit = triangles & bits((w >= all(w_[ray])) & (all(most_w_) >= w)) & (bits(inside) | facets.slivers);
    if (hit == 0) return false;
    alignas(64) float at[4][16];
    store(a, at[0]);
    store(b, at[1]);
    store(c, at[2]);
    store(w, at[3]);
    bool any = false;
    for (; hit != 0; hit &= hit - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(hit));
      if (at[3][i] < w_[ray] || (at[3][i] == w_[ray] && id_[ray] <= leaf.triangle[i])) continue;
      bool is_certain = (facets.slivers >> i & 1U) == 0;
      for (std::size_t k = 0; k < 3; ++k) is_certain &= at[k][i] > 2.0F * facets.slack[k][i];
      if (!is_certain && !hits(facets, i, ray)) continue;
      w_[ray] = at[3][i];
      id_[ray] = leaf.triangle[i];
      for (std::size_t axis = 0; axis < 3; ++axis) n_[axis][ray] = facets.normal[axis][i];
      const float weight = 1.0F / std::max((at[0][i] + at[1][i]) + at[2][i], FLT_MIN);
      b_[ray] = std::min(at[2][i] * weight, 1.0F);
      c_[ray] = std::min(at[0][i] * weight, 1.0F);
      any = true;
    }
    return any;
  }

  bool hits(const Facets& facets, std::size_t i, std::size_t ray) const {
    std::array<Corner, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto at = [&](std::size_t axis) { return static_cast<double>(facets.corner[k][axis][i]); };
      corners[k] = {at(0), at(1), at(2)};
    }
    return hits_exactly(u_[ray], v_[ray], corners);
  }

  void write() {
    const hn::CappedTag<float, 4> d;
    const hn::RebindToSigned<decltype(d)> di;
    const std::size_t lanes = hn::Lanes(d);
    const auto world = [&](int axis, std::size_t from) HWY_ATTR {
      const auto part = [&](int k) HWY_ATTR { return hn::Mul(hn::Set(d, rays_.rotation(axis, k)), hn::Load(d, n_[k] + from)); };
      return hn::Add(part(0), hn::Add(part(1), part(2)));
    };
    for (std::size_t row = 0; row < rays_.count / 16; ++row) {
      for (std::size_t column = 0; column < 16; column += lanes) {
        const std::size_t from = place(row, column), to = 16 * row + column;
        const auto id = hn::Load(di, id_ + from);
        const auto found = hn::Ne(id, hn::Set(di, kNobody));
        const auto is_hit = hn::RebindMask(d, found);
        const auto put = [&](auto value, float* at) HWY_ATTR { hn::BlendedStore(value, is_hit, d, at + to); };
        put(hn::Min(hn::Div(hn::Set(d, 1.0F), hn::Load(d, w_ + from)), hn::Set(d, rays_.range)), rays_.t_hit);
        hn::BlendedStore(hn::Add(id, hn::Set(di, first_element_)), found, di, rays_.element + to);
        put(hn::Load(d, b_ + from), details_.u);
        put(hn::Load(d, c_ + from), details_.v);
        put(world(0, from), details_.normal_x);
        put(world(1, from), details_.normal_y);
        put(world(2, from), details_.normal_z);
      }
    }
  }

  const MeshTree& tree_;
  const std::int32_t first_element_;
  RayBundle& rays_;
  HitDetails& details_;
  float origin_[3];
  float to_tile_[3][3];
  float widen_;                    // m
  float margin_;                   // of u and v
  float most_w_;                   // nothing nearer counts
  float w_of_all_;                 // 1 / the farthest hit, or the range
  float whole_u_[2], whole_v_[2];  // least and most of the tile
  float largest_u_, largest_v_;
  Bits used_ = 0;
  alignas(64) float u_[kRays], v_[kRays], w_[kRays];                // w: 1 / the depth of what was hit
  alignas(64) std::int32_t id_[kRays];                              // of what was hit
  alignas(64) float b_[kRays], c_[kRays], n_[3][kRays];             // likewise: its details
  alignas(64) float u0_[16], u1_[16], v0_[16], v1_[16], w_of_[16];  // of the sub-tiles
};

void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, RayBundle& rays, HitDetails& details) {
  TileTrace(tree, first_element, rays, details).trace();
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_mesh_tile);

void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, RayBundle& rays, HitDetails& details) {
  HWY_DYNAMIC_DISPATCH(trace_mesh_tile)(tree, first_element, rays, details);
}

}  // namespace flockstep::trace
#endif
