#include "batch/schedule.hpp"

#include <algorithm>

namespace flockstep {

Schedule::Schedule(std::size_t num_envs, std::size_t num_worlds, std::size_t block_size)
    : block_size_(std::min(block_size, num_envs)), order_(num_envs), world_begin_(num_worlds + 1) {
  for (auto& list : lists_) list.resize(num_envs);
  blocks_.reserve(num_envs / block_size_ + std::min(num_worlds, num_envs) + 1);
}

void Schedule::rebuild(std::span<const std::int32_t> world_index, std::span<const std::uint8_t> active) {
  // A counting sort: stable, so envs of a world stay in index order.
  std::fill(world_begin_.begin(), world_begin_.end(), 0U);
  const std::size_t num_worlds = world_begin_.size() - 1;
  for (std::size_t env = 0; env < order_.size(); ++env) {
    if (active[env]) ++world_begin_[static_cast<std::size_t>(world_index[env])];
  }
  blocks_.clear();
  const auto block_size = static_cast<std::uint32_t>(block_size_);
  std::uint32_t begin = 0;
  for (std::size_t world = 0; world < num_worlds; ++world) {
    const std::uint32_t end = begin + world_begin_[world];
    for (std::uint32_t first = begin; first < end; first += block_size) {
      const auto list = [&](std::size_t which) { return EnvList(lists_[which].data() + first); };
      blocks_.push_back(
          {std::span(order_).subspan(first, std::min(block_size, end - first)), list(0), list(1), list(2), list(3)});
    }
    world_begin_[world] = begin;  // from here on: where the world's next env goes
    begin = end;
  }
  for (std::size_t env = 0; env < order_.size(); ++env) {
    if (active[env]) order_[world_begin_[static_cast<std::size_t>(world_index[env])]++] = static_cast<std::uint32_t>(env);
  }
}

}  // namespace flockstep
