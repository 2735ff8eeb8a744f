// OutputSlots: what steps and resets return. Two slots take turns, so that what one returned stays intact during the next.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/batch.hpp"

namespace flockstep {

class OutputSlots {
 public:
  void allocate(const TaskSpec& spec, std::size_t num_envs);

  Outputs& now() { return slots_[current_]; }
  const Outputs& now() const { return slots_[current_]; }
  const Outputs& before() const { return slots_[1 - current_]; }

  void turn() { current_ = 1 - current_; }  // the other slot is written from now on; it holds what it held
  void turn_and_copy();                     // and begins with what the last one says

  // What an env begins an episode with: reward 0, no flags. In the present slot.
  void clear(std::size_t env);
  // An env that does not take part keeps what it said last, but for the reward.
  void carry_over(std::size_t env);
  // The present observation is the last of its episode.
  void keep_final(std::size_t env);
  // What was kept when this slot was written before is gone: the final observation of envs whose episode goes on is 0.
  void forget_final(std::size_t first, std::size_t count);
  // The present slot has been written from outside.
  void restored();
  // A removed slot reads as absent, in both slots: no step touches it.
  void mark_absent(const TaskSpec& spec, std::size_t env);

 private:
  void clear_final(std::size_t env);

  std::array<Outputs, 2> slots_;
  std::array<FlagArray, 2> has_final_;  // (E,) each: the row of final_observation is not 0
  std::size_t current_ = 0;
};

}  // namespace flockstep
