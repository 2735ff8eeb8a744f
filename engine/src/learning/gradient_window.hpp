// GradientWindow: the steps through which a Learner differentiates.
#pragma once

#include <cstddef>
#include <vector>

#include "flockstep/aligned.hpp"
#include "tasks/flight_gradient.hpp"

namespace flockstep::learning {

// kLanes consecutive drones.
struct GradientGroup {
  dynamics::LaneDrones drones{};
  std::vector<task::GradientStep> steps;       // of the window
  std::vector<task::GroupNumbers> numbers;     // of the drones' episodes
  std::vector<std::size_t> number_of;          // for each step, its row of `numbers`
  alignas(64) dynamics::FlownLanes d_flown{};  // derivatives by the state after the step that is being pulled back
  alignas(64) dynamics::Lanes<4> d_action{};   // by its action, from the steps after it
  AlignedVector<dynamics::Lanes<4>> d_sent;    // by the commands that the steps sent, if they may be late
};

struct GradientWindow {
  std::vector<GradientGroup> groups;
  std::vector<TapeMemory<float>> memory;  // one per thread
  AlignedVector<float> inputs;            // (steps, rows, padded inputs of the networks)
  AlignedVector<float> observation;       // (steps, rows, observation)
  AlignedVector<float> chosen;            // (steps, rows, actions), before they are limited
};

}  // namespace flockstep::learning
