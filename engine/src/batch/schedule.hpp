// Schedule: the active drones sorted by world and cut into blocks of one world each, so that a block's rays share packets.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/state.hpp"

namespace flockstep {

class Schedule {
 public:
  Schedule(std::size_t num_drones, std::size_t num_worlds, std::size_t block_size);

  void rebuild(const State& state);  // after a change of world_index or active; allocates nothing

  std::size_t num_blocks() const { return blocks_.size(); }
  std::span<const std::uint32_t> drones(std::size_t block) const;

 private:
  struct Block {
    std::uint32_t first, count;  // in order_
  };
  std::size_t block_size_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> world_begin_;  // (W + 1,) in order_
  std::vector<Block> blocks_;
};

}  // namespace flockstep
