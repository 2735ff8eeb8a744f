// PosePath: how a drone moved between two moments.
#pragma once

#include <algorithm>
#include <cstdint>

#include "flockstep/pose.hpp"

namespace flockstep {

// Motion of one drone between two readings, at constant velocities.
struct PosePath {
  Pose from, to;           // at the reading before and at this one
  std::int64_t ticks = 0;  // between them; 0: the drone has not moved

  // Returns the pose `age` ticks before this reading, and not before `from`.
  Pose before(float age) const {
    if (ticks == 0 || age == 0.0F) return to;
    const float share = std::min(age / static_cast<float>(ticks), 1.0F);
    return {to.position + share * (from.position - to.position), to.rotation.slerp(share, from.rotation)};
  }
};

}  // namespace flockstep
