// Impact: the velocity of a body after a contact.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// A point at which a body touches a surface.
struct ContactPoint {
  Vec3 position;  // m, world frame
  Vec3 normal;    // unit, world frame, from the surface towards the body
};

struct ContactMaterial {
  double restitution;  // speed away from the surface over speed towards it
  double friction;     // Coulomb coefficient; infinite: contact points never slide, even without normal force
};

// Velocities after a contact.
struct Rebound {
  Velocity after;   // right after the impact
  Velocity at_end;  // at the end of the tick, if nothing else is hit
};

// Resolves an impact in the middle of a tick, and the contact for the rest of it. at_hit: velocity before the impact. at_end:
// velocity at the end of the tick, left_s later, if there were no contact. points: at most kMaxPoints.
//
// In the impact each point rebounds with the restitution's share of its approach speed, by impulses within the Coulomb cone. A
// point that already moves away is not affected. The impact adds no energy: if the restitution would, it is reduced. Then the
// forces of the rest of the tick act, and the surface keeps the points from entering it.
//
// The impulses are solved point by point until they converge (projected Gauss-Seidel: E. Catto, "Iterative Dynamics with
// Temporal Coherence", 2005). This takes many rounds if the points are not coplanar or nearly coincide.
inline constexpr std::size_t kMaxPoints = 130;  // twice all vertices of two hulls, plus one
Rebound thrown_back(const Velocity& at_hit, const Velocity& at_end, double left_s, const Pose& pose,
                    std::span<const ContactPoint> points, const Airframe& frame, const ContactMaterial& surface);

// A body that hits another one.
struct Colliding {
  const Pose& pose;
  const Airframe& frame;
  Velocity at_hit, at_end;  // as for thrown_back()
};

// The same for two bodies, which exert opposite impulses on each other: their total momentum and angular momentum stay as they
// are. Normals point from the second body to the first.
std::array<Rebound, 2> thrown_apart(const Colliding& first, const Colliding& second, double left_s,
                                    std::span<const ContactPoint> points, const ContactMaterial& surface);

// Returns the velocities with which two bodies move as one, with the momentum and angular momentum that they have at at_hit.
std::array<Velocity, 2> moved_together(const Colliding& first, const Colliding& second);

}  // namespace flockstep::dynamics
