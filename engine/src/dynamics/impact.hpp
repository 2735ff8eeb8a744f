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

// The velocity at the end of a tick in which a contact happened, after an impulse at one point, by restitution and Coulomb
// friction. at_hit: when it touched; at_end: what it would have been without the contact. point: m, world frame; normal: unit,
// away from the surface. The point leaves at its share of the speed it came with, less what forces have taken since, and does not
// go deeper. What moves away already goes on as it does.
Velocity thrown_back(const Velocity& at_hit, const Velocity& at_end, const Pose& pose, const Vec3& point, const Vec3& normal,
                     const Airframe& frame, const Surface& surface);

}  // namespace flockstep::dynamics
