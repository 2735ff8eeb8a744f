#include "batch/schedule.hpp"

#include <algorithm>

namespace flockstep {

Schedule::Schedule(std::size_t num_drones, std::size_t num_worlds, std::size_t block_size) : block_size_(block_size) {
  order_.resize(num_drones);
  world_begin_.resize(num_worlds + 1);
  blocks_.reserve(num_drones / block_size + std::min(num_worlds, num_drones) + 1);
}

std::span<const std::uint32_t> Schedule::drones(std::size_t block) const {
  return std::span(order_).subspan(blocks_[block].first, blocks_[block].count);
}

void Schedule::rebuild(const State& state) {
  // A counting sort: stable, so drones of a world stay in index order.
  std::fill(world_begin_.begin(), world_begin_.end(), 0U);
  const std::size_t num_worlds = world_begin_.size() - 1;
  for (std::size_t i = 0; i < state.active.size(); ++i) {
    if (state.active[i]) ++world_begin_[static_cast<std::size_t>(state.world_index[i])];
  }
  blocks_.clear();
  std::uint32_t begin = 0;
  for (std::size_t world = 0; world < num_worlds; ++world) {
    const std::uint32_t end = begin + world_begin_[world];
    for (std::uint32_t first = begin; first < end; first += static_cast<std::uint32_t>(block_size_)) {
      blocks_.push_back({first, std::min(static_cast<std::uint32_t>(block_size_), end - first)});
    }
    world_begin_[world] = begin;  // from here on: where the world's next drone goes
    begin = end;
  }
  for (std::size_t i = 0; i < state.active.size(); ++i) {
    if (state.active[i]) order_[world_begin_[static_cast<std::size_t>(state.world_index[i])]++] = static_cast<std::uint32_t>(i);
  }
}

}  // namespace flockstep
