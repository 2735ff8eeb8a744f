// OutputSlots: what steps and resets return. Two slots take turns, so that what one returned stays intact during the next.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/batch.hpp"

namespace flockstep {

class OutputSlots {
 public:
  void allocate(const TaskSpec& spec, const ArraySizes& sizes);

  Outputs& now() { return slots_[current_]; }
  const Outputs& now() const { return slots_[current_]; }
  const Outputs& before() const { return slots_[1 - current_]; }

  void turn() { current_ = 1 - current_; }  // the other slot is written from now on; it holds what it held
  void turn_and_copy();                     // and begins with what the last one says

  // A row begins an episode: reward 0, no flags. In the present slot.
  void clear(std::size_t row);
  // A row that does not take part keeps what it returned last, except that its reward is 0.
  void carry_over(std::size_t row);
  // The present observation of a row is the last of its episode.
  void keep_final(std::size_t row);
  // Clears the final observations of consecutive rows, which this slot holds from an earlier step.
  void forget_final(std::size_t first, std::size_t count);
  // The present slot has been written from outside.
  void restored();
  // The row of a removed drone reads as absent, in both slots: no step writes it.
  void mark_absent(const TaskSpec& spec, std::size_t row);

 private:
  void clear_final(std::size_t row);

  std::array<Outputs, 2> slots_;
  std::array<FlagArray, 2> has_final_;  // (R,) each: the row of final_observation is not 0
  std::size_t current_ = 0;
};

}  // namespace flockstep
