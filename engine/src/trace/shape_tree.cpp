#include "trace/shape_tree.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/shape_tree.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

std::uint32_t near(const ShapeTree::Node& node, const Vec3& point, float radius) {
  using F = WideOf<ShapeTree::kWidth>;
  F square = 0.0F;
  for (int axis = 0; axis < 3; ++axis) {
    const F apart = abs(F::load(node.center[axis].data()) - point[axis]);
    const F outside = max(apart - F::load(node.half[axis].data()), 0.0F);
    square = square + outside * outside;
  }
  return bits(square <= radius * radius) & ((1U << node.count) - 1U);
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {
namespace {

HWY_EXPORT(near);

// Puts two zeros between the bits of a 10-bit number: one coordinate's part of a Morton code.
std::uint32_t spread(std::uint32_t x) {
  x = (x | (x << 16)) & 0x030000FFU;
  x = (x | (x << 8)) & 0x0300F00FU;
  x = (x | (x << 4)) & 0x030C30C3U;
  return (x | (x << 2)) & 0x09249249U;
}

struct Entry {
  Aabb box;
  std::uint32_t child;
};

void put(ShapeTree::Node& node, const Entry& entry) {
  const Vec3 center = 0.5F * (entry.box.min + entry.box.max);
  const Vec3 half = (entry.box.max - center).cwiseMax(center - entry.box.min);
  for (int axis = 0; axis < 3; ++axis) {
    node.center[axis][node.count] = center[axis];
    node.half[axis][node.count] = half[axis];
  }
  node.child[node.count++] = entry.child;
}

}  // namespace

std::uint32_t ShapeTree::near(const Node& node, const Vec3& point, float radius) {
  return HWY_DYNAMIC_DISPATCH(near)(node, point, radius);
}

ShapeTree::ShapeTree(std::span<const Aabb> boxes, std::span<const std::uint32_t> numbers, std::pmr::memory_resource& memory)
    : nodes_(&memory) {
  if (boxes.empty()) return;
  std::vector<Entry> level;
  Eigen::AlignedBox3f all;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    level.push_back({boxes[i], numbers[i]});
    all.extend(boxes[i].min).extend(boxes[i].max);
  }
  if (level.size() > kWidth) {
    const auto code = [&all](const Entry& entry) {
      constexpr float kCells = 1024.0F;
      const Vec3 size = all.sizes().cwiseMax(1e-30F);
      const Vec3 cell = (kCells * (0.5F * (entry.box.min + entry.box.max) - all.min()).cwiseQuotient(size)).cwiseMin(kCells - 1);
      return spread(static_cast<std::uint32_t>(cell.x())) | (spread(static_cast<std::uint32_t>(cell.y())) << 1) |
             (spread(static_cast<std::uint32_t>(cell.z())) << 2);
    };
    std::stable_sort(level.begin(), level.end(), [&](const Entry& a, const Entry& b) { return code(a) < code(b); });
  }
  std::size_t num_nodes = 0;
  for (std::size_t size = level.size(); size > 1 || num_nodes == 0; num_nodes += size) size = (size + kWidth - 1) / kWidth;
  nodes_.reserve(num_nodes);
  for (bool leaf = true;; leaf = false) {
    std::vector<Entry> above;
    for (std::size_t first = 0; first < level.size(); first += kWidth) {
      Node& node = nodes_.emplace_back();
      node.leaf = leaf;
      Eigen::AlignedBox3f box;
      for (std::size_t i = first; i < std::min(first + kWidth, level.size()); ++i) {
        put(node, level[i]);
        box.extend(level[i].box.min).extend(level[i].box.max);
      }
      above.push_back({{box.min(), box.max()}, static_cast<std::uint32_t>(nodes_.size() - 1)});
    }
    if (above.size() == 1) return;
    level = std::move(above);
  }
}

}  // namespace flockstep::trace
#endif
