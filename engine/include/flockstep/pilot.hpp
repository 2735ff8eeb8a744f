// Pilot: chooses actions within a step of a batch.
#pragma once

#include <cstddef>
#include <vector>

#include "flockstep/buffer.hpp"

namespace flockstep {

// Consecutive rows of a batch, which one thread steps.
struct PilotedRows {
  const std::vector<Buffer>& observation;  // the last step's or reset's, one buffer per field of TaskSpec::observation
  std::size_t first, count;                // the rows
  std::size_t thread;                      // in [0, Batch::num_threads()), index for per-thread data
};

class Pilot {
 public:
  virtual ~Pilot() = default;
  // Writes the actions of the rows, in the form of TaskSpec::action. Other threads may handle other rows at the same time. Rows
  // that begin an episode in this step ignore their actions.
  virtual void act(const PilotedRows& rows, Buffer& actions) = 0;
};

}  // namespace flockstep
