// Gates on the way of a drone: which of them its path passes or misses. Python tasks get this from Batch.terms.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::task {

// The direction in which a gate is passed, the x axis of its frame.
inline Vec3 normal_of(const Gate& gate) {
  const Quat& q = gate.rotation;
  return {1.0F - 2.0F * (q.y() * q.y() + q.z() * q.z()), 2.0F * (q.x() * q.y() + q.w() * q.z()),
          2.0F * (q.x() * q.z() - q.w() * q.y())};
}

// True if a point of the gate's plane, given from its centre, is in the opening.
inline bool is_in_opening(const Gate& gate, const Vec3& from_center) {
  const Vec3 local = gate.rotation.conjugate() * from_center;
  const float half = 0.5F * gate.size;
  if (gate.shape == GateShape::ring) return local.y() * local.y() + local.z() * local.z() < half * half;
  return std::max(std::abs(local.y()), std::abs(local.z())) < half;
}

// The gates that a drone passed on a path, and whether it missed one.
struct Crossings {
  std::int32_t passed = 0;
  bool has_missed = false;
};

// Follows a path, (ticks + 1, 3) m, tick by tick: counts the gates that it passes in their order, from gates[target] on, and
// stops where it misses one. The last gate is followed by the first. A gate is missed if the path crosses its plane forwards
// outside the opening, at most miss_m from its centre.
inline Crossings cross_gates(std::span<const Gate> gates, std::size_t target, std::span<const float> path, float miss_m) {
  Crossings crossings;
  const auto point = [&](std::size_t i) { return Vec3(path[i], path[i + 1], path[i + 2]); };
  const Gate* gate = &gates[target];
  Vec3 normal = normal_of(*gate);
  Vec3 from = point(0);
  float before = normal.dot(from - gate->center);  // m beyond the gate's plane
  for (std::size_t i = 3; i < path.size(); i += 3) {
    const Vec3 to = point(i);
    const float after = normal.dot(to - gate->center);
    if (before < 0.0F && after >= 0.0F) {
      const Vec3 crossing = from + (before / (before - after)) * (to - from) - gate->center;
      if (is_in_opening(*gate, crossing)) {
        ++crossings.passed;
        if (++target == gates.size()) target = 0;
        gate = &gates[target];
        normal = normal_of(*gate);
        before = normal.dot(to - gate->center);
        from = to;
        continue;
      }
      if (crossing.norm() <= miss_m) {
        crossings.has_missed = true;
        return crossings;
      }
    }
    before = after;
    from = to;
  }
  return crossings;
}

}  // namespace flockstep::task
