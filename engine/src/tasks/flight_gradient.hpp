// FlightGradient: what a flight task gives to learn by the derivatives of its own flight: a loss with derivatives, and its
// observation as a formula. The formulas are beside each other in flight_gradient.cpp, and tests compare each observation with
// the task's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "dynamics/step_gradient.hpp"
#include "flockstep/aligned.hpp"
#include "flockstep/task.hpp"
#include "tasks/flight_action.hpp"

namespace flockstep::task {

enum class Terms : std::uint8_t { hover, track, race };

class FlightGradient {
 public:
  virtual ~FlightGradient() = default;
  virtual Terms terms() const = 0;
  // Throws std::invalid_argument if the task is configured to observe what has no derivatives.
  virtual void require_derivatives() const {}
  // Numbers of a drone that its loss and observation read: targets, gates and so on.
  virtual std::size_t num_constants() const = 0;
  // Writes them before a step, after its observation was made; and those that are known only after it.
  virtual void write_constants(const TaskContext& context, DroneIndex drone, float* to) = 0;
  virtual void write_results(const TaskContext& context, DroneIndex drone, float* to) = 0;
  virtual const ActionRanges& ranges_of(const TaskContext& context, DroneIndex drone) const = 0;
  virtual std::span<const float> last_actions() const = 0;  // (N, 4) of the last step
};

// A drone's coefficients, and the range of each number of its action.
struct alignas(64) GroupNumbers {
  dynamics::LaneNumbers numbers;
  dynamics::Lanes<4> middle, down, up;
};

// A step of kLanes drones.
struct alignas(64) GradientStep {
  dynamics::StepStart start;
  dynamics::FlownLanes after;                // as flown
  dynamics::Lane weight;                     // of the step's loss; 0 if the drone did not fly
  dynamics::Lane goes_on;                    // 1 if `after` is the state after this step; 0 if the episode ended in it
  dynamics::Lane discount;                   // of the step that follows in the window; 0 if there is none
  dynamics::Lanes<4> action, action_before;  // within [-1, 1]
  AlignedVector<dynamics::Lane> constants;
};

// The commands that drones fly in the ticks of a step if commands may be late, and the derivatives by them, which are replaced.
struct TickCommands {
  AlignedVector<dynamics::Lanes<4>> command, d_command;  // one for each tick of StepGradient
};

// Derivatives of the loss of a step and of what follows it. d_flown: by the state after the step, replaced by those by the state
// before it. d_action, d_action_before: replaced. late: null if the step's action is what is flown; otherwise d_action is that of
// the loss alone. Returns the weighted loss.
double pull_back_step(Terms terms, const dynamics::StepGradient& gradient, Control control, const GroupNumbers& numbers,
                      const GradientStep& step, TapeMemory<float>& memory, dynamics::FlownLanes& d_flown,
                      dynamics::Lanes<4>& d_action, dynamics::Lanes<4>& d_action_before, TickCommands* late = nullptr);

// Adds what follows from the observation before the step. d_observation: one lane for each of its numbers.
void pull_back_observation(Terms terms, const GradientStep& step, std::span<const dynamics::Lane> d_observation,
                           TapeMemory<float>& memory, dynamics::FlownLanes& d_flown, dynamics::Lanes<4>& d_action_before);

// The observation as these formulas have it, for tests.
void observe(Terms terms, const GradientStep& step, TapeMemory<float>& memory, std::span<dynamics::Lane> observation);
}  // namespace flockstep::task
