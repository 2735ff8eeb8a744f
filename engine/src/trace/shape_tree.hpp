// ShapeTree: finds the shapes near a point, sixteen bounding boxes at a time.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory_resource>
#include <span>
#include <vector>

#include "base/prefetch.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::trace {

// Up to 16 boxes are one node: a plain list. More are sorted along a space-filling curve and cut into nodes of 16, these into
// nodes of 16, and so on.
class ShapeTree {
 public:
  static constexpr std::size_t kWidth = 16;

  struct Node {
    alignas(64) std::array<float, kWidth> center[3];  // m
    alignas(64) std::array<float, kWidth> half[3];    // m
    std::array<std::uint32_t, kWidth> child;          // a node, or in a leaf the number of a box
    std::uint32_t count = 0;
    bool leaf = true;
  };

  // numbers: what visit() is told for each box.
  ShapeTree(std::span<const Aabb> boxes, std::span<const std::uint32_t> numbers,
            std::pmr::memory_resource& memory = *std::pmr::get_default_resource());

  bool empty() const { return nodes_.empty(); }

  // What every search begins with.
  void prefetch_parts() const {
    if (!nodes_.empty()) prefetch(&nodes_.back(), sizeof(Node));
  }

  // Calls visit(number) for each box that comes within radius (m) of the point, in an order that depends on nothing else.
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
  static constexpr std::size_t kMaxDepth = 8;  // of 16^8 boxes

  // The children of a node that come within the radius, a bit each.
  static std::uint32_t near(const Node& node, const Vec3& point, float radius);

  std::pmr::vector<Node> nodes_;  // the root is the last
};

}  // namespace flockstep::trace
