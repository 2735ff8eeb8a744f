// Lazy Theta*: A* on a grid in which a node's parent may be any node with a clear straight motion to it, not only a neighbour.
// That motion is checked only when the node is expanded. A motion is clear if a sweep of the drone's hull through the exact
// world hits nothing. Source: A. Nash, S. Koenig, C. Tovey, "Lazy Theta*: any-angle path planning and path length analysis in
// 3D", AAAI 2010.
//
// Grids are searched from coarse to fine. A coarse grid finds the right corridor at a fraction of the cost. Pulling the path
// taut makes up for the large cells. Once there is a path, a finer grid is searched only for a shorter path, and only if that
// search is small.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <queue>
#include <string>
#include <utility>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/planning.hpp"
#include "planning/free_space.hpp"
#include "planning/lattice.hpp"

namespace flockstep {
namespace {

using Polyline = std::vector<Vec3>;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kCoarsest = 1 << 14;        // minimum number of cells of the coarsest grid
constexpr double kMaxBetter = 1 << 18;       // maximum number of cells in a search for a shorter path
constexpr std::size_t kMaxAtGoal = 1 << 15;  // maximum number of nodes in the search for an exit from the goal
constexpr float kStraightEnough = 1.01F;     // stop once the path is at most this multiple of the straight distance
constexpr float kWorthIt = 0.995F;           // a new path must be shorter than this multiple of the current length

double length_of(const Polyline& path) {
  double length = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).cast<double>().norm();
  return length;
}

// Reports the progress of the searches towards the goals.
class Reporter {
 public:
  Reporter(const Progress& progress, std::size_t legs) : progress_(progress), legs_(static_cast<double>(legs)) {}

  // Call this for each visited node. `share_left` is the node's straight distance to the goal divided by that of the start.
  void visit(float share_left) {
    Interrupt::poll();
    within_leg_ = std::max(within_leg_, 1.0 - static_cast<double>(share_left));
    if (progress_ && ++visited_ % kPause == 0) progress_((leg_ + within_leg_) / legs_);
  }
  void end_leg() {
    leg_ += 1.0;
    within_leg_ = 0.0;
  }

 private:
  static constexpr std::size_t kPause = 256;  // visits
  const Progress& progress_;
  double legs_;
  double leg_ = 0.0;
  double within_leg_ = 0.0;
  std::size_t visited_ = 0;
};

// A search on one lattice. It returns a path, or nothing if there is no path shorter than `bound` (m).
class Search {
 public:
  Search(Lattice& lattice, float bound, Reporter& reporter) : lattice_(lattice), bound_(bound), reporter_(reporter) {}

  std::optional<Polyline> run() { return run(lattice_.start(), Lattice::kGoal, std::numeric_limits<std::size_t>::max()); }

  // Returns true if the goal lies in a small closed space: a search from the goal runs out of nodes early.
  bool is_goal_shut_in() {
    const bool is_found = run(Lattice::kGoal, lattice_.start(), kMaxAtGoal).has_value();
    return !is_found && open_.empty();
  }

 private:
  using Entry = std::pair<float, std::int32_t>;  // least path length through this node; ties go to the lower index

  std::optional<Polyline> run(std::int32_t start, std::int32_t end, std::size_t most) {
    end_ = lattice_.position(end);
    lattice_.at(start) = {.cost = 0.0F, .parent = start, .is_checked = true};
    push(start);
    const float straight = std::max((lattice_.position(start) - end_).norm(), std::numeric_limits<float>::min());
    for (std::size_t expanded = 0; !open_.empty() && expanded < most;) {
      const std::int32_t node = open_.top().second;
      open_.pop();
      Lattice::Node& entry = lattice_.at(node);
      if (entry.is_closed || entry.parent < 0) continue;
      const Vec3 here = lattice_.position(node);
      reporter_.visit(end == Lattice::kGoal ? (here - end_).norm() / straight : 1.0F);
      if (!entry.is_checked && !check(node, here)) continue;
      if (node == end) return trace_back(start, end);
      entry.is_closed = true;
      ++expanded;
      const std::int32_t parent = entry.parent;
      const Vec3 parent_position = lattice_.position(parent);
      const float parent_cost = lattice_.at(parent).cost;
      lattice_.for_each_neighbour(node, [&](std::int32_t neighbour) {
        Lattice::Node& next = lattice_.at(neighbour);
        if (next.is_closed) return;
        const float cost = parent_cost + (lattice_.position(neighbour) - parent_position).norm();
        if (cost >= next.cost) return;
        next.cost = cost;
        next.parent = parent;
        next.is_checked = false;
        push(neighbour);
      });
    }
    return std::nullopt;
  }

  void push(std::int32_t node) {
    const float least = lattice_.at(node).cost + (lattice_.position(node) - end_).norm();
    if (least < bound_) open_.emplace(least, node);
  }

  // Returns true if the motion from the parent is clear. Otherwise the node gets another parent and is queued again, or is
  // closed if the drone does not fit there.
  bool check(std::int32_t node, const Vec3& here) {
    Lattice::Node& entry = lattice_.at(node);
    if (node != Lattice::kGoal && !lattice_.is_clear(here, here)) {
      entry.is_closed = true;
      entry.parent = -1;
      return false;
    }
    if (lattice_.is_clear(lattice_.position(entry.parent), here)) {
      entry.is_checked = true;
      return true;
    }
    // The new parent is the expanded neighbour with the shortest path among those with a clear motion to this node.
    std::array<Entry, 27> candidates;
    std::size_t count = 0;
    lattice_.for_each_neighbour(node, [&](std::int32_t neighbour) {
      const Lattice::Node& from = lattice_.at(neighbour);
      if (!from.is_closed || from.parent < 0) return;
      candidates[count++] = {from.cost + (here - lattice_.position(neighbour)).norm(), neighbour};
    });
    std::sort(candidates.begin(), candidates.begin() + count);
    entry.cost = kInfinity;
    entry.parent = -1;
    for (std::size_t i = 0; i < count; ++i) {
      const auto& [cost, neighbour] = candidates[i];
      if (!lattice_.is_clear(lattice_.position(neighbour), here)) continue;
      entry.cost = cost;
      entry.parent = neighbour;
      entry.is_checked = true;
      push(node);
      break;
    }
    return false;
  }

  Polyline trace_back(std::int32_t start, std::int32_t end) {
    Polyline path;
    std::int32_t node = end;
    for (; node != start; node = lattice_.at(node).parent) path.push_back(lattice_.position(node));
    path.push_back(lattice_.position(node));
    std::reverse(path.begin(), path.end());
    return path;
  }

  Lattice& lattice_;
  float bound_;  // m
  Vec3 end_ = Vec3::Zero();
  Reporter& reporter_;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open_;
};

// Removes every corner that the drone can cut.
Polyline without_detours(Lattice& lattice, const Polyline& path) {
  Polyline shorter{path.front()};
  for (std::size_t i = 0; i + 1 < path.size();) {
    std::size_t next = path.size() - 1;
    while (next > i + 1 && !lattice.is_clear(path[i], path[next])) --next;
    shorter.push_back(path[next]);
    i = next;
  }
  return shorter;
}

// Pulls the path taut: each corner moves as far as possible towards its two neighbours and towards the line between them. Each
// of the three moves shortens the path; together they let a corner slide along an obstacle.
void pull_taut(Lattice& lattice, Polyline& path) {
  constexpr int kRounds = 4;
  constexpr float kLargestStep = 0.5F;  // fraction of the way
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
          if (lattice.is_clear(before, corner) && lattice.is_clear(corner, after)) path[i] = corner;
        }
      }
    }
  }
}

// Returns true if no obstacle can be passed above or below. This is so if the world is a room in which all obstacles are
// upright and reach from floor to ceiling. Then the shortest path, seen from above, is the shortest path in the plane.
bool is_full_height(const World& world) {
  constexpr float kTolerance = 1e-3F;  // m
  if (!world.triangles().triangles.empty() || world.primitives().empty()) return false;
  const Primitive& room = world.primitives().front();
  if (room.kind != PrimitiveKind::room) return false;
  return std::all_of(world.primitives().begin() + 1, world.primitives().end(), [&](const Primitive& obstacle) {
    if (!is_solid(obstacle.visibility)) return true;
    const bool is_prism = obstacle.kind == PrimitiveKind::cylinder || obstacle.kind == PrimitiveKind::box;
    const Quat& q = obstacle.rotation;
    const float low = obstacle.center.z() - obstacle.half_extents.z();
    const float high = obstacle.center.z() + obstacle.half_extents.z();
    return is_prism && q.x() == 0.0F && q.y() == 0.0F && low <= room.center.z() - room.half_extents.z() + kTolerance &&
           high >= room.center.z() + room.half_extents.z() - kTolerance;
  });
}

Polyline shortened(Lattice& lattice, const Polyline& path) {
  Polyline taut = without_detours(lattice, path);
  pull_taut(lattice, taut);
  return taut;
}

// Adds an even climb or descent to a path in the plane; nullopt if the drone then touches something.
std::optional<Polyline> lifted(const FreeSpace& space, Polyline path, float goal_z) {
  const float start_z = path.front().z();
  const auto length = static_cast<float>(length_of(path));
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

// Splits a leg until the drone can fly each part in one clear sweep. The planner has already swept shorter parts of the leg and
// found them clear.
void add_leg(const FreeSpace& space, Polyline& path, const Vec3& to, int cuts = 10) {
  const Vec3 from = path.back();
  if (cuts > 0 && !space.is_free_leg(from, to)) {
    add_leg(space, path, 0.5F * (from + to), cuts - 1);
    add_leg(space, path, to, cuts - 1);
  } else {
    path.push_back(to);
  }
}

// Estimates how many lattice cells the paths of at most this length can reach. These cells lie in the region and in an
// ellipsoid whose foci are start and goal.
double cells_within(const Aabb& region, const Vec3& start, const Vec3& goal, double length, double cell, bool is_flat) {
  const double straight = static_cast<double>((goal - start).norm());
  const double half_width = 0.5 * std::sqrt(std::max(length * length - straight * straight, 0.0));
  const Eigen::Vector3d size = (region.max - region.min).cast<double>();
  const double area = std::min(std::numbers::pi * 0.5 * length * half_width, size.x() * size.y());
  if (is_flat) return area / (cell * cell);
  return std::min(4.0 / 3.0 * std::numbers::pi * 0.5 * length * half_width * half_width, area * size.z()) / (cell * cell * cell);
}

// Searches on grids from coarse to fine.
std::optional<Polyline> search(const FreeSpace& space, const Aabb& region, const Vec3& start, const Vec3& goal, float finest,
                               bool is_flat, Reporter& reporter) {
  float cell = finest;
  while (Lattice::count(region, start, 2.0F * cell, is_flat) >= kCoarsest) cell *= 2.0F;
  std::optional<Polyline> best;
  float bound = kInfinity;
  bool is_first = true;
  for (; cell >= 0.75F * finest; cell *= 0.5F) {
    if (best && cells_within(region, start, goal, bound, cell, is_flat) > kMaxBetter) break;
    Lattice lattice(space, region, start, goal, cell, is_flat);
    const std::optional<Polyline> found = Search(lattice, bound, reporter).run();
    if (!found && is_first && cell > finest &&
        Lattice::fits(region, start, finest, is_flat)) {  // avoids searching finer grids in vain
      Lattice fine(space, region, start, goal, finest, is_flat);
      if (Search(fine, kInfinity, reporter).is_goal_shut_in()) return std::nullopt;
    }
    is_first = false;
    if (!found) continue;
    Polyline taut = shortened(lattice, *found);
    const auto length = static_cast<float>(length_of(taut));
    if (length < bound) best = std::move(taut);
    bound = std::min(bound, kWorthIt * length);
    if (length < kStraightEnough * (goal - start).norm()) break;
  }
  return best;
}

std::optional<Polyline> plan_leg(const FreeSpace& space, const Aabb& region, bool full_height, const Vec3& start,
                                 const Vec3& goal, float cell, Reporter& reporter) {
  if (!space.is_free(start) || !space.is_free(goal)) return std::nullopt;
  if (space.is_clear(start, goal)) return Polyline{start, goal};
  if (full_height) {
    const Vec3 goal_below(goal.x(), goal.y(), start.z());
    const std::optional<Polyline> flat = search(space, region, start, goal_below, cell, true, reporter);
    if (!flat) return std::nullopt;
    if (std::optional<Polyline> path = lifted(space, *flat, goal.z())) return path;
  }
  return search(space, region, start, goal, cell, false, reporter);
}

void check(const Vec3& start, std::span<const Vec3> goals, float cell_m) {
  require(start.allFinite(), "start", "finite coordinates", "NaN or infinity");
  require(!goals.empty(), "goals", "at least one point", "none");
  for (std::size_t i = 0; i < goals.size(); ++i) {
    require(goals[i].allFinite(), "goals[" + std::to_string(i) + ']', "finite coordinates", "NaN or infinity");
  }
  require(cell_m > 0.0F && std::isfinite(cell_m), "cell_m", "a number > 0", std::to_string(cell_m));
}

}  // namespace

std::optional<std::vector<Vec3>> plan(const World& world, const DroneModel& drone, const Vec3& start, std::span<const Vec3> goals,
                                      float cell_m, const Progress& progress) {
  check(start, goals, cell_m);
  const FreeSpace space(world, drone);
  const bool full_height = is_full_height(world);
  // Without a room, the region is wide enough to fly around everything.
  const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
  const float margin = has_room ? 0.0F : 2.0F * drone.radius() + 2.0F * cell_m;
  Eigen::AlignedBox3f region(world.bounds().min.array() - margin, world.bounds().max.array() + margin);
  region.extend(start);
  for (const Vec3& goal : goals) region.extend(goal);

  Reporter reporter(progress, goals.size());
  Polyline path{start};
  for (const Vec3& goal : goals) {
    const std::optional<Polyline> leg =
        plan_leg(space, Aabb{region.min(), region.max()}, full_height, path.back(), goal, cell_m, reporter);
    if (!leg) return std::nullopt;
    reporter.end_leg();
    for (std::size_t i = 1; i < leg->size(); ++i) add_leg(space, path, (*leg)[i]);
  }
  return path;
}

}  // namespace flockstep
