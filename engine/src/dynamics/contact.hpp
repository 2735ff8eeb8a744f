// Contact: resolves one drone's contacts with obstacles during one tick.
#pragma once

#include "collision/moving_bodies.hpp"
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
  collision::MovingContact contact;  // the last hit; hit is false if there was none
  bool is_deflected = false;         // the tick ends with the pose and velocity below instead of those of TickMotion
  Pose pose;
  Velocity velocity;
  float farthest = 0.0F;  // m, bound of the distance from the beginning during the tick
};

// Sweeps the hull along the motion. With OnContact::terminate the drone stops at the hit. Otherwise it rebounds and flies the
// rest of the tick, and may hit again. A drone that begins inside an obstacle may fly out of it; this also reports a contact.
ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Body& body, const DynamicsConfig& config,
                               const TickMotion& motion);

// The bodies that one drone may meet in a tick, which is their motion. Both are references to what others own.
struct Traffic {
  const collision::MovingBodies& bodies;  // bodies of the drone's env
  collision::NearSolids& near;
};

// The same among bodies. The drone rebounds relative to the surface that it hits. After its last contact, or a hit with
// OnContact::terminate, bodies push it out of their way until the end of the tick. If they jam it, contact.inside is set and the
// drone rests.
ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Traffic& traffic, const Body& body,
                               const DynamicsConfig& config, const TickMotion& motion);

// Moves a drone kinematically while the bodies move, which may push it.
collision::MovingSweep sweep_among(const collision::Obstacles& obstacles, const Traffic& traffic, const collision::Hull& hull,
                                   const Pose& from, const Pose& to);

// Moves the bodies, which push a drone that stands.
collision::Push push_standing(const collision::Obstacles& obstacles, const Traffic& traffic, const collision::Hull& hull,
                              const Pose& pose);

void write_contact(State& state, DroneIndex drone, const collision::Contact& contact);
// Also writes the body and its velocity, and that it is no contact with a drone. duration_s: of the motion.
void write_contact(State& state, DroneIndex drone, const collision::MovingContact& contact, double duration_s);

}  // namespace flockstep::dynamics
