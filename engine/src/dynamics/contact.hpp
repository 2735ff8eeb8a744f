// Contact: resolves one drone's contacts with obstacles during one tick.
#pragma once

#include "collision/moving_sweep.hpp"
#include "collision/sweep.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// A distance (m) larger than the standoff that a sweep keeps at this coordinate, plus a few float32 steps of the coordinate.
inline float margin(float coordinate) {
  constexpr float kClearance = 1e-3F;  // m
  constexpr float kFloatSteps = 0x1p-18F;
  return kClearance + kFloatSteps * coordinate;
}

// The properties of a drone that contacts depend on.
struct Body {
  const collision::Hull& hull;
  const Airframe& airframe;
};

// The motion of a drone in a tick without obstacles.
struct TickMotion {
  Pose from, to;
  Velocity begin, end;
  double duration_s;
};

// The motion of a drone in a tick after all contacts.
struct ContactResult {
  collision::Contact contact;  // the last hit; hit is false if there was none
  bool is_deflected = false;   // the tick ends with the pose and velocity below instead of those of TickMotion
  Pose pose;
  Velocity velocity;
};

// Sweeps the hull along the motion. With OnContact::terminate the drone stops at the hit. Otherwise it rebounds and flies the
// rest of the tick, and may hit again. A drone that begins inside an obstacle may fly out of it; this also reports a contact.
ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Body& body, const DynamicsConfig& config,
                               const TickMotion& motion);

void write_contact(State& state, DroneIndex drone, const collision::Contact& contact);
// Also writes the body and its velocity. duration_s: of the motion.
void write_contact(State& state, DroneIndex drone, const collision::MovingContact& contact, double duration_s);

}  // namespace flockstep::dynamics
