// Schedule: the active envs in an order, cut into blocks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/index.hpp"

namespace flockstep {

// Envs of a block that something is to be done with; it never holds more than the block.
class EnvList {
 public:
  EnvList() = default;
  explicit EnvList(EnvIndex* storage) : envs_(storage) {}

  void clear() { count_ = 0; }
  void push(EnvIndex env) { envs_[count_++] = env; }
  void assign(std::span<const EnvIndex> envs) {
    std::copy(envs.begin(), envs.end(), envs_);
    count_ = envs.size();
  }
  bool empty() const { return count_ == 0; }
  std::size_t size() const { return count_; }
  const EnvIndex* begin() const { return envs_; }
  const EnvIndex* end() const { return envs_ + count_; }
  const EnvIndex* data() const { return envs_; }

  // Keeps those for which keep(env) is true.
  template <class Keep>
  void filter(const Keep& keep) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (keep(envs_[i])) envs_[kept++] = envs_[i];
    }
    count_ = kept;
  }

 private:
  EnvIndex* envs_ = nullptr;
  std::size_t count_ = 0;
};

struct Block {
  std::span<const EnvIndex> envs;  // all active ones of the block
  bool is_contiguous = false;      // they follow each other without a gap
  // of the step under way
  EnvList flown;      // take part in it
  EnvList flying;     // those of them whose episode goes on
  EnvList resetting;  // begin an episode in it
  // of a call about some envs
  EnvList selected;
};

class Schedule {
 public:
  // block_size: 0 for a good one: as many as a thread's caches hold, since long pieces of arrays are read faster than short ones,
  // but at least eight blocks for each thread where these are not too small for that.
  Schedule(std::size_t num_envs, std::size_t num_worlds, std::size_t block_size, std::size_t num_threads = 1);

  // Call it after a change of world_index or of the active drones, (N,). It allocates nothing and clears all lists. An env is
  // active if one of its drones is. Envs are sorted by world; without world_index they keep the order of their indices.
  void rebuild(std::span<const std::int32_t> world_index, std::span<const std::uint8_t> active);

  std::span<Block> blocks() { return blocks_; }
  std::size_t block_size() const { return block_size_; }

 private:
  static constexpr std::size_t kLists = 4;  // of a block

  std::size_t block_size_;
  std::vector<EnvIndex> order_;             // (E,)
  std::vector<EnvIndex> lists_[kLists];     // (E,) storage, a block's where its envs are in order_
  std::vector<std::uint32_t> world_begin_;  // (W,) in order_
  std::vector<Block> blocks_;
};

}  // namespace flockstep
