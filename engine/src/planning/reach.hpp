// Reach: which places a drone can fly to from one, without saying how. plan() says how, and takes memory for every cell of a
// world.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Keeps what it has found out from place to place, so that many are asked for at little more than the cost of one.
class Reach {
 public:
  // The world outlives it. box: in which all places lie.
  Reach(const World& world, const DroneModel& drone, const Vec3& from, const Aabb& box, float cell_m);

  // True if the drone, level and facing +x, can fly to a place straight, or by straight steps of cell_m along the axes on a
  // lattice through `from`, and then straight from one of the eight nodes around the place. Says false, too, where some million
  // nodes do not suffice.
  bool includes(const Vec3& place);

 private:
  using Node = Eigen::Array<std::int64_t, 3, 1>;
  enum Part : std::uint8_t { reached, searched, closed_off };  // from the first place, from the one asked for, from neither
  enum class Step : std::uint8_t { goes_on, met, closed };
  using Entry = std::pair<float, std::uint64_t>;  // how far from the other end; ties go to the lower key
  using Open = std::vector<Entry>;                // a heap, the nearest at the top

  static std::uint64_t key_of(const Node& node);
  static Node node_of(std::uint64_t key);
  Vec3 position(const Node& node) const { return from_ + cell_ * node.matrix().cast<float>(); }
  bool is_clear(const Vec3& a, const Vec3& b) const;

  Step search(const Vec3& place);
  Step step(const Node& node, const Vec3& here, Part part, const Vec3& end);

  const collision::Obstacles& obstacles_;
  collision::Hull hull_;
  Vec3 from_;
  float cell_;  // m
  Eigen::AlignedBox3f region_;
  std::unordered_map<std::uint64_t, Part> nodes_;
  std::array<Open, 2> open_;             // of reached and searched
  std::vector<std::uint64_t> searched_;  // all nodes of this part
};

}  // namespace flockstep
