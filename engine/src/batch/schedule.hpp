// Schedule: the active envs in an order, cut into blocks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/state.hpp"

namespace flockstep {

// Envs of a block that something is to be done with; it never holds more than the block.
class EnvList {
 public:
  EnvList() = default;
  explicit EnvList(std::uint32_t* storage) : envs_(storage) {}

  void clear() { count_ = 0; }
  void push(std::uint32_t env) { envs_[count_++] = env; }
  void assign(std::span<const std::uint32_t> envs) {
    std::copy(envs.begin(), envs.end(), envs_);
    count_ = envs.size();
  }
  bool empty() const { return count_ == 0; }
  std::size_t size() const { return count_; }
  const std::uint32_t* begin() const { return envs_; }
  const std::uint32_t* end() const { return envs_ + count_; }

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
  std::uint32_t* envs_ = nullptr;
  std::size_t count_ = 0;
};

struct Block {
  std::span<const std::uint32_t> envs;  // all active ones of the block
  bool is_contiguous = false;           // they follow each other without a gap
  // of the step under way
  EnvList flown;    // take part in it
  EnvList flying;   // those of them whose episode goes on
  EnvList opening;  // begin an episode in it
  // of a call about some envs
  EnvList chosen;
};

class Schedule {
 public:
  // block_size: 0 for a good one: as many as a thread's caches hold, since long pieces of arrays are read faster than short ones,
  // but at least eight blocks for each thread where these are not too small for that.
  Schedule(std::size_t num_envs, std::size_t num_worlds, std::size_t block_size, std::size_t num_threads = 1);

  // After a change of world_index or of which envs are active; allocates nothing. All lists are empty then. Envs are sorted by
  // world, or stay in the order of their indices where no worlds are given.
  void rebuild(std::span<const std::int32_t> world_index, std::span<const std::uint8_t> active);

  std::span<Block> blocks() { return blocks_; }
  std::size_t block_size() const { return block_size_; }

 private:
  static constexpr std::size_t kLists = 4;  // of a block

  std::size_t block_size_;
  std::vector<std::uint32_t> order_;          // (E,)
  std::vector<std::uint32_t> lists_[kLists];  // (E,) storage, a block's where its envs are in order_
  std::vector<std::uint32_t> world_begin_;    // (W,) in order_
  std::vector<Block> blocks_;
};

}  // namespace flockstep
