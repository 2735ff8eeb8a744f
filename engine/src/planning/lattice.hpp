// Lattice: the grid of one planner search. It has positions at multiples of a cell size around the start, and records which
// cells are open.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "planning/free_space.hpp"

namespace flockstep {

// Memory is allocated in blocks of cells as the search reaches them. A cell is open if the drone fits at every position in it,
// so a straight motion through open cells needs no sweep. For other cells, the obstacles near enough to be touched are stored.
class Lattice {
 public:
  using Cell = Eigen::Array3i;

  struct Node {
    float cost = std::numeric_limits<float>::infinity();  // m, path length from the start through the parent
    std::int32_t parent = -1;                             // -1: none yet
    bool is_closed = false;                               // final: expanded, or the drone does not fit
    bool is_checked = false;                              // the motion from the parent is known to be clear
  };

  static constexpr std::int32_t kGoal = 0;  // the only node that may be off the lattice
  static constexpr std::size_t kMaxCells = 1 << 25;

  // With is_flat there is one layer, at the height of the start. Throws std::invalid_argument if the cells are too small for
  // the region; so does a search that reaches more than kMaxCells.
  Lattice(const FreeSpace& space, const Aabb& region, const Vec3& start, const Vec3& goal, float cell, bool is_flat);

  // Returns the number of cells that a lattice would have.
  static double count(const Aabb& region, const Vec3& start, float cell, bool is_flat);
  // Returns whether a lattice with these cells is possible. The constructor throws if it is not.
  static bool fits(const Aabb& region, const Vec3& start, float cell, bool is_flat);

  std::int32_t start() { return node_of(start_); }
  Node& at(std::int32_t node) {
    return node == kGoal ? goal_node_ : blocks_[block_of(node)]->nodes[static_cast<std::size_t>(node - 1) % kCells];
  }
  Vec3 position(std::int32_t node) const;

  // Returns true if the drone can fly straight from one place to the other. If they are equal, returns whether the drone fits
  // there.
  bool is_clear(const Vec3& from, const Vec3& to);

  // Calls visit(node) for the nodes at most one step away along every axis, and for the goal if it is as close.
  template <class Visit>
  void for_each_neighbour(std::int32_t node, const Visit& visit) {
    const Cell center = node == kGoal ? goal_cell_ : cell_of(node);
    const Cell low = (center - 1).max(0);
    const Cell high = (center + 1).min(size_ - 1);
    for (int z = low.z(); z <= high.z(); ++z) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int x = low.x(); x <= high.x(); ++x) {
          const std::int32_t neighbour = node_of({x, y, z});
          if (neighbour != node) visit(neighbour);
        }
      }
    }
    if (node != kGoal && ((center - goal_cell_).abs() <= 1).all()) visit(kGoal);
  }

 private:
  static constexpr int kAside = 8;  // cells of a block along each axis
  static constexpr std::size_t kCells = kAside * kAside * kAside;

  // The obstacles that the drone can touch in a cell: none if it is open; many if too many to list; otherwise a range of the
  // block's lists.
  struct Near {
    enum class Kind : std::uint8_t { none, few, many };
    Kind kind = Kind::many;
    std::uint32_t begin = 0;
    std::uint32_t count = 0;
  };
  struct Block {
    Cell first;
    std::array<Node, kCells> nodes;
    std::array<Near, kCells> near;
    std::vector<FreeSpace::Obstacle> obstacles;  // near the block
    std::vector<std::uint32_t> lists;            // indices of obstacles, cell by cell
  };
  struct Filling;

  static std::size_t block_of(std::int32_t node) { return static_cast<std::size_t>(node - 1) / kCells; }
  static std::size_t index_in_block(const Cell& c) { return static_cast<std::size_t>((c.z() * kAside + c.y()) * kAside + c.x()); }

  std::int32_t node_of(const Cell& cell);
  Cell cell_of(std::int32_t node) const;
  void fill(Block& block) const;
  bool is_clear_in(const Cell& cell, const Vec3& from, const Vec3& to);
  FreeSpace::Box box_of(const Cell& first, int aside) const;  // box of a cube of cells
  void open_cells(Block& block, const Cell& first, int aside, std::size_t begin, Filling& filling) const;

  const FreeSpace& space_;
  Vec3 origin_;  // m, start position
  Vec3 goal_;    // m
  float cell_;   // m
  Cell start_ = Cell::Zero();
  Cell size_ = Cell::Ones();
  Cell goal_cell_ = Cell::Zero();  // cell nearest to the goal
  Cell blocks_aside_;
  std::vector<std::int32_t> numbers_;  // block numbers by position; -1: not allocated
  std::vector<std::unique_ptr<Block>> blocks_;
  Node goal_node_;
  std::vector<std::uint32_t> touchable_;  // scratch: elements
};

}  // namespace flockstep
