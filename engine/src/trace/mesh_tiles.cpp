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

#include "base/near_memory.hpp"
#include "base/wide-inl.hpp"

#ifndef FLOCKSTEP_TRACE_MESH_TILES_COMMON
#define FLOCKSTEP_TRACE_MESH_TILES_COMMON
namespace flockstep::trace {

using Bits = std::uint32_t;  // one bit for each of sixteen rays, sub-tiles or triangles

struct Corner {
  double x, y, z;
};
inline double largest(const Corner& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

// Returns the exact sign of a * d - b * c. Rounding is monotonic: it never makes the greater product the lesser one.
inline int sign_of_difference(double a, double d, double b, double c) {
  const double p = a * d, q = b * c;
  if (p != q) return p > q ? 1 : -1;
  const double rest = std::fma(a, d, -p) - std::fma(b, c, -q);
  return rest > 0.0 ? 1 : rest < 0.0 ? -1 : 0;
}

// Tests if the line of the ray (1, u, v) crosses the triangle, edges and corners included. Returns 1 if it crosses along the
// triangle's normal, -1 if it crosses against it, and 0 if it misses. Every corner is projected along the ray to a point of a
// plane. This point is rounded, but it is the same in each triangle that has the corner; the rest is exact.
inline int crosses_exactly(float u, float v, const std::array<Corner, 3>& corners) {
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
  return least >= 0 ? most : most <= 0 ? least : 0;  // all 0: the triangle has no area
}

}  // namespace flockstep::trace
#endif

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

using F = WideOf<16>;
using I = F::Int;
using M = F::Mask;
using F3 = Wide3<F>;

// Stores whole vectors. On some processors a masked store is slow, and so is the next load of the same memory.
HWY_INLINE void store_where(M mask, F value, float* to) { select(mask, value, F::load(to)).store(to); }
HWY_INLINE void store_where(M mask, std::int32_t value, std::int32_t* to) { select(mask, value, I::load(to)).store(to); }
// Replaces the last four bits of each number by its lane, so that no two are equal.
HWY_INLINE F numbered(F a) { return bit_cast<F>((bit_cast<I>(a) & ~15) | I::iota()); }
HWY_INLINE F largest(const F3& a) { return max(max(abs(a.x), abs(a.y)), abs(a.z)); }

constexpr float kRounding = 0x1p-20F;  // several roundings of a sum of products, relative to the magnitude of its terms
constexpr float kBeyond = 1.0001F;     // boxes that begin beyond this multiple of the farthest hit are skipped
constexpr float kTiny = 1e-12F;        // m
constexpr float kWide = 1e30F;
constexpr std::int32_t kNoTriangle = std::numeric_limits<std::int32_t>::max();
constexpr std::size_t kRays = 256;
constexpr int kSubTileThreshold = 2;      // a node in at most this many sub-tiles is tested against each of their rays
constexpr int kLeafSubTileThreshold = 6;  // the same for a leaf
constexpr std::size_t kRayThreshold = 2;  // at most this many rays traverse a subtree one by one

// Conservative bounds of sixteen boxes or triangles in the tile's picture: u, v and the least depth.
struct Rectangles {
  F u0, u1, v0, v1, near;
};
struct StoredRectangles {
  alignas(64) float u0[16], u1[16], v0[16], v1[16], near[16];

  HWY_INLINE explicit StoredRectangles(const Rectangles& r) {
    r.u0.store(u0);
    r.u1.store(u1);
    r.v0.store(v0);
    r.v1.store(v1);
    r.near.store(near);
  }
};

// A linear function for each of the sixteen triangles of a leaf, in the tile's frame: value(u, v) = of_1 + of_u u + of_v v.
struct Linear {
  alignas(64) float of_1[16], of_u[16], of_v[16];

  HWY_INLINE void set(F a, F b, F c) {
    a.store(of_1);
    b.store(of_u);
    c.store(of_v);
  }
  // of_one() evaluates one triangle for sixteen rays, of_all() evaluates sixteen triangles for one ray.
  HWY_INLINE F of_one(std::size_t triangle, F u, F v) const { return of_1[triangle] + of_u[triangle] * u + of_v[triangle] * v; }
  HWY_INLINE F of_all(float u, float v) const { return F::load(of_1) + F::load(of_u) * u + F::load(of_v) * v; }
};
struct Facets {
  Linear edge[3];               // at least 0 inside the triangle, with a margin larger than the rounding errors
  alignas(64) float clear[16];  // if all three edges exceed this, rounding does not matter
  Linear depth;                 // 1 / depth, before it is clamped to [least, most]; its coefficients are also a normal
  alignas(64) float least[16], most[16];
  alignas(64) std::int32_t id[16];  // twice the triangle's number, plus 1 if its back is visible
  Bits slivers;  // triangles so nearly edge-on that rounding could swap their sides; of these only id, least and most are used
};

class TileTrace {
 public:
  TileTrace(const MeshTree& tree, std::int32_t first_element, const TileAxis& u, const TileAxis& v, RayBundle& rays,
            HitDetails* details, AskedDetails asked, const Masks* masks)
      : tree_(tree),
        first_element_(first_element),
        u_(u),
        v_(v),
        rays_(rays),
        details_(details),
        normals_(asked.normals && details != nullptr),
        weights_(asked.weights && details != nullptr && tree.needs_weights()),
        masks_(masks) {}

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
  void begin() {
    for (std::size_t i = 0; i < 3; ++i) {
      origin_[i] = rays_.origin[static_cast<Eigen::Index>(i)];
      for (std::size_t j = 0; j < 3; ++j) {
        to_tile_[i][j] = rays_.rotation(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(i));
      }
    }
    widen_ = tree_.rounding(rays_.origin);
    most_w_ = rays_.near > 0.0F ? 1.0F / rays_.near : FLT_MAX;
    const float least_w = std::max(1.0F / rays_.range, FLT_MIN);

    const std::size_t rows = (rays_.count / 16 + 3) / 4 * 4;
    used_ = (1U << rows) - 1U;
    std::fill_n(id_, kRays, kNoTriangle);
    std::fill_n(w_of_, 16, FLT_MAX);
    if (rays_.no_hits_yet) {
      for (std::size_t sub = 0; sub < rows; ++sub) F(least_w).store(w_ + 16 * sub);
      for (std::size_t row = rays_.count / 16; row < rows; ++row) {  // padding rows of the last sub-tiles
        for (std::size_t column = 0; column < 16; ++column) w_[TileAxis::place(row, column)] = FLT_MAX;
      }
      std::fill_n(w_of_, rows, least_w);
    } else {
      take_over(rows, least_w);
    }
    largest_u_ = std::max(std::abs(u_.least_of_all), std::abs(u_.most_of_all));
    largest_v_ = std::max(std::abs(v_.least_of_all), std::abs(v_.most_of_all));
    margin_ = kRounding * (1.0F + std::max(largest_u_, largest_v_));
    w_of_all_ = min_of_lanes(F::load(w_of_));
  }

  // Starts from the hits that the rays already have.
  HWY_INLINE void take_over(std::size_t rows, float least_w) {
    std::fill(rays_.t_hit + rays_.count, rays_.t_hit + 16 * rows, -1.0F);  // padding rows of the last sub-tiles
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < 16; column += 4) {
        std::memcpy(w_ + TileAxis::place(row, column), rays_.t_hit + 16 * row + column, 4 * sizeof(float));
      }
    }
    for (std::size_t sub = 0; sub < rows; ++sub) {
      const F t = F::load(w_ + 16 * sub);
      const F w = select(t >= 0.0F, max(1.0F / t, least_w), FLT_MAX);
      w.store(w_ + 16 * sub);
      w_of_[sub] = min_of_lanes(w);
    }
  }

  // Transforms a point of the world into the tile's frame.
  HWY_INLINE F3 to_tile(const F3& point) const {
    return rotate([this](int row, int column) { return to_tile_[row][column]; }, point - F3{origin_[0], origin_[1], origin_[2]});
  }

  // Returns which of sixteen boxes or triangles may be in view.
  HWY_INLINE Bits in_view(const Rectangles& r) const {
    return bits((r.u1 >= u_.least_of_all) & (u_.most_of_all >= r.u0) & (r.v1 >= v_.least_of_all) & (v_.most_of_all >= r.v0) &
                (kBeyond >= r.near * w_of_all_));
  }
  // Returns the sub-tiles in which box or triangle i may be hit.
  HWY_INLINE Bits subs_in(const StoredRectangles& r, std::size_t i) const {
    return used_ & bits((F::load(u_.ends[1]) >= r.u0[i]) & (r.u1[i] >= F::load(u_.ends[0])) & (F::load(v_.ends[1]) >= r.v0[i]) &
                        (r.v1[i] >= F::load(v_.ends[0])) & (kBeyond >= r.near[i] * F::load(w_of_)));
  }

  HWY_INLINE Bits look(const MeshNode& node, Rectangles& r) const {
    const F3 center = to_tile(F3::load(node.center[0], node.center[1], node.center[2]));
    const F half[3] = {F::load(node.half[0]), F::load(node.half[1]), F::load(node.half[2])};
    const auto reach = [&](std::size_t i) HWY_ATTR {
      return std::abs(to_tile_[i][0]) * half[0] + std::abs(to_tile_[i][1]) * half[1] + std::abs(to_tile_[i][2]) * half[2] +
             widen_;
    };
    const F x = reach(0), y = reach(1), z = reach(2);
    r.near = center.x - x;
    const F far = center.x + x;
    const F a = 1.0F / max(r.near, kTiny), b = 1.0F / max(far, kTiny);
    const F left = center.y - y, right = center.y + y, below = center.z - z, above = center.z + z, margin = margin_;
    r.u0 = min(left * a, left * b) - margin;
    r.u1 = max(right * a, right * b) + margin;
    r.v0 = min(below * a, below * b) - margin;
    r.v1 = max(above * a, above * b) + margin;
    return in_view(r) & bits((far > 0.0F) & (half[0] >= 0.0F));
  }

  void visit(const MeshNode& node) {
    Rectangles rectangles;
    Bits children = look(node, rectangles);
    if (children == 0) return;
    const StoredRectangles stored(rectangles);
    // Sort the children by depth: the position of a child is the number of nearer ones.
    const F depths = numbered(max(rectangles.near, kTiny));
    alignas(64) float depth[16];
    depths.store(depth);
    std::array<std::uint8_t, 16> order;
    const auto count = static_cast<std::size_t>(std::popcount(children));
    for (Bits left = children; left != 0; left &= left - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(left));
      order[static_cast<std::size_t>(std::popcount(children & bits(depth[lane] > depths)))] = static_cast<std::uint8_t>(lane);
    }
    tree_.fetch(node.child[order[0]]);
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t lane = order[i];
      if (stored.near[lane] * w_of_all_ > kBeyond) return;
      if (i + 1 < count) tree_.fetch(node.child[order[i + 1]]);
      const Bits subs = subs_in(stored, lane);
      if (subs == 0) continue;
      const std::uint32_t child = node.child[lane];
      if (MeshTree::is_leaf(child)) {
        visit(tree_.leaf(child), subs, &stored, lane);
        continue;
      }
      std::size_t count_in = kRays;
      if (std::popcount(subs) <= kSubTileThreshold) {
        count_in = 0;
        for (Bits left = subs; left != 0; left &= left - 1) {
          const auto sub = static_cast<std::size_t>(std::countr_zero(left));
          count_in += static_cast<std::size_t>(std::popcount(rays_in(stored, lane, sub)));
        }
        if (count_in == 0) continue;
      }
      if (count_in <= kRayThreshold) {
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

  // Returns which rays of a sub-tile may hit box or triangle i.
  HWY_INLINE Bits rays_in(const StoredRectangles& r, std::size_t i, std::size_t sub) const {
    const F u = F::load(u_.of_ray + 16 * sub), v = F::load(v_.of_ray + 16 * sub);
    return bits((u >= r.u0[i]) & (r.u1[i] >= u) & (v >= r.v0[i]) & (r.v1[i] >= v) &
                (kBeyond >= r.near[i] * F::load(w_ + 16 * sub)));
  }

  // Updates the farthest hit of the changed sub-tiles and of the tile.
  HWY_INLINE void refresh(Bits changed) {
    for (; changed != 0; changed &= changed - 1) {
      const auto sub = static_cast<std::size_t>(std::countr_zero(changed));
      w_of_[sub] = min_of_lanes(F::load(w_ + 16 * sub));
    }
    w_of_all_ = min_of_lanes(F::load(w_of_));
  }

  // Traverses the tree with one ray.
  void descend(std::size_t ray, const MeshNode& node) {
    F enter = 0.0F, leave = kBeyond / w_[ray];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float along = (to_tile_[0][axis] + to_tile_[1][axis] * u_.of_ray[ray]) + to_tile_[2][axis] * v_.of_ray[ray];
      const float inverse = 1.0F / (std::abs(along) < kTiny ? std::copysign(kTiny, along) : along);
      const F middle = (F::load(node.center[axis]) - origin_[axis]) * inverse;
      const F reach = (F::load(node.half[axis]) + 2.0F * widen_) * std::abs(inverse);
      enter = max(enter, middle - reach);
      leave = min(leave, middle + reach);
    }
    alignas(64) float near[16];
    enter.store(near);
    Bits children = bits((leave >= enter) & (F::load(node.half[0]) >= 0.0F));
    while (children != 0) {  // nearest child first; there are few
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
        const Bits seen = turn(leaf, facets, rectangles);
        if (seen == 0) continue;
        test_ray(facets, leaf, seen & ~facets.slivers, ray);
        for (Bits left = seen & facets.slivers; left != 0; left &= left - 1) {
          test_sliver(facets, leaf, static_cast<std::size_t>(std::countr_zero(left)), ray);
        }
      } else {
        descend(ray, tree_.node(child));
      }
    }
  }

  // Transforms a leaf into the tile's frame. Returns which of its triangles are in view.
  HWY_INLINE Bits turn(const MeshLeaf& leaf, Facets& facets, Rectangles& r) const {
    F3 c[3];
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = to_tile(F3::load(leaf.corner[k][0], leaf.corner[k][1], leaf.corner[k][2]));
    }
    const F margin = margin_;
    r.near = min(min(c[0].x, c[1].x), c[2].x);
    const F far = max(max(c[0].x, c[1].x), c[2].x);
    const M ahead = r.near > kTiny;
    F u[3], v[3], inverse[3];
    for (std::size_t k = 0; k < 3; ++k) {
      inverse[k] = 1.0F / c[k].x;
      u[k] = c[k].y * inverse[k];
      v[k] = c[k].z * inverse[k];
    }
    r.u0 = select(ahead, min(min(u[0], u[1]), u[2]) - margin, -kWide);
    r.u1 = select(ahead, max(max(u[0], u[1]), u[2]) + margin, kWide);
    r.v0 = select(ahead, min(min(v[0], v[1]), v[2]) - margin, -kWide);
    r.v1 = select(ahead, max(max(v[0], v[1]), v[2]) + margin, kWide);
    const Bits seen = in_view(r) & bits(far > 0.0F);
    if (seen == 0) return 0;
    (1.0F / far).store(facets.least);
    select(ahead, max(max(inverse[0], inverse[1]), inverse[2]), FLT_MAX).store(facets.most);

    // Twice the cross product of two corners. For the other triangle of the edge it differs only in sign. Each coordinate is a
    // difference of two products. Its rounding error is at most a small multiple of that of the largest possible product.
    F3 edge[3];
    F length[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const F3 difference = c[(k + 1) % 3] - c[k];
      edge[k] = cross(c[(k + 1) % 3] + c[k], difference);
      length[k] = largest(difference);
    }
    const F reach = max(max(largest(c[0]), largest(c[1])), largest(c[2]));
    const F slack = 4.0F * kRounding * (1.0F + largest_u_ + largest_v_) * reach * max(max(length[0], length[1]), length[2]);
    (2.0F * slack).store(facets.clear);
    const F3 normal = cross(c[1] - c[0], c[2] - c[1]);
    const F height = dot(normal, c[0]);
    const M is_clear = abs(height) > 6.0F * kRounding * length[0] * length[1] * reach;
    facets.slivers = ~bits(is_clear) & 0xFFFFU;
    (shift_left<1>(I::load(leaf.triangle)) | value_if(height > 0.0F, I(1))).store(facets.id);
    const F side = select(height >= 0.0F, F(1.0F), -1.0F);
    for (std::size_t k = 0; k < 3; ++k) facets.edge[k].set(side * edge[k].x + slack, side * edge[k].y, side * edge[k].z);
    const F share = 1.0F / height;
    facets.depth.set(normal.x * share, normal.y * share, normal.z * share);
    return seen;
  }

  // Entry `box` of `boxes` holds the bounds of the leaf. `boxes` is null if the leaf is the root.
  void visit(const MeshLeaf& leaf, Bits subs, const StoredRectangles* boxes, std::size_t box) {
    const bool few = boxes != nullptr && std::popcount(subs) <= kLeafSubTileThreshold;
    std::array<Bits, 16> rays;  // by sub-tile: rays that may hit the leaf
    if (few) {
      for (Bits left = subs; left != 0; left &= left - 1) {
        const auto sub = static_cast<std::size_t>(std::countr_zero(left));
        rays[sub] = rays_in(*boxes, box, sub);
        if (rays[sub] == 0) subs &= ~(left & (~left + 1U));
      }
      if (subs == 0) return;
    }
    Rectangles rectangles;
    Facets facets;
    const Bits seen = turn(leaf, facets, rectangles), facing = seen & ~facets.slivers;
    if (seen == 0) return;
    Bits changed = 0;
    if (few) {
      // Iterate over the rays or over the triangles, depending on which are fewer.
      for (Bits left = subs; left != 0; left &= left - 1) {
        const auto sub = static_cast<std::size_t>(std::countr_zero(left));
        const Bits triangles = facing & triangles_in(rectangles, facets, sub);
        bool any = false;
        if (std::popcount(rays[sub]) < std::popcount(triangles)) {
          for (Bits each = rays[sub]; each != 0; each &= each - 1) {
            any |= test_ray(facets, leaf, triangles, 16 * sub + static_cast<std::size_t>(std::countr_zero(each)));
          }
        } else {
          for (Bits each = triangles; each != 0; each &= each - 1) {
            any |= test(facets, leaf, static_cast<std::size_t>(std::countr_zero(each)), sub);
          }
        }
        if (any) changed |= left & (~left + 1U);
      }
    } else {
      const StoredRectangles stored(rectangles);
      for (Bits left = facing; left != 0; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        Bits in = subs & subs_in(stored, i);
        if (std::popcount(in) > 1) in &= subs_within(facets, i);
        for (; in != 0; in &= in - 1) {
          if (test(facets, leaf, i, static_cast<std::size_t>(std::countr_zero(in)))) changed |= in & (~in + 1U);
        }
      }
    }
    for (Bits left = seen & facets.slivers; left != 0; left &= left - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(left));
      for (Bits in = subs; in != 0; in &= in - 1) {
        const auto sub = static_cast<std::size_t>(std::countr_zero(in));
        for (std::size_t ray = 16 * sub; ray < 16 * sub + 16; ++ray) {
          if (test_sliver(facets, leaf, i, ray)) changed |= in & (~in + 1U);
        }
      }
    }
    if (changed != 0) refresh(changed);
  }

  // Returns which triangles may be hit in a sub-tile, by the tests of subs_in() and subs_within().
  HWY_INLINE Bits triangles_in(const Rectangles& r, const Facets& facets, std::size_t sub) const {
    const F u0 = u_.ends[0][sub], u1 = u_.ends[1][sub], v0 = v_.ends[0][sub], v1 = v_.ends[1][sub];
    const auto greatest = [&](const Linear& value) HWY_ATTR {
      const F of_u = F::load(value.of_u), of_v = F::load(value.of_v);
      return F::load(value.of_1) + max(of_u * u0, of_u * u1) + max(of_v * v0, of_v * v1);
    };
    const F edges = min(min(greatest(facets.edge[0]), greatest(facets.edge[1])), greatest(facets.edge[2]));
    return bits((r.u1 >= u0) & (u1 >= r.u0) & (r.v1 >= v0) & (v1 >= r.v0) & (edges >= 0.0F) & (kBeyond >= r.near * w_of_[sub]));
  }

  // Returns 1 or 0 without a branch, which would be unpredictable.
  static std::size_t is_positive(float value) { return ~std::bit_cast<std::uint32_t>(value) >> 31U; }

  // Returns the sub-tiles in which a triangle may be hit. It drops those that lie entirely outside one edge, and those in which
  // every ray already has a nearer hit. A linear function has its maximum at a corner of a sub-tile. This also holds after
  // rounding, since rounded multiplications and additions are monotonic.
  HWY_INLINE Bits subs_within(const Facets& facets, std::size_t i) const {
    const auto greatest = [&](const Linear& value) HWY_ATTR {
      return value.of_one(i, F::load(u_.ends[is_positive(value.of_u[i])]), F::load(v_.ends[is_positive(value.of_v[i])]));
    };
    const F edges = min(min(greatest(facets.edge[0]), greatest(facets.edge[1])), greatest(facets.edge[2]));
    const F w = min(max(greatest(facets.depth), facets.least[i]), facets.most[i]);
    return bits((edges >= 0.0F) & (w >= F::load(w_of_)));
  }

  // Tests the rays of a sub-tile against one triangle. Returns true if any of them hits it.
  HWY_INLINE bool test(const Facets& facets, const MeshLeaf& leaf, std::size_t i, std::size_t sub) {
    const F u = F::load(u_.of_ray + 16 * sub), v = F::load(v_.of_ray + 16 * sub), best = F::load(w_ + 16 * sub);
    const F a = facets.edge[0].of_one(i, u, v), b = facets.edge[1].of_one(i, u, v), c = facets.edge[2].of_one(i, u, v);
    const F w = min(max(facets.depth.of_one(i, u, v), facets.least[i]), facets.most[i]);
    const F lowest = min(min(a, b), c);
    M hit = (lowest >= 0.0F) & (w >= best) & (most_w_ >= w);
    if (none(hit)) return false;
    const std::int32_t id = facets.id[i];
    hit = hit & ((w > best) | (I::load(id_ + 16 * sub) > id));
    if (const M doubtful = without(hit, lowest > facets.clear[i]); !none(doubtful)) {
      hit = without(hit, missed(facets, leaf, i, sub, bits(doubtful)));
    }
    if (none(hit)) return false;
    if (is_masked(leaf, i)) {
      hit = without(hit, seen_through(leaf, i, sub, bits(hit)));
      if (none(hit)) return false;
    }
    store_where(hit, w, w_ + 16 * sub);
    store_where(hit, id, id_ + 16 * sub);
    if (normals_) {
      store_where(hit, facets.depth.of_1[i], n_[0] + 16 * sub);
      store_where(hit, facets.depth.of_u[i], n_[1] + 16 * sub);
      store_where(hit, facets.depth.of_v[i], n_[2] + 16 * sub);
    }
    if (weights_) {
      store_where(hit, a, weight_[0] + 16 * sub);
      store_where(hit, b, weight_[1] + 16 * sub);
      store_where(hit, c, weight_[2] + 16 * sub);
    }
    return true;
  }

  // Tests one ray against the triangles of a leaf. Returns true if it hits one.
  HWY_INLINE bool test_ray(const Facets& facets, const MeshLeaf& leaf, Bits triangles, std::size_t ray) {
    const F a = facets.edge[0].of_all(u_.of_ray[ray], v_.of_ray[ray]), b = facets.edge[1].of_all(u_.of_ray[ray], v_.of_ray[ray]),
            c = facets.edge[2].of_all(u_.of_ray[ray], v_.of_ray[ray]);
    const F w = min(max(facets.depth.of_all(u_.of_ray[ray], v_.of_ray[ray]), F::load(facets.least)), F::load(facets.most));
    const F lowest = min(min(a, b), c);
    Bits hit = triangles & bits((lowest >= 0.0F) & (w >= w_[ray]) & (most_w_ >= w));
    if (hit == 0) return false;
    const Bits clear = bits(lowest > F::load(facets.clear));
    alignas(64) float at[4][16];
    a.store(at[0]);
    b.store(at[1]);
    c.store(at[2]);
    w.store(at[3]);
    bool any = false;
    for (; hit != 0; hit &= hit - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(hit));
      if (!is_nearer(at[3][i], facets.id[i], ray)) continue;
      if ((clear >> i & 1U) == 0 && !hits_exactly(facets, leaf, i, ray)) continue;
      if (is_masked(leaf, i) && is_seen_through(leaf, i, ray)) continue;
      take(ray, at[3][i], facets.id[i], {facets.depth.of_1[i], facets.depth.of_u[i], facets.depth.of_v[i]},
           {at[0][i], at[1][i], at[2][i]});
      any = true;
    }
    return any;
  }

  // Tests one ray against a triangle that is seen edge-on, in double precision. Returns true on a hit.
  bool test_sliver(const Facets& facets, const MeshLeaf& leaf, std::size_t i, std::size_t ray) {
    if (!is_nearer(facets.most[i], facets.id[i], ray)) return false;
    const double u = static_cast<double>(u_.of_ray[ray]), v = static_cast<double>(v_.of_ray[ray]);
    const std::array<Corner, 3> corner = corners(leaf, i);
    const int side = crosses_exactly(u_.of_ray[ray], v_.of_ray[ray], corner);
    if (side == 0) return false;
    const Corner &c = corner[0], a{corner[1].x - c.x, corner[1].y - c.y, corner[1].z - c.z},
                 b{corner[2].x - c.x, corner[2].y - c.y, corner[2].z - c.z};
    const Corner normal{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    const double height = normal.x * c.x + normal.y * c.y + normal.z * c.z;
    // The line may cross the triangle behind the origin. The sign of `height` decides. If `height` is 0 to within its rounding
    // error, the origin lies in the triangle's plane. The hit then gets the triangle's largest depth, which keeps surfaces
    // closed.
    const float least = facets.least[i];
    float w = least;
    if (std::abs(height) > 0x1p-47 * largest(a) * largest(b) * largest(c)) {
      if ((height > 0.0) != (side > 0)) return false;
      const double exact = (normal.x + normal.y * u + normal.z * v) / height;
      w = static_cast<float>(std::clamp(exact, static_cast<double>(least), static_cast<double>(facets.most[i])));
    }
    if (w > most_w_ || !is_nearer(w, facets.id[i], ray)) return false;
    if (is_masked(leaf, i) && is_seen_through(leaf, i, ray)) return false;
    take(ray, w, facets.id[i], {static_cast<float>(normal.x), static_cast<float>(normal.y), static_cast<float>(normal.z)},
         {1.0F, 1.0F, 1.0F});
    return true;
  }

  bool is_masked(const MeshLeaf& leaf, std::size_t i) const {
    return masks_ != nullptr && masks_->find(static_cast<std::size_t>(leaf.triangle[i])) != nullptr;
  }
  // Returns true if a ray that hits a triangle with a mask passes through it. Like the hit, this depends only on triangle and
  // ray.
  bool is_seen_through(const MeshLeaf& leaf, std::size_t i, std::size_t ray) const {
    const double u = static_cast<double>(u_.of_ray[ray]), v = static_cast<double>(v_.of_ray[ray]);
    const std::array<Corner, 3> corner = corners(leaf, i);
    std::array<double, 3> weight;  // weight[k] belongs to the corner opposite edge k
    for (std::size_t k = 0; k < 3; ++k) {
      const Corner &from = corner[k], &to = corner[(k + 1) % 3];
      weight[k] = (from.y - u * from.x) * (to.z - v * to.x) - (from.z - v * from.x) * (to.y - u * to.x);
    }
    const double sum = weight[0] + weight[1] + weight[2];
    const auto share = [&](double part) { return static_cast<float>(sum != 0.0 ? std::clamp(part / sum, 0.0, 1.0) : 1.0 / 3.0); };
    return masks_->lets_through(static_cast<std::size_t>(leaf.triangle[i]), share(weight[2]), share(weight[0]));
  }
  // Returns which of the rays in `hits`, all of one sub-tile, pass through the triangle's mask.
  HWY_NOINLINE M seen_through(const MeshLeaf& leaf, std::size_t i, std::size_t sub, Bits hits) const {
    alignas(64) float through[16] = {};
    for (; hits != 0; hits &= hits - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(hits));
      if (is_seen_through(leaf, i, 16 * sub + lane)) through[lane] = 1.0F;
    }
    return F::load(through) > 0.0F;
  }

  // Tests with crosses_exactly() if a ray hits a triangle that is not seen edge-on.
  bool hits_exactly(const Facets& facets, const MeshLeaf& leaf, std::size_t i, std::size_t ray) const {
    const int ahead = (facets.id[i] & 1) != 0 ? 1 : -1;
    return crosses_exactly(u_.of_ray[ray], v_.of_ray[ray], corners(leaf, i)) == ahead;
  }

  bool is_nearer(float w, std::int32_t id, std::size_t ray) const { return w > w_[ray] || (w == w_[ray] && id < id_[ray]); }

  void take(std::size_t ray, float w, std::int32_t id, const std::array<float, 3>& normal, const std::array<float, 3>& weight) {
    w_[ray] = w;
    id_[ray] = id;
    for (std::size_t k = 0; k < 3; ++k) {
      if (normals_) n_[k][ray] = normal[k];
      if (weights_) weight_[k][ray] = weight[k];
    }
  }

  // Returns which of a sub-tile's doubtful rays miss the triangle.
  HWY_NOINLINE M missed(const Facets& facets, const MeshLeaf& leaf, std::size_t i, std::size_t sub, Bits doubtful) const {
    alignas(64) float misses[16] = {};
    for (; doubtful != 0; doubtful &= doubtful - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(doubtful));
      if (!hits_exactly(facets, leaf, i, 16 * sub + lane)) misses[lane] = 1.0F;
    }
    return F::load(misses) > 0.0F;
  }

  // Returns the corners of a triangle in the tile's frame, rounded as in to_tile().
  std::array<Corner, 3> corners(const MeshLeaf& leaf, std::size_t i) const {
    std::array<Corner, 3> result;
    for (std::size_t k = 0; k < 3; ++k) {
      const float x = leaf.corner[k][0][i] - origin_[0], y = leaf.corner[k][1][i] - origin_[1],
                  z = leaf.corner[k][2][i] - origin_[2];
      const auto along = [&](std::size_t axis) {
        return static_cast<double>((to_tile_[axis][0] * x + to_tile_[axis][1] * y) + to_tile_[axis][2] * z);
      };
      result[k] = {along(0), along(1), along(2)};
    }
    return result;
  }

  void write() {
    // Convert whole sub-tiles in place; the values of rays without a hit are meaningless.
    const std::size_t rows = rays_.count / 16;
    for (std::size_t first = 0; first < 64 * ((rows + 3) / 4); first += 16) {
      min(1.0F / F::load(w_ + first), rays_.range).store(w_ + first);
      if (normals_) {
        const F3 normal = F3::load(n_[0] + first, n_[1] + first, n_[2] + first);
        for (int axis = 0; axis < 3; ++axis) {
          const auto& m = rays_.rotation;
          (m(axis, 0) * normal.x + (m(axis, 1) * normal.y + m(axis, 2) * normal.z)).store(n_[axis] + first);
        }
      }
      if (weights_) {
        const F a = F::load(weight_[0] + first), b = F::load(weight_[1] + first), c = F::load(weight_[2] + first);
        const F share = 1.0F / max(a + b + c, FLT_MIN);
        min(c * share, 1.0F).store(weight_[0] + first);
        min(a * share, 1.0F).store(weight_[1] + first);
      }
    }
    using F4 = WideUpTo<4>;
    using I4 = F4::Int;
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < 16; column += F4::kCount) {
        const std::size_t from = TileAxis::place(row, column), to = 16 * row + column;
        const I4 id = I4::load(id_ + from);
        const F4::Mask found = id != kNoTriangle;
        const F4 before = rays_.no_hits_yet ? F4(std::numeric_limits<float>::infinity()) : F4::load(rays_.t_hit + to);
        select(found, F4::load(w_ + from), before).store(rays_.t_hit + to);
        const I4 element_before = rays_.no_hits_yet ? I4(-1) : I4::load(rays_.element + to);
        select(found, shift_right<1>(id) + first_element_, element_before).store(rays_.element + to);
        if (details_ != nullptr) (id & 1).store(details_->back + to);
        const auto copy = [&](const float* values, float* out) HWY_ATTR { F4::load(values + from).store(out + to); };
        if (normals_) {
          copy(n_[0], details_->normal_x);
          copy(n_[1], details_->normal_y);
          copy(n_[2], details_->normal_z);
        }
        if (weights_) {
          copy(weight_[0], details_->u);
          copy(weight_[1], details_->v);
        }
      }
    }
  }

  const MeshTree& tree_;
  const std::int32_t first_element_;
  const TileAxis &u_, &v_;
  RayBundle& rays_;
  HitDetails* const details_;
  const bool normals_, weights_;  // details to write: normals, and weights of the corners
  const Masks* const masks_;
  float origin_[3];
  float to_tile_[3][3];
  float widen_;                  // m, margin of boxes
  float margin_;                 // margin in u and v
  float most_w_;                 // 1 / near; nearer hits are ignored
  float w_of_all_;               // 1 / depth of the farthest hit, or 1 / range
  float largest_u_, largest_v_;  // largest magnitudes in the tile
  Bits used_ = 0;
  alignas(64) float w_[kRays];          // 1 / depth of the hit
  alignas(64) std::int32_t id_[kRays];  // id of the hit, as in Facets
  alignas(64) float n_[3][kRays];       // normal of the hit, tile's frame
  alignas(64) float weight_[3][kRays];  // weights of the triangle's third, first and second corner at the hit
  alignas(64) float w_of_[16];          // w_of_all_ for each sub-tile
};

void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, const TileAxis& u, const TileAxis& v, RayBundle& rays,
                     HitDetails* details, AskedDetails asked, const Masks* masks) {
  TileTrace(tree, first_element, u, v, rays, details, asked, masks).trace();
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_mesh_tile);

TileAxis make_tile_axis(const float* rows) {
  TileAxis axis;
  for (std::size_t ray = 0; ray < kMaxRays; ++ray) axis.of_ray[TileAxis::place(ray / 16, ray % 16)] = rows[ray];
  for (std::size_t sub = 0; sub < 16; ++sub) {
    const auto [least, most] = std::minmax_element(axis.of_ray + 16 * sub, axis.of_ray + 16 * sub + 16);
    axis.ends[0][sub] = *least;
    axis.ends[1][sub] = *most;
  }
  axis.least_of_all = *std::min_element(axis.ends[0], axis.ends[0] + 16);
  axis.most_of_all = *std::max_element(axis.ends[1], axis.ends[1] + 16);
  return axis;
}

void trace_mesh_tile(const MeshTree& tree, std::int32_t first_element, const TileAxis& u, const TileAxis& v, RayBundle& rays,
                     HitDetails* details, AskedDetails asked, const Masks* masks) {
  HWY_DYNAMIC_DISPATCH(trace_mesh_tile)(tree, first_element, u, v, rays, details, asked, masks);
}

}  // namespace flockstep::trace
#endif
