// Two greedy searches by turns, one from each end. A small closed space ends the search soon, whichever end lies in it; in the
// open they meet after few steps.
#include "scenario/reach.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <queue>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "collision/sweep.hpp"
#include "compiled/compiled_world.hpp"

namespace flockstep {
namespace {

constexpr std::size_t kMaxNodes = 4'000'000;
constexpr int kNodeBits = 21;  // of each coordinate of a node
constexpr std::int64_t kLeastNode = -(1 << (kNodeBits - 1));

class Meeting {
 public:
  Meeting(const World& world, const DroneModel& drone, const Vec3& from, const Vec3& to, float cell)
      : obstacles_(compiled(world).obstacles()), hull_(drone), from_(from), to_(to), cell_(cell) {
    const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
    const float margin = has_room ? 0.0F : 2.0F * drone.radius() + 2.0F * cell;  // as plan() has it
    region_ = Eigen::AlignedBox3f(world.bounds().min.array() - margin, world.bounds().max.array() + margin);
    region_.extend(from).extend(to);
  }

  bool found() {
    if (is_clear(from_, to_)) return true;
    if (reach(Node::Zero(), from_, 0)) return true;
    const Eigen::Array3f steps = ((to_ - from_) / cell_).array().floor();
    if (!(steps.abs() < static_cast<float>(-kLeastNode - 2)).all()) return false;
    for (int corner = 0; corner < 8; ++corner) {
      const Node node = steps.cast<std::int64_t>() + Node(corner & 1, corner >> 1 & 1, corner >> 2);
      if (reach(node, to_, 1)) return true;
    }
    for (std::size_t side = 0; reached_.size() < kMaxNodes; side = 1 - side) {
      Interrupt::poll();
      if (open_[side].empty()) return false;
      const Node node = node_of(open_[side].top().second);
      open_[side].pop();
      const Vec3 here = position(node);
      for (int axis = 0; axis < 3; ++axis) {
        for (const std::int64_t step : {-1, 1}) {
          Node next = node;
          next[axis] += step;
          if (reach(next, here, side)) return true;
        }
      }
    }
    return false;
  }

 private:
  using Node = Eigen::Array<std::int64_t, 3, 1>;
  using Entry = std::pair<float, std::uint64_t>;  // how far from the other end; ties go to the lower key

  static std::uint64_t key_of(const Node& node) {
    const auto bits = [](std::int64_t i) { return static_cast<std::uint64_t>(i - kLeastNode); };
    return bits(node.x()) << (2 * kNodeBits) | bits(node.y()) << kNodeBits | bits(node.z());
  }
  static Node node_of(std::uint64_t key) {
    constexpr std::uint64_t kMask = (std::uint64_t{1} << kNodeBits) - 1;
    const auto coordinate = [](std::uint64_t bits) { return static_cast<std::int64_t>(bits & kMask) + kLeastNode; };
    return {coordinate(key >> (2 * kNodeBits)), coordinate(key >> kNodeBits), coordinate(key)};
  }

  Vec3 position(const Node& node) const { return from_ + cell_ * node.matrix().cast<float>(); }

  bool is_clear(const Vec3& a, const Vec3& b) const {
    return !collision::sweep(obstacles_, hull_, Pose{.position = a}, Pose{.position = b}).hit;
  }

  // Takes a step to a node; true if the other side has been there. Nodes that cannot be reached this way may be by another.
  bool reach(const Node& node, const Vec3& here, std::size_t side) {
    if (!(node.abs() < -kLeastNode).all()) return false;
    const Vec3 there = position(node);
    if (!region_.contains(there)) return false;
    const std::uint64_t key = key_of(node);
    const auto known = reached_.find(key);
    if (known != reached_.end() && known->second == side) return false;
    if (!is_clear(here, there)) return false;
    if (known != reached_.end()) return true;
    reached_.emplace(key, side);
    open_[side].emplace((there - (side == 0 ? to_ : from_)).norm(), key);
    return false;
  }

  const collision::Obstacles& obstacles_;
  collision::Hull hull_;
  Vec3 from_, to_;
  float cell_;
  Eigen::AlignedBox3f region_;
  std::unordered_map<std::uint64_t, std::size_t> reached_;  // by which side
  std::array<std::priority_queue<Entry, std::vector<Entry>, std::greater<>>, 2> open_;
};

}  // namespace

bool is_reachable(const World& world, const DroneModel& drone, const Vec3& from, const Vec3& to, float cell_m) {
  return Meeting(world, drone, from, to, cell_m).found();
}

}  // namespace flockstep
