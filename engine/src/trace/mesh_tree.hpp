// MeshTree: a wide tree of triangles, for rays that share an origin. See mesh_tiles.hpp and mesh_slices.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/near_memory.hpp"
#include "flockstep/world.hpp"
#include "trace/embree.hpp"
#include "world/scene_description.hpp"

namespace flockstep::trace {

inline constexpr std::size_t kTreeWidth = 16;  // children of a node, triangles of a leaf

// The bounding boxes of up to kTreeWidth children.
struct alignas(64) MeshNode {
  float center[3][kTreeWidth];  // m, world frame
  float half[3][kTreeWidth];    // m; less than 0 for an unused slot
  std::uint32_t child[kTreeWidth];
};

// Triangles, corner by corner. The coordinates of unused slots are NaN, so these are never in view.
struct alignas(64) MeshLeaf {
  float corner[3][3][kTreeWidth];     // m, world frame; by corner and axis
  std::int32_t triangle[kTreeWidth];  // number in the mesh, -1 for an unused slot
};

struct BoxedTriangle;

class MeshTree {
 public:
  static constexpr unsigned int kMaxDepth = 49;  // nodes from the root to a leaf

  // Builds the tree of the visible triangles, of which there must be at least one. Embree's builder decides which triangles are
  // grouped. With at least fewest_in_bunches triangles, leaves are as full as possible. Keeps no reference to the mesh. Throws
  // std::bad_alloc if Embree runs out of memory.
  MeshTree(RTCDevice device, const TriangleMesh& mesh, std::size_t fewest_in_bunches = kManyTriangles);

  static bool is_leaf(std::uint32_t child) { return (child & kLeaf) != 0; }
  const MeshNode& node(std::uint32_t child) const { return nodes_[child]; }
  const MeshLeaf& leaf(std::uint32_t child) const { return leaves_[child & ~kLeaf]; }
  // Prefetches a child, since large trees do not fit into the nearest caches.
  void fetch(std::uint32_t child) const {
    is_leaf(child) ? prefetch(&leaf(child), sizeof(MeshLeaf)) : prefetch(&node(child), sizeof(MeshNode));
  }
  std::uint32_t root() const { return root_; }
  // Returns a length (m) that exceeds the rounding error of a box or a hit in a frame at the origin.
  float rounding(const Vec3& origin) const { return kRounding * (extent_ + origin.cwiseAbs().maxCoeff()); }
  // Returns true if the position of a hit in its triangle matters: for textures or vertex colours.
  bool needs_weights() const { return needs_weights_; }
  std::size_t bytes() const { return nodes_.size() * sizeof(MeshNode) + leaves_.size() * sizeof(MeshLeaf); }

 private:
  struct Built;
  struct BuiltNode;
  static constexpr std::uint32_t kLeaf = 0x80000000U;
  static constexpr float kRounding = 0x1p-17F;  // relative to the largest coordinate

  // Each adds a node or leaf and returns its number.
  std::uint32_t take(const Built& built, const TriangleMesh& mesh);
  std::uint32_t take(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh);
  std::uint32_t add_node();
  std::uint32_t add_leaf(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh);

  void set_child(std::uint32_t number, std::size_t i, const Vec3& low, const Vec3& high, std::uint32_t child);

  std::vector<MeshNode> nodes_;
  std::vector<MeshLeaf> leaves_;
  std::uint32_t root_ = 0;
  float extent_ = 0.0F;  // m; no coordinate and no side of the overall bounding box is larger
  bool needs_weights_;
};

}  // namespace flockstep::trace
