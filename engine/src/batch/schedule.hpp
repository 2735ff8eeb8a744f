// Schedule: the active envs, ordered and divided into blocks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/index.hpp"

namespace flockstep {

// The drones of a list's envs that the list concerns; see Simulation::takes_part(). They differ only if the drones of an env end
// their episodes separately.
enum class Part : std::uint8_t { active, flown, flying, resetting };

// A list of envs of one block; it never holds more envs than the block.
class EnvList {
 public:
  EnvList() = default;
  EnvList(EnvIndex* storage, Part part) : envs_(storage), part_(part) {}

  Part part() const { return part_; }

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

  // Keeps the envs for which keep(env) is true.
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
  Part part_ = Part::active;
};

struct Block {
  std::span<const EnvIndex> envs;  // all active envs of the block
  bool is_contiguous = false;      // envs are consecutive, without gaps
  // used during a step
  EnvList flown;      // envs that fly in the step
  EnvList flying;     // envs of `flown` whose episode goes on
  EnvList resetting;  // envs that begin an episode in the step; with Episodes::each, envs of drones that do
  // used during calls with a mask
  EnvList selected;
};

class Schedule {
 public:
  // block_size: envs in a block; 0 chooses the size. Large blocks read long pieces of arrays, which is faster, but must fit
  // into a thread's caches. There are at least eight blocks for each thread, unless these would be too small.
  Schedule(std::size_t num_envs, std::size_t num_worlds, std::size_t block_size, std::size_t num_threads = 1);

  // Call it after a change of world_index or of the active drones, (N,). Allocates nothing and clears all lists. An env is
  // active if one of its drones is. Envs are sorted by world; without world_index they stay in index order.
  void rebuild(std::span<const std::int32_t> world_index, std::span<const std::uint8_t> active);

  std::span<Block> blocks() { return blocks_; }
  std::size_t block_size() const { return block_size_; }

 private:
  static constexpr std::size_t kLists = 4;  // lists in a block

  std::size_t block_size_;
  std::vector<EnvIndex> order_;             // (E,)
  std::vector<EnvIndex> lists_[kLists];     // (E,) storage; a block uses the range of its envs in order_
  std::vector<std::uint32_t> world_begin_;  // (W,) position of each world in order_
  std::vector<Block> blocks_;
};

}  // namespace flockstep
