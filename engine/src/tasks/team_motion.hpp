// TeamMotion: drones that are commanded by displacements and observe their neighbours, for tasks of several drones.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "flockstep/neighbors.hpp"
#include "flockstep/task.hpp"
#include "tasks/terms.hpp"

namespace flockstep::task {

inline constexpr std::size_t kMaxNeighbors = 32;  // that are observed

// 0 if no other drone of the env is within near_m (m) of a drone, rising to 1 at distance 0.
inline double nearness(const State& state, std::size_t drones_per_env, DroneIndex drone, float near_m) {
  double least = static_cast<double>(near_m);
  const std::size_t first = drone / drones_per_env * drones_per_env;
  for (std::size_t other = first; other < first + drones_per_env; ++other) {
    if (other == drone || !state.active[other]) continue;
    const Vec3 apart = position_of(state, DroneIndex(other)) - position_of(state, drone);
    least = std::min(least, apart.cast<double>().norm());
  }
  return 1.0 - least / static_cast<double>(near_m);
}

// The rotation about the vertical axis that is nearest to a rotation.
inline Quat heading_of(const Quat& rotation) {
  const Quat heading(rotation.w(), 0.0F, 0.0F, rotation.z());
  return heading.squaredNorm() > 0.0F ? heading.normalized() : Quat::Identity();
}

// kAxes: 2 for drones that stay at their height, 3 for others.
template <std::size_t kAxes>
class TeamMotion {
 public:
  static constexpr std::size_t kOwn = 2 * kAxes;           // observed numbers: last action and velocity
  static constexpr std::size_t kNeighbor = 2 * kAxes + 1;  // for each neighbour: position, velocity and 1

  explicit TeamMotion(float step_m) : step_m_(step_m) {}

  void setup(const TaskContext& context) {
    fastest_ = std::sqrt(static_cast<float>(kAxes)) * step_m_ / static_cast<float>(context.clock().step_s());
    step_s_ = static_cast<float>(context.clock().step_s());
    from_.resize(3 * context.num_drones());
    rows_.last_action.resize(kAxes * context.num_drones());
    rows_.velocity.resize(3 * context.num_drones());
  }
  void begin(DroneIndex drone) {
    std::fill_n(rows_.last_action.data() + kAxes * drone, kAxes, 0.0F);
    std::fill_n(rows_.velocity.data() + 3 * drone, 3, 0.0F);
  }

  // Returns the pose that an action in [-1, 1] commands: a displacement in units of step_m along the axes of the drone's heading.
  // Call it in Task::command(). Adds the mean squared change of the action to `change`.
  Pose target(const State& state, DroneIndex drone, std::span<const float> action, double* change = nullptr) {
    const Pose pose = pose_of(state, drone);
    std::copy_n(pose.position.data(), 3, from_.data() + 3 * drone);
    Vec3 step = Vec3::Zero();
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
      const float clipped = std::clamp(action[axis], -1.0F, 1.0F);
      float& last = rows_.last_action[kAxes * drone + axis];
      if (change != nullptr) *change += static_cast<double>((clipped - last) * (clipped - last)) / static_cast<double>(kAxes);
      last = clipped;
      step[static_cast<Eigen::Index>(axis)] = step_m_ * clipped;
    }
    const Quat heading = heading_of(pose.rotation);
    return {pose.position + heading * step, heading};
  }
  // Updates the velocity. Call it in Task::score().
  void moved(const State& state, DroneIndex drone) {
    const Vec3 way = position_of(state, drone) - Vec3::Map(from_.data() + 3 * drone);
    Eigen::Map<Vec3>(rows_.velocity.data() + 3 * drone) = way / step_s_;
  }

  // m/s, unit of observed velocities: that of the longest displacement.
  float fastest() const { return fastest_; }
  // Writes last action and velocity, then the neighbours that fit in the row: position in units of sight_m, shortened to 1 if it
  // is longer, relative velocity over twice its unit, and 1. Vectors are in the body frame.
  void observe(const TaskContext& context, DroneIndex drone, float sight_m, std::span<float> row) const {
    std::copy_n(rows_.last_action.data() + kAxes * drone, kAxes, row.data());
    const Vec3 velocity = context.sensed_pose(drone).rotation.conjugate() * Vec3::Map(rows_.velocity.data() + 3 * drone);
    write_limited(velocity / fastest_, row.data() + kAxes);
    row = row.subspan(kOwn);
    const std::size_t count = row.size() / kNeighbor;
    std::array<float, kNeighborSize * kMaxNeighbors> block;
    write_neighbors(context, drone, rows_.velocity, std::span(block).first(kNeighborSize * count));
    for (std::size_t i = 0; i < count; ++i) {
      const float* const neighbor = block.data() + kNeighborSize * i;
      float* const out = row.data() + kNeighbor * i;
      write_shortened(Vec3::Map(neighbor), sight_m, out);
      write_limited(Vec3::Map(neighbor + 3) / (2.0F * fastest_), out + kAxes);
      out[2 * kAxes] = neighbor[6];
    }
  }

  // Writes the components of a vector, each limited to [-1, 1].
  static void write_limited(const Vec3& vector, float* out) {
    for (std::size_t axis = 0; axis < kAxes; ++axis) out[axis] = std::clamp(vector[static_cast<Eigen::Index>(axis)], -1.0F, 1.0F);
  }
  // Writes a vector in units of `unit`, shortened to the length 1 if it is longer.
  static void write_shortened(const Vec3& vector, float unit, float* out) {
    write_limited(vector / std::max(vector.norm(), unit), out);
  }

  void visit(ArrayVisitor& visitor) { visitor.fields(rows_); }
  void check() const {
    require_finite(rows_.last_action, "last_action");
    require_finite(rows_.velocity, "velocity");
  }

 private:
  struct Rows {
    std::vector<float> last_action;  // (N, kAxes) clipped
    std::vector<float> velocity;     // (N, 3) m/s, world frame, mean over the last step

    static constexpr auto fields() {
      using C = Rows;
      return field_list(field("last_action", &C::last_action), field("velocity", &C::velocity));
    }
  };

  float step_m_;
  float step_s_ = 0.0F;
  float fastest_ = 0.0F;     // m/s
  std::vector<float> from_;  // (N, 3) m, before the step; used only within a step
  Rows rows_;
};

}  // namespace flockstep::task
