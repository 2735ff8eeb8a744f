// Impact: what a contact does to a body that moves.
#pragma once

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

struct Surface {
  double restitution;  // speed away from it over speed towards it
  double friction;     // Coulomb's coefficient
};

// The velocity after an impulse at one point, by restitution and Coulomb friction. point: m, world frame; normal: unit, away from
// the surface. What moves away from it already goes on as it does.
Velocity thrown_back(const Velocity& before, const Pose& pose, const Vec3& point, const Vec3& normal, const Airframe& frame,
                     const Surface& surface);

}  // namespace flockstep::dynamics
