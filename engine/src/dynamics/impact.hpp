// Impact: what a contact does to a body that moves.
#pragma once

#include <span>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

struct Surface {
  double restitution;  // speed away from it over speed towards it
  double friction;     // Coulomb's coefficient; infinite: what touches does not slide, whether it is pressed on or not
};

// Velocities after a contact.
struct Rebound {
  Velocity after;   // right after the impact
  Velocity at_end;  // at the end of the tick, if nothing else is hit
};

// What an impact in the middle of a tick, and then the surface, make of a body's motion. at_hit: the velocity before the impact;
// at_end: what it would have been at the end of the tick, left_s later, without the contact. points: of the body that touch, m,
// world frame, on the surface, at most kMostPoints; normal: unit, away from the surface.
//
// By the impact each point leaves at its share of the speed that it came with, by impulses within Coulomb's cone; what moves away
// already goes on as it does. The impact gives the body no energy: if the restitution would, it is reduced until it does not.
// Then the forces of the rest of the tick act, and the surface keeps the points from going into it.
//
// The impulses are solved for one point after another until none changes any more (projected Gauss-Seidel: E. Catto, "Iterative
// Dynamics with Temporal Coherence", 2005). Points that are not in one plane, or nearly the same, take many rounds.
inline constexpr std::size_t kMostPoints = 33;  // every vertex of a hull, and one more
Rebound thrown_back(const Velocity& at_hit, const Velocity& at_end, double left_s, const Pose& pose, std::span<const Vec3> points,
                    const Vec3& normal, const Airframe& frame, const Surface& surface);

}  // namespace flockstep::dynamics
