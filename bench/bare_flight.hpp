// Interface of the bare flight kernel in bare_flight-inl.hpp.
#pragma once

#include <cstddef>

#include "dynamics/flight.hpp"

namespace bench {

// Parameters of a quadrotor in SI units. Frames and signs are as in docs/dynamics.md.
struct Quadrotor {
  float mass, inertia[3];
  float x[4], y[4], yaw[4];  // per rotor: x and y, and the ratio of torque about z to thrust
  float thrust[3];           // c0, c1, c2
  float lag_up, lag_down;    // s
  float linear_drag[3], quadratic_drag[3];
};

// One run of `ticks` ticks of dt seconds. The setpoints are rotor speeds. `fused` enables fused multiply-add, which the engine
// leaves out because results would differ between processors.
struct Flight {
  float dt;
  int ticks;
  bool is_rk4, fused;
};

void fly_bare(const Quadrotor& quadrotor, const Flight& flight, flockstep::dynamics::Flock& flock);

}  // namespace bench
