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

// The velocity at the end of a tick in which a contact happened, after impulses at all points of the body that touch the surface,
// by restitution and Coulomb friction. at_hit: when it touched; at_end: what it would have been without the contact. points: m,
// world frame, at most kMostPoints; normal: unit, away from the surface. Each point leaves at its share of the speed it came
// with, less what forces have taken since, and does not go deeper. What moves away already goes on as it does. The body gains no
// energy.
//
// The impulses are solved for one point after another until none changes any more (projected Gauss-Seidel: E. Catto, "Iterative
// Dynamics with Temporal Coherence", 2005).
inline constexpr std::size_t kMostPoints = 33;  // every vertex of a hull, and one more
Velocity thrown_back(const Velocity& at_hit, const Velocity& at_end, const Pose& pose, std::span<const Vec3> points,
                     const Vec3& normal, const Airframe& frame, const Surface& surface);

}  // namespace flockstep::dynamics
