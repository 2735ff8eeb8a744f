// OutputSlots: the outputs of steps and resets. Two slots alternate, so the outputs of one call stay intact during the next.
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

  void turn() { current_ = 1 - current_; }  // makes the other slot current; its contents are kept
  void turn_and_copy();                     // also copies the last outputs into it

  // Clears a row of the current slot for a new episode: reward 0, no flags.
  void clear(std::size_t row);
  // Copies the last outputs of a row that does not fly, with reward 0.
  void carry_over(std::size_t row);
  // Keeps the current observation of a row as the final one of its episode.
  void keep_final(std::size_t row);
  // Clears the final observations of consecutive rows that the current slot holds from an earlier step.
  void forget_final(std::size_t first, std::size_t count);
  // Call it after the current slot has been overwritten, as by a snapshot.
  void restored();
  // Clears the row of a finished drone in the current slot, and shows the observation of an absent one.
  void rest(const TaskSpec& spec, std::size_t row);
  // Shows the observation of an absent drone in the current slot.
  void show_absent(const TaskSpec& spec, std::size_t row);
  // Marks the row of a removed drone as absent in both slots, since no step writes it.
  void mark_absent(const TaskSpec& spec, std::size_t row);

 private:
  void clear_final(std::size_t row);

  std::array<Outputs, 2> slots_;
  std::array<FlagArray, 2> has_final_;  // (R,) each; 1 if the row of final_observation may be nonzero
  std::size_t current_ = 0;
};

}  // namespace flockstep
