#include "batch/schedule.hpp"

#include <algorithm>
#include <utility>

#include "base/indices.hpp"

namespace flockstep {
namespace {

std::size_t good_block_size(std::size_t num_envs, std::size_t num_threads) {
  return std::clamp<std::size_t>(num_envs / (8 * num_threads), 64, 256);
}

}  // namespace

Schedule::Schedule(std::size_t num_envs, std::size_t num_worlds, std::size_t block_size, std::size_t num_threads)
    : block_size_(
          std::max<std::size_t>(std::min(block_size > 0 ? block_size : good_block_size(num_envs, num_threads), num_envs), 1)),
      order_(num_envs),
      world_begin_(num_worlds) {
  for (auto& list : lists_) list.resize(num_envs);
  blocks_.reserve(num_envs / block_size_ + 1);
}

void Schedule::rebuild(std::span<const std::int32_t> world_index, std::span<const std::uint8_t> active) {
  const std::size_t drones_per_env = active.size() / std::max<std::size_t>(order_.size(), 1);
  const auto is_active = [&](std::size_t env) { return is_any(active.data() + env * drones_per_env, drones_per_env); };
  // A counting sort: stable, so envs of a world stay in index order.
  const auto world_of = [&](std::size_t env) { return world_index.empty() ? 0 : static_cast<std::size_t>(world_index[env]); };
  std::fill(world_begin_.begin(), world_begin_.end(), 0U);
  for (std::size_t env = 0; env < order_.size(); ++env) {
    if (is_active(env)) ++world_begin_[world_of(env)];
  }
  std::uint32_t end = 0;
  for (std::uint32_t& of_world : world_begin_) end += std::exchange(of_world, end);  // now the position of the world's next env
  for (std::size_t env = 0; env < order_.size(); ++env) {
    if (is_active(env)) order_[world_begin_[world_of(env)]++] = EnvIndex(env);
  }
  blocks_.clear();
  for (std::size_t first = 0; first < end; first += block_size_) {
    const auto list = [&](std::size_t which, Part part) { return EnvList(lists_[which].data() + first, part); };
    const std::span<const EnvIndex> envs = std::span(order_).subspan(first, std::min(block_size_, end - first));
    const bool is_contiguous = envs.back() - envs.front() + 1 == envs.size() && std::ranges::is_sorted(envs);
    blocks_.push_back(
        {envs, is_contiguous, list(0, Part::flown), list(1, Part::flying), list(2, Part::resetting), list(3, Part::active)});
  }
}

}  // namespace flockstep
