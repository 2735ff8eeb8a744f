// ShapeTree: finds the shapes near a point, sixteen bounding boxes at a time.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <span>
#include <vector>

#include "base/near_memory.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::trace {

// Up to 16 boxes are one node: a plain list. More boxes are sorted along a space-filling curve and grouped into nodes of 16.
// These are grouped into nodes of 16 again, and so on.
class ShapeTree {
 public:
  static constexpr std::size_t kWidth = 16;

  struct Node {
    alignas(64) std::array<float, kWidth> center[3];  // m
    alignas(64) std::array<float, kWidth> half[3];    // m
    std::array<std::uint32_t, kWidth> child;          // index of a node, or in a leaf the number of a box
    std::uint32_t count = 0;
    bool leaf = true;
  };

  // numbers: passed to visit(), one for each box.
  ShapeTree(std::span<const Aabb> boxes, std::span<const std::uint32_t> numbers,
            std::pmr::memory_resource& memory = *std::pmr::get_default_resource());

  bool empty() const { return nodes_.empty(); }

  // Prefetches the root, where every search begins.
  void prefetch_parts() const {
    if (!nodes_.empty()) prefetch(&nodes_.back(), sizeof(Node));
  }

  // Calls visit(number) for each box within radius (m) of the point. The order depends only on the tree and the arguments.
  // Allocates nothing.
  template <class Visit>
  void for_each_near(const Vec3& point, float radius, Visit&& visit) const {
    if (nodes_.empty()) return;
    std::array<std::uint32_t, kMaxDepth * kWidth> stack;
    std::size_t size = 0;
    stack[size++] = static_cast<std::uint32_t>(nodes_.size() - 1);  // the root
    while (size > 0) {
      const Node& node = nodes_[stack[--size]];
      for (std::uint32_t bits = near(node, point, radius); bits != 0; bits &= bits - 1) {
        const std::uint32_t child = node.child[static_cast<std::size_t>(std::countr_zero(bits))];
        if (node.leaf) {
          visit(child);
        } else {
          stack[size++] = child;
        }
      }
    }
  }

 private:
  static constexpr std::size_t kMaxDepth = 8;  // enough for 16^8 boxes

  // Returns a bit for each child of the node, set if the child is within the radius.
  static std::uint32_t near(const Node& node, const Vec3& point, float radius);

  std::pmr::vector<Node> nodes_;  // the root is last
};

}  // namespace flockstep::trace
