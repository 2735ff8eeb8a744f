#include "planning/lattice.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "base/interrupt.hpp"
#include "base/require.hpp"

namespace flockstep {
namespace {

constexpr double kMaxBlocks = 1 << 25;
constexpr std::size_t kListThreshold = 1000;  // obstacles per cell; above this, each sweep queries those near its motion

struct CellsAside {
  Eigen::Array3d below = Eigen::Array3d::Zero();  // cells from the start to the region's lower end
  Eigen::Array3d above = Eigen::Array3d::Zero();
};

CellsAside extent_of(const Aabb& region, const Vec3& start, float cell, bool is_flat) {
  CellsAside extent;
  for (int axis = 0; axis < (is_flat ? 2 : 3); ++axis) {
    extent.below[axis] = std::floor((static_cast<double>(start[axis]) - static_cast<double>(region.min[axis])) / cell);
    extent.above[axis] = std::floor((static_cast<double>(region.max[axis]) - static_cast<double>(start[axis])) / cell);
  }
  return extent;
}

[[noreturn]] void refuse_cells(float cell) {
  refuse(
      "cell_m",
      "a spacing at which a search of " + std::to_string(Lattice::kMaxCells) + " cells is enough to find a path or rule it out",
      std::to_string(cell) + " m, which needs more cells");
}

}  // namespace

// Obstacles that may touch the drone in a block, and lists of them. Each list follows the list of the larger box that it was
// filtered from.
struct Lattice::Filling {
  std::vector<collision::Convex> obstacles;
  std::vector<std::uint32_t> lists;
};

double Lattice::count(const Aabb& region, const Vec3& start, float cell, bool is_flat) {
  const CellsAside extent = extent_of(region, start, cell, is_flat);
  return (extent.below + extent.above + 1.0).prod();
}

bool Lattice::fits(const Aabb& region, const Vec3& start, float cell, bool is_flat) {
  const CellsAside extent = extent_of(region, start, cell, is_flat);
  return ((extent.below + extent.above + 1.0) / kAside).ceil().prod() <= kMaxBlocks;
}

Lattice::Lattice(const FreeSpace& space, const Aabb& region, const Vec3& start, const Vec3& goal, float cell, bool is_flat)
    : space_(space), origin_(start), goal_(goal), cell_(cell) {
  const CellsAside extent = extent_of(region, start, cell, is_flat);
  if (!fits(region, start, cell, is_flat)) refuse_cells(cell);
  start_ = extent.below.cast<int>();
  size_ = (extent.below + extent.above).cast<int>() + 1;
  goal_cell_ = (start_ + ((goal - start) / cell).array().round().cast<int>()).max(0).min(size_ - 1);
  blocks_aside_ = (size_ + kAside - 1) / kAside;
  numbers_.assign(static_cast<std::size_t>(blocks_aside_.cast<std::int64_t>().prod()), -1);
}

Vec3 Lattice::position(std::int32_t node) const {
  return node == kGoal ? goal_ : Vec3(origin_ + cell_ * (cell_of(node) - start_).matrix().cast<float>());
}

Lattice::Cell Lattice::cell_of(std::int32_t node) const {
  const auto i = static_cast<int>(static_cast<std::size_t>(node - 1) % kCells);
  return blocks_[block_of(node)]->first + Cell(i % kAside, i / kAside % kAside, i / kAside / kAside);
}

std::int32_t Lattice::node_of(const Cell& cell) {
  const Cell place = cell / kAside;
  const auto aside = blocks_aside_.cast<std::size_t>();
  const std::size_t x = static_cast<std::size_t>(place.x()), y = static_cast<std::size_t>(place.y());
  std::int32_t& number = numbers_[(static_cast<std::size_t>(place.z()) * aside.y() + y) * aside.x() + x];
  if (number < 0) {
    if (blocks_.size() * kCells >= kMaxCells) refuse_cells(cell_);
    Interrupt::poll();
    auto block = std::make_unique<Block>();
    block->first = place * kAside;
    fill(*block);
    blocks_.push_back(std::move(block));
    number = static_cast<std::int32_t>(blocks_.size() - 1);
  }
  return 1 + number * static_cast<std::int32_t>(kCells) + static_cast<std::int32_t>(index_in_block(cell - place * kAside));
}

// Tests the whole block first, then its eighths, and so on. A smaller box tests only the obstacles that are not apart from the
// larger one.
void Lattice::fill(Block& block) const {
  const FreeSpace::Box whole = box_of(block.first, kAside);
  Filling filling;
  space_.obstacles().for_each_near(whole.center.cast<float>(), space_.reach(whole), [&](std::uint32_t element) {
    filling.lists.push_back(static_cast<std::uint32_t>(filling.obstacles.size()));
    filling.obstacles.push_back(space_.obstacles().convex(element));
    block.obstacles.push_back(space_.obstacle(element, filling.obstacles.back()));
  });
  open_cells(block, block.first, kAside, 0, filling);
}

FreeSpace::Box Lattice::box_of(const Cell& first, int aside) const {
  const double half = 0.5 * static_cast<double>(cell_) * aside;
  const Eigen::Array3d middle = (first - start_).cast<double>() + 0.5 * (aside - 1);
  return {origin_.cast<double>() + static_cast<double>(cell_) * middle.matrix(), half};
}

// `begin` is the start of the list of obstacles that are not apart from the next larger box; it extends to the end of the
// lists.
void Lattice::open_cells(Block& block, const Cell& first, int aside, std::size_t begin, Filling& filling) const {
  const FreeSpace::Box box = box_of(first, aside);
  const std::size_t end = filling.lists.size();
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint32_t obstacle = filling.lists[i];
    if (!space_.is_apart(block.obstacles[obstacle], filling.obstacles[obstacle], box)) filling.lists.push_back(obstacle);
  }
  const std::size_t count = filling.lists.size() - end;
  const Cell low = first - block.first;
  if (count == 0 && space_.is_apart_from_walls(box)) {
    for (int z = low.z(); z < low.z() + aside; ++z) {
      for (int y = low.y(); y < low.y() + aside; ++y) {
        for (int x = low.x(); x < low.x() + aside; ++x) block.near[index_in_block({x, y, z})].kind = Near::Kind::none;
      }
    }
  } else if (aside > 1) {
    const int half = aside / 2;
    for (int corner = 0; corner < 8; ++corner) {
      open_cells(block, first + half * Cell(corner & 1, corner >> 1 & 1, corner >> 2), half, end, filling);
    }
  } else if (count <= kListThreshold) {
    block.near[index_in_block(low)] = {Near::Kind::few, static_cast<std::uint32_t>(block.lists.size()),
                                       static_cast<std::uint32_t>(count)};
    block.lists.insert(block.lists.end(), filling.lists.begin() + static_cast<std::ptrdiff_t>(end), filling.lists.end());
  }
  filling.lists.resize(end);
}

bool Lattice::is_clear_in(const Cell& cell, const Vec3& from, const Vec3& to) {
  if (!((cell >= 0).all() && (cell < size_).all())) return space_.is_clear(from, to);
  const std::int32_t node = node_of(cell);
  const Block& block = *blocks_[block_of(node)];
  const Near& near = block.near[static_cast<std::size_t>(node - 1) % kCells];
  if (near.kind == Near::Kind::none) return true;
  if (near.kind == Near::Kind::many) return space_.is_clear(from, to);
  touchable_.clear();
  const Vec3 low = from.cwiseMin(to), high = from.cwiseMax(to);
  for (std::uint32_t i = near.begin; i < near.begin + near.count; ++i) {
    const FreeSpace::Obstacle& obstacle = block.obstacles[block.lists[i]];
    if ((low.array() > obstacle.taken.max.array()).any() || (high.array() < obstacle.taken.min.array()).any()) continue;
    touchable_.push_back(obstacle.element);
  }
  return space_.is_clear(from, to, touchable_);
}

bool Lattice::is_clear(const Vec3& from, const Vec3& to) {
  // Units are cells; cell i spans i to i + 1.
  const Eigen::Array3d begin = (from - origin_).cast<double>().array() / cell_ + start_.cast<double>() + 0.5;
  const Eigen::Array3d along = (to - from).cast<double>().array() / cell_;
  Cell cell = begin.floor().cast<int>();
  const Cell step = along.sign().cast<int>();
  Eigen::Array3d crossing;  // time at which the motion enters the next cell along each axis
  for (int axis = 0; axis < 3; ++axis) {
    const double border = cell[axis] + (step[axis] > 0 ? 1 : 0);
    crossing[axis] = step[axis] == 0 ? std::numeric_limits<double>::infinity() : (border - begin[axis]) / along[axis];
  }
  Vec3 here = from;
  for (double time = 0.0;;) {
    int axis = 0;
    const double next = std::max(time, crossing.minCoeff(&axis));
    if (!(next < 1.0)) return is_clear_in(cell, here, to);
    if (next > time || time == 0.0) {
      const Vec3 there = from + static_cast<float>(next) * (to - from);
      if (!is_clear_in(cell, here, there)) return false;
      here = there;
      time = next;
    }
    cell[axis] += step[axis];
    crossing[axis] += std::abs(1.0 / along[axis]);
  }
}

}  // namespace flockstep
