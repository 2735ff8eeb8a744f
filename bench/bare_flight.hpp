// The limit for flight: what bare_flight-inl.hpp flies.
#pragma once

#include <cstddef>

#include "dynamics/flight.hpp"

namespace bench {

// A quadrotor's numbers, SI units; frames and signs as in docs/dynamics.md.
struct Quadrotor {
  float mass, inertia[3];
  float x[4], y[4], yaw[4];  // of each rotor: its place, and its torque about z over its thrust
  float thrust[3];           // c0, c1, c2
  float lag_up, lag_down;    // s
  float linear_drag[3], quadratic_drag[3];
};

// Told the rotor speeds that the setpoints are, for some ticks of dt seconds. `fused`: with fused multiply-add, which the engine
// leaves out since it does not round alike on every processor.
struct Flight {
  float dt;
  int ticks;
  bool is_rk4, fused;
};

void fly_bare(const Quadrotor& quadrotor, const Flight& flight, flockstep::dynamics::Flock& flock);

}  // namespace bench
