// Impact: the velocity of a body after a contact.
#pragma once

#include <span>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

struct Surface {
  double restitution;  // speed away from the surface over speed towards it
  double friction;     // Coulomb coefficient; infinite: contact points never slide, even without normal force
};

// Velocities after a contact.
struct Rebound {
  Velocity after;   // right after the impact
  Velocity at_end;  // at the end of the tick, if nothing else is hit
};

// Resolves an impact in the middle of a tick, and the contact for the rest of it. at_hit: velocity before the impact. at_end:
// velocity at the end of the tick, left_s later, if there were no contact. points: contact points of the body on the surface,
// m, world frame, at most kMostPoints. normal: unit, away from the surface.
//
// In the impact each point rebounds with the restitution's share of its approach speed, by impulses within the Coulomb cone. A
// point that already moves away is not affected. The impact adds no energy: if the restitution would, it is reduced. Then the
// forces of the rest of the tick act, and the surface keeps the points from entering it.
//
// The impulses are solved point by point until they converge (projected Gauss-Seidel: E. Catto, "Iterative Dynamics with
// Temporal Coherence", 2005). This takes many rounds if the points are not coplanar or nearly coincide.
inline constexpr std::size_t kMostPoints = 33;  // all vertices of a hull, plus one
Rebound thrown_back(const Velocity& at_hit, const Velocity& at_end, double left_s, const Pose& pose, std::span<const Vec3> points,
                    const Vec3& normal, const Airframe& frame, const Surface& surface);

}  // namespace flockstep::dynamics
