// Terms that tasks share: direction and distance to the goal, and free space. Python tasks get them from Batch.terms.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/require.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::task {

// Normalises the ranges of a scan, and measures the free space that they show.
struct ScanClearance {
  double nearest = 1.0;  // smallest normalised range
  double sum = 0.0;      // sum of the normalised ranges
};

// Computes the clearance of ranges (m). Each is divided by max_range_m; a miss, inf, counts as 1.
ScanClearance clearance_of(std::span<const float> ranges, float max_range_m);

// Writes ranges (m) over max_range_m to `normalised`, which has the same length; a miss is written as 1.
void normalise(std::span<const float> ranges, float max_range_m, float* normalised);

// Returns the waypoint with this index, counted from 0, or the goal after the last one. The world must have a goal marker.
inline const Vec3& goal_of(const World& world, std::int32_t goal_index) {
  const auto& waypoints = world.markers().waypoints;
  const auto index = static_cast<std::size_t>(goal_index);
  return index < waypoints.size() ? waypoints[index] : *world.markers().goal;
}

inline double distance_m(const Vec3& a, const Vec3& b) { return (a.cast<double>() - b.cast<double>()).norm(); }

// Unit vector from the drone to the point in the body frame; 0 if they coincide.
inline Vec3 direction_to(const Pose& pose, const Vec3& point) {
  const Vec3 offset = point - pose.position;
  const float length = offset.norm();
  const Vec3 direction = length > 0.0F ? Vec3(pose.rotation.conjugate() * (offset / length)) : Vec3::Zero();
  return direction.cwiseMax(-1.0F).cwiseMin(1.0F);
}

// Writes the direction to a goal at the height of the drone, x and y of the body frame, and its distance in units of 10 m, at
// most 1.
inline void write_goal(const Pose& pose, const Vec3& goal, float* out) {
  constexpr float kFar = 10.0F;  // m
  const Vec3 direction = direction_to(pose, {goal.x(), goal.y(), pose.position.z()});
  out[0] = direction.x();
  out[1] = direction.y();
  out[2] = std::min((goal - pose.position).norm() / kFar, 1.0F);
}

// Throws std::invalid_argument if a number of a snapshot is not finite.
template <class Values>
void require_finite(const Values& values, const char* name) {
  for (const auto value : values) {
    if (!std::isfinite(value)) refuse(std::string("snapshot: ") + name, "finite numbers", value);
  }
}

// sum(l / m - 1) / (n / m - n) over n normalised ranges l, with m = min_clearance: 1 in the open, 0 if all ranges are m.
inline double free_space(double sum, std::size_t count, double min_clearance) {
  const auto n = static_cast<double>(count);
  return (sum / min_clearance - n) / (n / min_clearance - n);
}

}  // namespace flockstep::task
