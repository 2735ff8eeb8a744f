// Lazy Theta*: A* on a grid in which a node's parent may be any node it sees, not only a neighbour, and that sight is checked
// only once a node is expanded. Source: A. Nash, S. Koenig, C. Tovey, "Lazy Theta*: any-angle path planning and path length
// analysis in 3D", AAAI 2010. Sight is the sweep of the drone's hull through the true world.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <string>
#include <utility>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "compiled/compiled_world.hpp"
#include "flockstep/scenario.hpp"

namespace flockstep {
namespace {

using Path = std::vector<Vec3>;

constexpr double kMaxCells = 1 << 25;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// The world as this drone meets it.
struct Space {
  const collision::Obstacles& obstacles;
  collision::Hull hull;

  bool is_free(const Vec3& point) const { return !collision::overlaps(obstacles, hull, Pose{.position = point}); }
  // Piece by piece, since a sweep looks at all that is in a ball about its motion.
  bool is_clear(const Vec3& from, const Vec3& to) const {
    constexpr float kPiece = 1.0F;  // m
    const int pieces = std::max(1, static_cast<int>(std::min((to - from).norm() / kPiece, 1e4F)));
    Vec3 here = from;
    for (int piece = 1; piece <= pieces; ++piece) {
      const Vec3 next =
          piece == pieces ? to : Vec3(from + (static_cast<float>(piece) / static_cast<float>(pieces)) * (to - from));
      if (collision::sweep(obstacles, hull, Pose{.position = here}, Pose{.position = next}).hit) return false;
      here = next;
    }
    return true;
  }
};

// Nodes on a lattice through the start, and one more: the goal.
class Grid {
 public:
  Grid(const Aabb& region, const Vec3& start, const Vec3& goal, float cell, bool is_flat)
      : start_(start), goal_(goal), cell_(cell) {
    double cells = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
      if (is_flat && axis == 2) continue;
      const double below = std::floor((static_cast<double>(start[axis]) - region.min[axis]) / cell);
      const double above = std::floor((static_cast<double>(region.max[axis]) - start[axis]) / cell);
      cells *= below + above + 1.0;
      if (!(cells <= kMaxCells)) {
        refuse("cell_m", "a grid of at most " + std::to_string(static_cast<int>(kMaxCells)) + " cells",
               std::to_string(cell) + " m in a world that needs more of them");
      }
      start_index_[axis] = static_cast<int>(below);
      size_[axis] = static_cast<int>(below + above) + 1;
    }
  }

  std::int32_t size() const { return size_.prod() + 1; }
  std::int32_t goal() const { return size_.prod(); }
  std::int32_t start() const { return index(start_index_); }

  Vec3 position(std::int32_t node) const {
    if (node == goal()) return goal_;
    return start_ + cell_ * (coordinates(node) - start_index_).matrix().cast<float>();
  }

  // The lattice nodes one step away along every axis, and the goal where it is as near.
  template <class Function>
  void for_each_neighbour(std::int32_t node, const Function& function) const {
    // The goal's lattice neighbours are those around the node nearest to it.
    const Eigen::Array3i center = node == goal() ? nearest(goal_) : coordinates(node);
    const Eigen::Array3i low = (center - 1).max(0);
    const Eigen::Array3i high = (center + 1).min(size_ - 1);
    for (int z = low.z(); z <= high.z(); ++z) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int x = low.x(); x <= high.x(); ++x) {
          const std::int32_t neighbour = index({x, y, z});
          if (neighbour != node) function(neighbour);
        }
      }
    }
    if (node != goal() && ((center - nearest(goal_)).abs() <= 1).all()) function(goal());
  }

 private:
  std::int32_t index(const Eigen::Array3i& c) const { return (c.z() * size_.y() + c.y()) * size_.x() + c.x(); }

  Eigen::Array3i coordinates(std::int32_t node) const {
    return {node % size_.x(), node / size_.x() % size_.y(), node / size_.x() / size_.y()};
  }

  Eigen::Array3i nearest(const Vec3& point) const {
    const Eigen::Array3f steps = ((point - start_) / cell_).array().round();
    return (start_index_ + steps.cast<int>()).max(0).min(size_ - 1);
  }

  Vec3 start_;
  Vec3 goal_;
  float cell_;
  Eigen::Array3i start_index_ = Eigen::Array3i::Zero();
  Eigen::Array3i size_ = Eigen::Array3i::Ones();
};

struct Node {
  float cost = kInfinity;    // m, from the start over the parent
  std::int32_t parent = -1;  // -1: none yet
  bool is_closed = false;    // expanded: cost and parent are final
  bool is_checked = false;   // the way from the parent is known to be clear
  bool is_known = false;     // is_free has been computed
  bool is_free = false;      // the drone fits here
};

Path trace_back(const std::vector<Node>& nodes, const Grid& grid, std::int32_t node) {
  Path path;
  for (; node != grid.start(); node = nodes[static_cast<std::size_t>(node)].parent) path.push_back(grid.position(node));
  path.push_back(grid.position(node));
  std::reverse(path.begin(), path.end());
  return path;
}

std::optional<Path> search(const Space& space, const Grid& grid) {
  std::vector<Node> nodes(static_cast<std::size_t>(grid.size()));
  const auto at = [&](std::int32_t node) -> Node& { return nodes[static_cast<std::size_t>(node)]; };
  const Vec3 goal = grid.position(grid.goal());

  using Entry = std::pair<float, std::int32_t>;  // least cost a path through this node can have; ties go to the lower index
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  const auto push = [&](std::int32_t node) { open.emplace(at(node).cost + (grid.position(node) - goal).norm(), node); };
  const auto fits = [&](std::int32_t node) {
    Node& entry = at(node);
    if (!entry.is_known) entry.is_free = space.is_free(grid.position(node));
    entry.is_known = true;
    return entry.is_free;
  };
  // Of the expanded neighbours with a clear way here, the one with the cheapest path becomes the parent.
  const auto take_parent_among_neighbours = [&](std::int32_t node, const Vec3& here) {
    Node& entry = at(node);
    entry.cost = kInfinity;
    entry.parent = -1;
    grid.for_each_neighbour(node, [&](std::int32_t neighbour) {
      if (!at(neighbour).is_closed) return;
      const Vec3 there = grid.position(neighbour);
      const float cost = at(neighbour).cost + (here - there).norm();
      if (cost >= entry.cost || !space.is_clear(there, here)) return;
      entry.cost = cost;
      entry.parent = neighbour;
    });
    entry.is_checked = entry.parent >= 0;
  };

  at(grid.start()) = Node{.cost = 0.0F, .parent = grid.start(), .is_checked = true};
  push(grid.start());
  while (!open.empty()) {
    Interrupt::poll();
    const std::int32_t node = open.top().second;
    open.pop();
    Node& entry = at(node);
    if (entry.is_closed || entry.parent < 0) continue;
    const Vec3 here = grid.position(node);
    if (!entry.is_checked) {
      if (space.is_clear(grid.position(entry.parent), here)) {
        entry.is_checked = true;
      } else {
        take_parent_among_neighbours(node, here);
        if (entry.is_checked) push(node);  // at its true cost
        continue;
      }
    }
    if (node == grid.goal()) return trace_back(nodes, grid, node);
    entry.is_closed = true;

    const Vec3 parent_position = grid.position(entry.parent);
    grid.for_each_neighbour(node, [&](std::int32_t neighbour) {
      Node& next = at(neighbour);
      if (next.is_closed || !fits(neighbour)) return;
      const float cost = at(entry.parent).cost + (grid.position(neighbour) - parent_position).norm();
      if (cost >= next.cost) return;
      next.cost = cost;
      next.parent = entry.parent;
      next.is_checked = false;
      push(neighbour);
    });
  }
  return std::nullopt;
}

// Leaves out every corner that the drone can cut.
Path without_detours(const Space& space, const Path& path) {
  Path shorter{path.front()};
  for (std::size_t i = 0; i + 1 < path.size();) {
    std::size_t next = path.size() - 1;
    while (next > i + 1 && !space.is_clear(path[i], path[next])) --next;
    shorter.push_back(path[next]);
    i = next;
  }
  return shorter;
}

// Pulls the path taut: each corner moves towards its neighbours and towards the line between them as far as it can. All three
// shorten the path; together they let a corner slide along what it touches.
void pull_taut(const Space& space, Path& path) {
  constexpr int kRounds = 4;
  constexpr float kLargestStep = 0.5F;  // of the way
  constexpr float kSmallestStep = 0.01F;
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t i = 1; i + 1 < path.size(); ++i) {
      const Vec3& before = path[i - 1];
      const Vec3& after = path[i + 1];
      const Vec3 chord = after - before;
      const float along = (path[i] - before).dot(chord) / std::max(chord.squaredNorm(), 1e-12F);
      const Vec3 foot = before + std::clamp(along, 0.0F, 1.0F) * chord;
      for (float step = kLargestStep; step > kSmallestStep; step *= 0.5F) {
        for (const Vec3& target : {foot, before, after}) {
          const Vec3 corner = path[i] + step * (target - path[i]);
          if (space.is_clear(before, corner) && space.is_clear(corner, after)) path[i] = corner;
        }
      }
    }
  }
}

// True if no obstacle can be passed above or below: a room in which all others are upright and reach from floor to ceiling. Then
// the shortest path, seen from above, is the shortest path in the plane.
bool is_full_height(const World& world) {
  constexpr float kTolerance = 1e-3F;  // m
  if (!world.triangles().triangles.empty() || world.primitives().empty()) return false;
  const Primitive& room = world.primitives().front();
  if (room.kind != PrimitiveKind::room) return false;
  return std::all_of(world.primitives().begin() + 1, world.primitives().end(), [&](const Primitive& obstacle) {
    if (!is_solid(obstacle.presence)) return true;
    const bool is_prism = obstacle.kind == PrimitiveKind::cylinder || obstacle.kind == PrimitiveKind::box;
    const Quat& q = obstacle.rotation;
    const float low = obstacle.center.z() - obstacle.half_extents.z();
    const float high = obstacle.center.z() + obstacle.half_extents.z();
    return is_prism && q.x() == 0.0F && q.y() == 0.0F && low <= room.center.z() - room.half_extents.z() + kTolerance &&
           high >= room.center.z() + room.half_extents.z() - kTolerance;
  });
}

Path shortened(const Space& space, const Path& path) {
  Path taut = without_detours(space, path);
  pull_taut(space, taut);
  return taut;
}

// Climbs or sinks evenly along a path in the plane; nullopt if something is touched on the way.
std::optional<Path> lifted(const Space& space, Path path, float goal_z) {
  const float start_z = path.front().z();
  float length = 0.0F;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).norm();
  float flown = 0.0F;
  Vec3 last = path.front();
  for (std::size_t i = 1; i < path.size(); ++i) {
    flown += (path[i] - last).norm();
    last = path[i];
    path[i].z() = i + 1 == path.size() ? goal_z : start_z + (goal_z - start_z) * (flown / length);
    if (!space.is_clear(path[i - 1], path[i])) return std::nullopt;
  }
  return path;
}

std::optional<Path> plan_leg(const Space& space, const Aabb& region, bool full_height, const Vec3& start, const Vec3& goal,
                             float cell) {
  if (!space.is_free(start) || !space.is_free(goal)) return std::nullopt;
  if (space.is_clear(start, goal)) return Path{start, goal};
  if (full_height) {
    const Vec3 goal_below(goal.x(), goal.y(), start.z());
    const std::optional<Path> flat = search(space, Grid(region, start, goal_below, cell, true));
    if (!flat) return std::nullopt;
    if (std::optional<Path> path = lifted(space, shortened(space, *flat), goal.z())) return path;
    if (std::optional<Path> path = lifted(space, *flat, goal.z())) return path;  // where shortening left it grazing something
  }
  const std::optional<Path> path = search(space, Grid(region, start, goal, cell, false));
  return path ? std::optional<Path>(shortened(space, *path)) : std::nullopt;
}

void check(const Vec3& start, std::span<const Vec3> goals, float cell_m) {
  require(start.allFinite(), "start", "finite coordinates", "one that is not");
  require(!goals.empty(), "goals", "at least one point", "none");
  for (std::size_t i = 0; i < goals.size(); ++i) {
    require(goals[i].allFinite(), "goals[" + std::to_string(i) + ']', "finite coordinates", "one that is not");
  }
  require(cell_m > 0.0F && std::isfinite(cell_m), "cell_m", "a number > 0", std::to_string(cell_m));
}

}  // namespace

std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start, std::span<const Vec3> goals,
                                      float cell_m) {
  check(start, goals, cell_m);
  const Space space{compiled(world).obstacles(), collision::Hull(drone)};
  const bool full_height = is_full_height(world);
  // Without a room around it, wide enough to fly around everything.
  const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
  const float margin = has_room ? 0.0F : 2.0F * drone.radius() + 2.0F * cell_m;
  Eigen::AlignedBox3f region(world.bounds().min.array() - margin, world.bounds().max.array() + margin);
  region.extend(start);
  for (const Vec3& goal : goals) region.extend(goal);

  Path path{start};
  for (const Vec3& goal : goals) {
    const std::optional<Path> leg = plan_leg(space, Aabb{region.min(), region.max()}, full_height, path.back(), goal, cell_m);
    if (!leg) return std::nullopt;
    path.insert(path.end(), leg->begin() + 1, leg->end());
  }
  return path;
}

}  // namespace flockstep
