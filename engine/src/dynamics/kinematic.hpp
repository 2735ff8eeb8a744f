// Kinematic motion, the thesis's: a drone flies straight to its setpoint and turns evenly, within one flown step.
#pragma once

#include "collision/sweep.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::dynamics {

// Where a motion from `from` to `target` is after the given part of its time.
inline Pose integrate_kinematic(const Pose& from, const Pose& target, int substep, int substeps) {
  if (substep == substeps) return target;
  return collision::interpolate(from, target, static_cast<float>(substep) / static_cast<float>(substeps));
}

}  // namespace flockstep::dynamics
