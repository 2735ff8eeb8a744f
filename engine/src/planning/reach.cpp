// Alternates between two greedy searches, one from each end. In open space they meet after a few steps. If either end lies in a
// small closed space, its search ends soon.
#include "planning/reach.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/interrupt.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

constexpr std::size_t kMaxNodes = 4'000'000;
constexpr int kNodeBits = 21;  // per coordinate of a node
constexpr std::int64_t kNodesAside = 1 << (kNodeBits - 1);

}  // namespace

Reach::Reach(const World& world, const DroneModel& drone, const Vec3& from, const Aabb& box, float cell_m)
    : obstacles_(prepared(world).obstacles()), hull_(drone), from_(from), cell_(cell_m) {
  // Without a room, the region is wide enough to fly around everything.
  const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
  const float margin = has_room ? 0.0F : 2.0F * drone.radius() + 2.0F * cell_m;
  region_ = Eigen::AlignedBox3f(world.bounds().min.array() - margin, world.bounds().max.array() + margin);
  region_.extend(from).extend(box.min).extend(box.max);
  step(Node::Zero(), from, reached, from);
}

bool Reach::includes(const Vec3& place) {
  if (is_clear(from_, place)) return true;
  const Step end = search(place);
  for (const std::uint64_t key : searched_) {
    if (end == Step::goes_on) nodes_.erase(key);  // undecided
    if (end == Step::met) nodes_[key] = reached;
    if (end == Step::closed) nodes_[key] = closed_off;
  }
  if (end == Step::met) open_[reached].insert(open_[reached].end(), open_[searched].begin(), open_[searched].end());
  searched_.clear();
  open_[searched].clear();
  return end == Step::met;
}

// Returns whether the two searches met, one of them ran out of nodes (closed), or the node limit was reached (goes_on).
Reach::Step Reach::search(const Vec3& place) {
  for (Entry& entry : open_[reached]) entry.first = (position(node_of(entry.second)) - place).norm();
  std::make_heap(open_[reached].begin(), open_[reached].end(), std::greater<>());
  const Eigen::Array3f below = ((place - from_) / cell_).array().floor();
  if (!(below.abs() < static_cast<float>(kNodesAside - 2)).all()) return Step::goes_on;
  for (int corner = 0; corner < 8; ++corner) {
    const Node node = below.cast<std::int64_t>() + Node(corner & 1, corner >> 1 & 1, corner >> 2);
    if (const Step end = step(node, place, searched, from_); end != Step::goes_on) return end;
  }
  for (Part part = reached; nodes_.size() < kMaxNodes; part = part == reached ? searched : reached) {
    Interrupt::poll();
    Open& open = open_[part];
    if (open.empty()) return Step::closed;
    std::pop_heap(open.begin(), open.end(), std::greater<>());
    const Node node = node_of(open.back().second);
    open.pop_back();
    for (int axis = 0; axis < 3; ++axis) {
      for (const std::int64_t side : {-1, 1}) {
        Node next = node;
        next[axis] += side;
        const Step end = step(next, position(node), part, part == reached ? place : from_);
        if (end != Step::goes_on) return end;
      }
    }
  }
  return Step::goes_on;
}

Reach::Step Reach::step(const Node& node, const Vec3& here, Part part, const Vec3& end) {
  const Vec3 there = position(node);
  if (!(node.abs() < kNodesAside).all() || !region_.contains(there)) return Step::goes_on;
  const std::uint64_t key = key_of(node);
  const auto known = nodes_.find(key);
  if ((known != nodes_.end() && known->second == part) || !is_clear(here, there)) return Step::goes_on;
  if (known != nodes_.end() && known->second != closed_off) return Step::met;
  if (known != nodes_.end() && part == searched) return Step::closed;
  nodes_[key] = part;
  if (part == searched) searched_.push_back(key);
  open_[part].emplace_back((there - end).norm(), key);
  std::push_heap(open_[part].begin(), open_[part].end(), std::greater<>());
  return Step::goes_on;
}

bool Reach::is_clear(const Vec3& a, const Vec3& b) const {
  return !collision::sweep(obstacles_, hull_, Pose{.position = a}, Pose{.position = b}).hit;
}

std::uint64_t Reach::key_of(const Node& node) {
  const auto bits = [](std::int64_t i) { return static_cast<std::uint64_t>(i + kNodesAside); };
  return bits(node.x()) << (2 * kNodeBits) | bits(node.y()) << kNodeBits | bits(node.z());
}

Reach::Node Reach::node_of(std::uint64_t key) {
  constexpr std::uint64_t kMask = (std::uint64_t{1} << kNodeBits) - 1;
  const auto coordinate = [](std::uint64_t bits) { return static_cast<std::int64_t>(bits & kMask) - kNodesAside; };
  return {coordinate(key >> (2 * kNodeBits)), coordinate(key >> kNodeBits), coordinate(key)};
}

}  // namespace flockstep
