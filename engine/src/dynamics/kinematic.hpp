// Kinematic motion, as in the thesis: within one flown step a drone moves straight to its setpoint and turns at a constant
// rate.
#pragma once

#include "collision/sweep.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// Pose after `substep` of `substeps` equal parts of the motion from `from` to `target`.
inline Pose integrate_kinematic(const Pose& from, const Pose& target, int substep, int substeps) {
  if (substep == substeps) return target;
  return collision::interpolate(from, target, static_cast<float>(substep) / static_cast<float>(substeps));
}

}  // namespace flockstep::dynamics
