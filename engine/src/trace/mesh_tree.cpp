#include "trace/mesh_tree.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <memory>
#include <new>
#include <tuple>

#include "base/platform.hpp"
#include "base/thread_sanitizer.hpp"
#include "flockstep/aligned.hpp"

namespace flockstep::trace {

// A triangle's bounding box, in the layout of Embree's builder.
struct BoxedTriangle {
  std::array<float, 3> low;
  std::uint32_t geometry;  // unused
  std::array<float, 3> high;
  std::uint32_t triangle;
};

// A node, or the triangles of a few leaves, as created by Embree's builder in its memory.
struct MeshTree::Built {
  std::span<const BoxedTriangle> triangles;  // empty for a node
};
struct MeshTree::BuiltNode : Built {
  std::size_t children = 0;
  std::array<const Built*, kTreeWidth> child;
  std::array<RTCBounds, kTreeWidth> bounds;
};

namespace {

constexpr float kVisitCost = 1.0F;

// Leaves that Embree makes are two thirds full. For many triangles that takes too much memory and cache. In that case Embree
// stops at bunches, and each bunch is cut into leaves that are all full except one. Few triangles are faster in Embree's own
// leaves, which do not span gaps between objects.
constexpr std::size_t kBunch = kTreeWidth * kTreeWidth;

std::size_t leaves_for(std::size_t triangles) { return (triangles + kTreeWidth - 1) / kTreeWidth; }

Eigen::AlignedBox3f box_of(std::span<const BoxedTriangle> triangles) {
  Eigen::AlignedBox3f box;
  for (const BoxedTriangle& triangle : triangles) box.extend(Vec3(triangle.low.data())).extend(Vec3(triangle.high.data()));
  return box;
}

void sort_along(std::size_t axis, std::span<BoxedTriangle> triangles) {
  std::sort(triangles.begin(), triangles.end(), [axis](const BoxedTriangle& a, const BoxedTriangle& b) {
    const float at_a = a.low[axis] + a.high[axis], at_b = b.low[axis] + b.high[axis];
    return at_a != at_b ? at_a < at_b : a.triangle < b.triangle;  // independent of the order left by Embree's threads
  });
}

// Estimates the cost of a box: tiles visit it in proportion to its surface, and a visit costs in proportion to its leaves.
float cost_of(const Eigen::AlignedBox3f& box, std::size_t leaves) {
  const Vec3 size = box.sizes();
  return (size.x() * size.y() + size.y() * size.z() + size.z() * size.x()) * static_cast<float>(leaves);
}

// Orders the triangles of a bunch so that every kTreeWidth of them, from the first one, make a leaf.
void cut(std::span<BoxedTriangle> triangles) {
  const std::size_t leaves = leaves_for(triangles.size());
  const auto leaf = [&](std::size_t i) {
    return triangles.subspan(kTreeWidth * i, std::min(kTreeWidth, triangles.size() - kTreeWidth * i));
  };
  if (leaves <= 1) {
    std::sort(triangles.begin(), triangles.end(),
              [](const BoxedTriangle& a, const BoxedTriangle& b) { return a.triangle < b.triangle; });
    return;
  }
  Eigen::Index longest = 0;
  box_of(triangles).sizes().maxCoeff(&longest);
  sort_along(static_cast<std::size_t>(longest), triangles);
  std::array<float, kBunch / kTreeWidth> cost_from;  // cost of the leaves from this one to the last
  Eigen::AlignedBox3f box;
  for (std::size_t i = leaves; --i > 0;) {
    box.extend(box_of(leaf(i)));
    cost_from[i] = cost_of(box, leaves - i);
  }
  box.setEmpty();
  float best = std::numeric_limits<float>::infinity();
  std::size_t best_leaf = 1;
  for (std::size_t i = 1; i < leaves; ++i) {
    box.extend(box_of(leaf(i - 1)));
    const float cost = cost_of(box, i) + cost_from[i];
    if (cost < best) std::tie(best, best_leaf) = std::tuple(cost, i);
  }
  cut(triangles.first(kTreeWidth * best_leaf));
  cut(triangles.subspan(kTreeWidth * best_leaf));
}

// In a callback of Embree: other threads of Embree have written what this one reads, and read what it writes.
class HandedOver {
 public:
  explicit HandedOver(const void* at) : at_(at) { thread_sanitizer::acquire(at_); }
  ~HandedOver() { thread_sanitizer::release(at_); }
  HandedOver(const HandedOver&) = delete;
  HandedOver& operator=(const HandedOver&) = delete;

 private:
  const void* at_;
};

}  // namespace

MeshTree::MeshTree(RTCDevice device, const TriangleMesh& mesh, std::size_t fewest_in_bunches)
    : needs_weights_(!mesh.uv.empty() || !mesh.colors.empty()) {
  static_assert(sizeof(BoxedTriangle) == sizeof(RTCBuildPrimitive));
  AlignedVector<BoxedTriangle> primitives;
  primitives.reserve(mesh.triangles.size());
  Eigen::AlignedBox3f all;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    Eigen::AlignedBox3f box;
    for (const std::int32_t vertex : mesh.triangles[i]) box.extend(mesh.vertices[static_cast<std::size_t>(vertex)]);
    all.extend(box);
    const Vec3 &low = box.min(), &high = box.max();
    primitives.push_back({{low.x(), low.y(), low.z()}, 0, {high.x(), high.y(), high.z()}, static_cast<std::uint32_t>(i)});
  }
  extent_ = std::max({all.min().cwiseAbs().maxCoeff(), all.max().cwiseAbs().maxCoeff(), all.sizes().maxCoeff()});

  struct Release {
    void operator()(RTCBVH bvh) const { rtcReleaseBVH(bvh); }
  };
  const std::unique_ptr<RTCBVHTy, Release> bvh(rtcNewBVH(device));
  if (!bvh) throw std::bad_alloc();
  struct Sizes {
    std::atomic<std::size_t> nodes = 0, leaves = 0;
  } sizes;
  RTCBuildArguments arguments = rtcDefaultBuildArguments();
  arguments.bvh = bvh.get();
  arguments.primitives = reinterpret_cast<RTCBuildPrimitive*>(primitives.data());
  arguments.primitiveCount = arguments.primitiveArrayCapacity = primitives.size();
  arguments.userPtr = &sizes;
  arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
  arguments.maxBranchingFactor = kTreeWidth;
  arguments.maxDepth = kMaxDepth - 1;   // leaves of bunches are one level deeper
  arguments.sahBlockSize = kTreeWidth;  // sixteen triangles cost the same as one
  arguments.minLeafSize = arguments.maxLeafSize = primitives.size() < fewest_in_bunches ? kTreeWidth : kBunch;
  arguments.traversalCost = kVisitCost;
  arguments.intersectionCost = 1.0F;
  arguments.createNode = [](RTCThreadLocalAllocator allocator, unsigned int children, void* user) -> void* {
    const HandedOver handed_over(user);
    ++static_cast<Sizes*>(user)->nodes;
    auto* const built = new (rtcThreadLocalAlloc(allocator, sizeof(BuiltNode), alignof(BuiltNode))) BuiltNode;
    built->children = children;
    return static_cast<Built*>(built);
  };
  arguments.setNodeChildren = [](void* node, void** children, unsigned int count, void* user) {
    const HandedOver handed_over(user);
    auto& built = static_cast<BuiltNode&>(*static_cast<Built*>(node));
    for (unsigned int i = 0; i < count; ++i) built.child[i] = static_cast<const Built*>(children[i]);
  };
  arguments.setNodeBounds = [](void* node, const RTCBounds** bounds, unsigned int count, void* user) {
    const HandedOver handed_over(user);
    auto& built = static_cast<BuiltNode&>(*static_cast<Built*>(node));
    for (unsigned int i = 0; i < count; ++i) built.bounds[i] = *bounds[i];
  };
  arguments.createLeaf = [](RTCThreadLocalAllocator allocator, const RTCBuildPrimitive* given, std::size_t count,
                            void* user) -> void* {
    const HandedOver handed_over(user);
    // The triangles are sorted in place; Embree does not need them any more.
    const std::span triangles(reinterpret_cast<BoxedTriangle*>(const_cast<RTCBuildPrimitive*>(given)), count);
    cut(triangles);
    auto& [nodes, leaves] = *static_cast<Sizes*>(user);
    leaves += leaves_for(count);
    if (leaves_for(count) > 1) ++nodes;
    return new (rtcThreadLocalAlloc(allocator, sizeof(Built), alignof(Built))) Built{triangles};
  };
  thread_sanitizer::release(&sizes);
  const auto* const root = static_cast<const Built*>(rtcBuildBVH(&arguments));
  thread_sanitizer::acquire(&sizes);
  if (root == nullptr) throw std::bad_alloc();
  nodes_.reserve(sizes.nodes);
  leaves_.reserve(sizes.leaves);
  prefer_large_pages(nodes_.data(), sizes.nodes * sizeof(MeshNode));
  prefer_large_pages(leaves_.data(), sizes.leaves * sizeof(MeshLeaf));
  root_ = take(*root, mesh);
}

std::uint32_t MeshTree::take(const Built& built, const TriangleMesh& mesh) {
  if (!built.triangles.empty()) return take(built.triangles, mesh);
  const auto& given = static_cast<const BuiltNode&>(built);
  const std::uint32_t number = add_node();
  for (std::size_t i = 0; i < given.children; ++i) {
    const RTCBounds& box = given.bounds[i];
    const std::uint32_t child = take(*given.child[i], mesh);
    set_child(number, i, {box.lower_x, box.lower_y, box.lower_z}, {box.upper_x, box.upper_y, box.upper_z}, child);
  }
  return number;
}

std::uint32_t MeshTree::take(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh) {
  const std::size_t leaves = leaves_for(triangles.size());
  if (leaves == 1) return add_leaf(triangles, mesh);
  const std::uint32_t number = add_node();
  for (std::size_t i = 0; i < leaves; ++i) {
    const auto leaf = triangles.subspan(kTreeWidth * i, std::min(kTreeWidth, triangles.size() - kTreeWidth * i));
    const Eigen::AlignedBox3f box = box_of(leaf);
    set_child(number, i, box.min(), box.max(), add_leaf(leaf, mesh));
  }
  return number;
}

std::uint32_t MeshTree::add_node() {
  MeshNode& node = nodes_.emplace_back();
  std::fill_n(&node.half[0][0], 3 * kTreeWidth, -1.0F);
  return static_cast<std::uint32_t>(nodes_.size() - 1);
}

void MeshTree::set_child(std::uint32_t number, std::size_t i, const Vec3& low, const Vec3& high, std::uint32_t child) {
  MeshNode& node = nodes_[number];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<Eigen::Index>(axis);
    node.center[axis][i] = 0.5F * low[k] + 0.5F * high[k];
    node.half[axis][i] = 0.5F * high[k] - 0.5F * low[k];
  }
  node.child[i] = child;
}

std::uint32_t MeshTree::add_leaf(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh) {
  MeshLeaf& leaf = leaves_.emplace_back();
  std::fill_n(&leaf.corner[0][0][0], 9 * kTreeWidth, std::numeric_limits<float>::quiet_NaN());
  std::fill_n(leaf.triangle, kTreeWidth, -1);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t number = triangles[i].triangle;
    leaf.triangle[i] = static_cast<std::int32_t>(number);
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const Vec3& at = mesh.vertices[static_cast<std::size_t>(mesh.triangles[number][corner])];
      for (std::size_t axis = 0; axis < 3; ++axis) leaf.corner[corner][axis][i] = at[static_cast<Eigen::Index>(axis)];
    }
  }
  return static_cast<std::uint32_t>(leaves_.size() - 1) | kLeaf;
}

}  // namespace flockstep::trace
