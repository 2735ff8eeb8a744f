// Neighbours: the nearest other drones of an env, as a block of an observation.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>
#include <utility>

#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

// Numbers for each neighbour: position and velocity relative to the drone, in its body frame (3 m, 3 m/s), and 1.
inline constexpr std::size_t kNeighborSize = 7;

// Writes the drones of the same env that are nearest to a drone, the nearest first: kNeighborSize numbers for each, as many
// neighbours as `out` has room for. If there are fewer, the others are 0. Of equally distant drones, the one with the lower
// number comes first. Removed and finished drones are no neighbours, and have none. Poses are those that the pose sensor read
// last. velocity: (N, 3) m/s, world frame, such as state.flight.velocity; empty: relative velocities are 0.
inline void write_neighbors(const State& state, const PoseReadings& sensed, std::size_t drones_per_env, DroneIndex drone,
                            std::span<const float> velocity, std::span<float> out) {
  using Key = std::pair<float, std::size_t>;  // squared distance, drone
  std::ranges::fill(out, 0.0F);
  if (!state.active[drone]) return;
  const auto position = [&](std::size_t i) {
    return Vec3(sensed.position[3 * i], sensed.position[3 * i + 1], sensed.position[3 * i + 2]);
  };
  const float* const q = sensed.quat_wxyz.data() + 4 * drone;
  const Quat to_body = Quat(q[0], q[1], q[2], q[3]).conjugate();
  const Vec3 here = position(drone);
  const std::size_t first = drone / drones_per_env * drones_per_env;
  Key last{-1.0F, 0};
  for (; out.size() >= kNeighborSize; out = out.subspan(kNeighborSize)) {
    Key next{std::numeric_limits<float>::infinity(), 0};
    for (std::size_t other = first; other < first + drones_per_env; ++other) {
      if (other == drone || !state.active[other]) continue;
      const Key key{(position(other) - here).squaredNorm(), other};
      if (last < key && key < next) next = key;
    }
    if (next.first == std::numeric_limits<float>::infinity()) return;
    last = next;
    const std::size_t other = next.second;
    Eigen::Map<Vec3>(out.data()) = to_body * (position(other) - here);
    if (!velocity.empty()) {
      const auto moving = [&](std::size_t i) { return Vec3(velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]); };
      Eigen::Map<Vec3>(out.data() + 3) = to_body * (moving(other) - moving(drone));
    }
    out[6] = 1.0F;
  }
}

// The same for a task.
inline void write_neighbors(const TaskContext& context, DroneIndex drone, std::span<const float> velocity, std::span<float> out) {
  write_neighbors(context.state(), context.pose_readings(), context.drones_per_env(), drone, velocity, out);
}

}  // namespace flockstep
