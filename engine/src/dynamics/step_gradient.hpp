// StepGradient: how the state after a flown step depends on the state before it and on the command. The derivatives are those of
// the equations of flight, at the drone's own state and numbers, over a few long midpoint ticks instead of the many short ones
// of the flight itself. Contacts, wind, the wash of other drones and the ground act in the flight only: their effect has no
// derivative.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "base/tape_memory.hpp"
#include "dynamics/fleet.hpp"
#include "dynamics/flight.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// Numbers of a drone's state that its flight changes, in this order: position, velocity, rotation, turn, integral of the velocity
// error, rotor speeds, commanded rotor speeds. See Flock.
inline constexpr std::size_t kRotors = 4;  // only the flight of quadrotors has derivatives
inline constexpr std::size_t kFlownRotor = 16, kFlown = kFlownRotor + 2 * kRotors;
using FlownLanes = Lanes<kFlown>;

// Calls f(array, its first of the kFlown numbers, columns) for each array of a State, which may be const, with these numbers.
template <class T, class F>
void for_each_flown(T& state, const F& f) {
  std::size_t first = 0;
  const auto call = [&](auto& array, std::size_t columns) {
    f(array, first, columns);
    first += columns;
  };
  call(state.position, 3);
  call(state.flight.velocity, 3);
  call(state.quat_wxyz, 4);
  call(state.flight.angular_velocity, 3);
  call(state.flight.error_integral, 3);
  call(state.flight.rotor_speed, kRotors);
  call(state.flight.rotor_command, kRotors);
}

// The drones of the lanes; drones beyond the last one are copies of it.
using LaneDrones = std::array<DroneIndex, kLanes>;

// The start of a step.
struct alignas(64) StepStart {
  FlownLanes flown;
  Lanes<3> wind, push, twist;
  Lanes<kMaxRotors> thrust_share, speed_share;
};

class StepGradient {
 public:
  // ticks: of a step. Throws as require_derivatives() does.
  StepGradient(const Fleet& fleet, int ticks);

  // Throws std::invalid_argument if an airframe or the control of a fleet has no derivative.
  static void require_derivatives(const Fleet& fleet);

  // Reads the state of drones before a step, or only what flight changes.
  void read(const State& state, const LaneDrones& drones, StepStart& start) const;
  static void read(const State& state, const LaneDrones& drones, FlownLanes& flown);
  // The coefficients of drones, with their parameters of the moment.
  void read_numbers(const State& state, const LaneDrones& drones, LaneNumbers& numbers) const;

  float step_s() const { return static_cast<float>(dt_s_ * ticks); }

  Physics physics;  // of the long ticks
  int ticks;

 private:
  const Fleet& fleet_;
  double dt_s_;
};

// The derivatives of one step of the lanes, backwards. command: (kLanes) rows of the numbers of Control. d_flown: derivatives of
// something by the state after the step, which are replaced by those by the state before it. d_command: those by the command.
void pull_back(const StepGradient& gradient, Control control, const StepStart& start, const LaneNumbers& numbers,
               const Lanes<4>& command, TapeMemory<float>& memory, FlownLanes& d_flown, Lanes<4>& d_command);

}  // namespace flockstep::dynamics
