// Terms that tasks share: where the goal is, how far, and how much room there is. Tasks in Python ask for them by Batch.terms.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "tasks/ranges.hpp"

namespace flockstep::task {

// The waypoint of that index, from 0, else the goal; the goal marker has to be there.
inline const Vec3& goal_of(const World& world, std::int32_t goal_index) {
  const auto& waypoints = world.markers().waypoints;
  const auto index = static_cast<std::size_t>(goal_index);
  return index < waypoints.size() ? waypoints[index] : *world.markers().goal;
}

inline double distance_m(const Vec3& a, const Vec3& b) { return (a.cast<double>() - b.cast<double>()).norm(); }

// Unit, from a drone of this pose to the point, in the body frame; 0 where they are one.
inline Vec3 direction_to(const Pose& pose, const Vec3& point) {
  const Vec3 offset = point - pose.position;
  const float length = offset.norm();
  const Vec3 direction = length > 0.0F ? Vec3(pose.rotation.conjugate() * (offset / length)) : Vec3::Zero();
  return direction.cwiseMax(-1.0F).cwiseMin(1.0F);
}

// sum(l / m - 1) / (n / m - n) of n normalised ranges l of this sum, m = min_clearance: 1 in the open, 0 where all are at m.
inline double free_space(double sum, std::size_t count, double min_clearance) {
  const auto n = static_cast<double>(count);
  return (sum / min_clearance - n) / (n / min_clearance - n);
}

}  // namespace flockstep::task
