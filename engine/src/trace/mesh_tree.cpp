#include "trace/mesh_tree.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <new>

namespace flockstep::trace {

// A node or leaf as Embree's builder leaves it, in the builder's memory.
struct MeshTree::Built {
  std::uint32_t children = 0;  // 0: a leaf
  std::uint32_t triangles = 0;
  std::array<const Built*, kTreeWidth> child;
  std::array<RTCBounds, kTreeWidth> bounds;
  std::array<std::uint32_t, kTreeWidth> triangle;
};

namespace {

constexpr unsigned int kMaxDepth = 48;
constexpr float kVisitCost = 1.0F;

}  // namespace

MeshTree::MeshTree(RTCDevice device, const TriangleMesh& mesh) : needs_weights_(!mesh.uv.empty() || !mesh.colors.empty()) {
  std::vector<RTCBuildPrimitive> primitives;
  primitives.reserve(mesh.triangles.size());
  Eigen::AlignedBox3f all;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.presence_of(i))) continue;
    Eigen::AlignedBox3f box;
    for (const std::int32_t vertex : mesh.triangles[i]) box.extend(mesh.vertices[static_cast<std::size_t>(vertex)]);
    all.extend(box);
    const Vec3 &low = box.min(), &high = box.max();
    primitives.push_back({low.x(), low.y(), low.z(), 0, high.x(), high.y(), high.z(), static_cast<unsigned int>(i)});
  }
  extent_ = std::max({all.min().cwiseAbs().maxCoeff(), all.max().cwiseAbs().maxCoeff(), all.sizes().maxCoeff()});

  struct Release {
    void operator()(RTCBVH bvh) const { rtcReleaseBVH(bvh); }
  };
  const std::unique_ptr<RTCBVHTy, Release> bvh(rtcNewBVH(device));
  if (!bvh) throw std::bad_alloc();
  RTCBuildArguments arguments = rtcDefaultBuildArguments();
  arguments.bvh = bvh.get();
  arguments.primitives = primitives.data();
  arguments.primitiveCount = arguments.primitiveArrayCapacity = primitives.size();
  arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
  arguments.maxBranchingFactor = kTreeWidth;
  arguments.maxDepth = kMaxDepth;
  // Leaves are as full as can be: sixteen triangles cost what one does.
  arguments.sahBlockSize = arguments.minLeafSize = arguments.maxLeafSize = kTreeWidth;
  arguments.traversalCost = kVisitCost;
  arguments.intersectionCost = 1.0F;
  arguments.createNode = [](RTCThreadLocalAllocator allocator, unsigned int children, void*) -> void* {
    Built* const built = new (rtcThreadLocalAlloc(allocator, sizeof(Built), alignof(Built))) Built;
    built->children = children;
    return built;
  };
  arguments.setNodeChildren = [](void* node, void** children, unsigned int count, void*) {
    for (unsigned int i = 0; i < count; ++i) static_cast<Built*>(node)->child[i] = static_cast<const Built*>(children[i]);
  };
  arguments.setNodeBounds = [](void* node, const RTCBounds** bounds, unsigned int count, void*) {
    for (unsigned int i = 0; i < count; ++i) static_cast<Built*>(node)->bounds[i] = *bounds[i];
  };
  arguments.createLeaf = [](RTCThreadLocalAllocator allocator, const RTCBuildPrimitive* triangles, std::size_t count,
                            void*) -> void* {
    Built* const built = new (rtcThreadLocalAlloc(allocator, sizeof(Built), alignof(Built))) Built;
    built->triangles = static_cast<std::uint32_t>(count);
    for (std::size_t i = 0; i < count; ++i) built->triangle[i] = triangles[i].primID;
    std::sort(built->triangle.begin(), built->triangle.begin() + count);
    return built;
  };
  const auto* const root = static_cast<const Built*>(rtcBuildBVH(&arguments));
  if (root == nullptr) throw std::bad_alloc();
  root_ = take(*root, mesh);
}

std::uint32_t MeshTree::take(const Built& built, const TriangleMesh& mesh) {
  if (built.children == 0) {
    const auto number = static_cast<std::uint32_t>(leaves_.size());
    MeshLeaf& leaf = leaves_.emplace_back();
    std::fill_n(&leaf.corner[0][0][0], 9 * kTreeWidth, std::numeric_limits<float>::quiet_NaN());
    std::fill_n(leaf.triangle, kTreeWidth, -1);
    for (std::size_t i = 0; i < built.triangles; ++i) {
      const auto& corners = mesh.triangles[built.triangle[i]];
      leaf.triangle[i] = static_cast<std::int32_t>(built.triangle[i]);
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const Vec3& at = mesh.vertices[static_cast<std::size_t>(corners[corner])];
        for (std::size_t axis = 0; axis < 3; ++axis) leaf.corner[corner][axis][i] = at[static_cast<Eigen::Index>(axis)];
      }
    }
    return number | kLeaf;
  }
  const auto number = static_cast<std::uint32_t>(nodes_.size());
  MeshNode node{};
  std::fill_n(&node.half[0][0], 3 * kTreeWidth, -1.0F);
  nodes_.push_back(node);
  for (std::size_t i = 0; i < built.children; ++i) {
    const RTCBounds& box = built.bounds[i];
    const std::array<float, 3> low{box.lower_x, box.lower_y, box.lower_z}, high{box.upper_x, box.upper_y, box.upper_z};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      node.center[axis][i] = 0.5F * low[axis] + 0.5F * high[axis];
      node.half[axis][i] = 0.5F * high[axis] - 0.5F * low[axis];
    }
    node.child[i] = take(*built.child[i], mesh);
  }
  nodes_[number] = node;
  return number;
}

}  // namespace flockstep::trace
