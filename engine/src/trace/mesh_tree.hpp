// MeshTree: triangles in a wide tree, for tiles of rays that share an origin. See mesh_tiles.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/world.hpp"
#include "trace/embree.hpp"
#include "world/scene_description.hpp"

namespace flockstep::trace {

inline constexpr std::size_t kTreeWidth = 16;  // children of a node, triangles of a leaf

// The boxes of up to kTreeWidth children.
struct alignas(64) MeshNode {
  float center[3][kTreeWidth];  // m, world frame
  float half[3][kTreeWidth];    // m; less than 0: no child
  std::uint32_t child[kTreeWidth];
};

// Triangles, corner by corner. Where there is none its coordinates are NaN, and so it is never in view.
struct alignas(64) MeshLeaf {
  float corner[3][3][kTreeWidth];     // m, world frame: of a corner, along an axis
  std::int32_t triangle[kTreeWidth];  // as numbered in the mesh, -1 where there is none
};

struct BoxedTriangle;

class MeshTree {
 public:
  // Of the visible triangles, of which there are some. Keeps no reference to the mesh. Throws std::bad_alloc where Embree, whose
  // builder decides what lies beside what, has no memory. From fewest_in_bunches triangles on, leaves are as full as can be.
  MeshTree(RTCDevice device, const TriangleMesh& mesh, std::size_t fewest_in_bunches = kManyTriangles);

  static bool is_leaf(std::uint32_t child) { return (child & kLeaf) != 0; }
  const MeshNode& node(std::uint32_t child) const { return nodes_[child]; }
  const MeshLeaf& leaf(std::uint32_t child) const { return leaves_[child & ~kLeaf]; }
  std::uint32_t root() const { return root_; }
  float extent() const { return extent_; }  // m: no coordinate is larger, nor is a side of the box around all
  // Whether it matters where in a triangle a ray hits: for textures, or colours of vertices.
  bool needs_weights() const { return needs_weights_; }
  std::size_t bytes() const { return nodes_.size() * sizeof(MeshNode) + leaves_.size() * sizeof(MeshLeaf); }

 private:
  struct Built;
  struct BuiltNode;
  static constexpr std::uint32_t kLeaf = 0x80000000U;

  // Each returns the number of what it adds.
  std::uint32_t take(const Built& built, const TriangleMesh& mesh);
  std::uint32_t take(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh);
  std::uint32_t add_node();
  std::uint32_t add_leaf(std::span<const BoxedTriangle> triangles, const TriangleMesh& mesh);

  void set_child(std::uint32_t number, std::size_t i, const Vec3& low, const Vec3& high, std::uint32_t child);

  std::vector<MeshNode> nodes_;
  std::vector<MeshLeaf> leaves_;
  std::uint32_t root_ = 0;
  float extent_ = 0.0F;
  bool needs_weights_;
};

}  // namespace flockstep::trace
