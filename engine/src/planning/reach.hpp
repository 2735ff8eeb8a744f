// Reach: finds which places a drone can reach from a given one, without a path. plan() returns a path, but needs memory for
// every cell of a world.
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

// Keeps its results between queries, so that many queries cost little more than one.
class Reach {
 public:
  // The world must outlive this object. All queried places must lie in `box`.
  Reach(const World& world, const DroneModel& drone, const Vec3& from, const Aabb& box, float cell_m);

  // Returns true if the drone, level and facing +x, can fly straight to the place; or can fly by steps of cell_m along the axes
  // on a lattice through `from` and then straight from one of the eight nodes around the place. Also returns false if the
  // search exceeds a few million nodes.
  bool includes(const Vec3& place);

 private:
  using Node = Eigen::Array<std::int64_t, 3, 1>;
  enum Part : std::uint8_t { reached, searched, closed_off };  // reached from `from`, from the queried place, or neither
  enum class Step : std::uint8_t { goes_on, met, closed };
  using Entry = std::pair<float, std::uint64_t>;  // m, distance to the other end; ties go to the lower key
  using Open = std::vector<Entry>;                // min-heap by distance

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
  std::array<Open, 2> open_;             // for reached and searched
  std::vector<std::uint64_t> searched_;  // all nodes of the part `searched`
};

}  // namespace flockstep
