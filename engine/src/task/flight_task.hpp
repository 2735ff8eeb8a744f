// FlightTask: what the tasks of drones that fly by their rotors share: actions, and what a drone knows of its own flight.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "base/require.hpp"
#include "dynamics/flight.hpp"
#include "flockstep/task.hpp"
#include "scenario/navigable.hpp"
#include "task/flight_action.hpp"

namespace flockstep::task {

inline constexpr std::size_t kActions = 4;
inline constexpr std::size_t kOwnFlight = 13;
inline constexpr float kSpinUnit = 10.0F;  // rad/s: what angular velocities are observed and scored in
inline constexpr std::uint32_t kStartStream = 0;

inline Vec3 velocity_of(const State& state, std::size_t drone) {
  const float* const v = state.flight.velocity.data() + 3 * drone;
  return {v[0], v[1], v[2]};
}
inline Vec3 angular_velocity_of(const State& state, std::size_t drone) {
  const float* const w = state.flight.angular_velocity.data() + 3 * drone;
  return {w[0], w[1], w[2]};
}

inline Field flight_field(std::size_t size) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {.name = "observation", .shape = {static_cast<std::int64_t>(size)}, .low = {-kInfinity}, .high = {kInfinity}};
}

// Rows of arrays of kLanes drones: where they are where the drones follow each other, else brought together.
class Together {
 public:
  static constexpr std::size_t kCount = dynamics::kLanes;

  // At least one drone, at most kCount; lanes beyond the last repeat it.
  explicit Together(std::span<const std::uint32_t> drones) : drones_(drones) {
    is_row_ = drones.size() == kCount;
    for (std::size_t i = 1; i < drones.size(); ++i) is_row_ &= drones[i] == drones[0] + i;
  }

  std::span<const std::uint32_t> drones() const { return drones_; }
  bool is_row() const { return is_row_; }

  // Of an array (N, kColumns); it holds as long as this.
  template <std::size_t kColumns>
  const float* rows(std::span<const float> array) {
    if (is_row_) return array.data() + kColumns * drones_[0];
    float* const out = brought_.at(count_++).data();
    for (std::size_t i = 0; i < kCount; ++i) {
      std::copy_n(array.data() + kColumns * drones_[std::min(i, drones_.size() - 1)], kColumns, out + kColumns * i);
    }
    return out;
  }

 private:
  std::span<const std::uint32_t> drones_;
  bool is_row_ = false;
  std::size_t count_ = 0;
  std::array<std::array<float, 4 * kCount>, 6> brought_;
};

template <class F>
void for_each_together(std::span<const std::uint32_t> envs, const F& f) {
  for (std::size_t first = 0; first < envs.size(); first += Together::kCount) {
    Together together(envs.subspan(first, std::min(Together::kCount, envs.size() - first)));
    f(together);
  }
}

class FlightTask : public Task {
 public:
  const TaskSpec& spec() const override { return spec_; }
  bool takes(Control control) const override { return control != Control::pose; }

  void setup(const TaskContext& context) override {
    action_ = FlightAction(context.dynamics(), *context.drone_model().airframe());
    rotor_ = rotor_speed_ranges(*context.drone_model().airframe());
    step_s_ = context.clock().step_s();
    middles_.resize(3 * context.num_envs());
    middle_world_.assign(context.num_envs(), -1);
    action_before_.resize(kActions * context.num_envs());
    action_now_.resize(kActions * context.num_envs());
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    const bool is_marked = world.markers().goal.has_value();
    require_free(world, drone, is_marked ? "markers.goal" : "the middle (markers.goal sets another point)", middle_of(world));
  }

  void begin(const TaskBlock& block) override {
    for (const std::uint32_t env : block.envs) {
      std::fill_n(action_before_.begin() + static_cast<std::ptrdiff_t>(kActions * env), kActions, 0.0F);
      std::fill_n(action_now_.begin() + static_cast<std::ptrdiff_t>(kActions * env), kActions, 0.0F);
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    const State& state = block.context.state();
    for (const std::uint32_t env : block.envs) {
      const Four action = Four(actions.row<float>(env).data()).max(-1.0F).min(1.0F);
      Eigen::Map<Four>(setpoints.command.data() + kActions * env) = action_.command(action, state, env);
      Eigen::Map<Four> now(action_now_.data() + kActions * env);
      Eigen::Map<Four>(action_before_.data() + kActions * env) = now;
      now = action;
    }
  }

  void visit(ArrayVisitor& visitor) override {
    visitor.array("action_before", action_before_);
    visitor.array("action_now", action_now_);
  }

  void check() const override {
    for (const auto* actions : {&action_before_, &action_now_}) {
      for (const float action : *actions) require(std::abs(action) <= 1.0F, "snapshot: action", "numbers in [-1, 1]", action);
    }
  }

 protected:
  explicit FlightTask(std::vector<std::string> reward_terms) {
    spec_.action = {.name = "action", .shape = {kActions}};
    spec_.reward_terms = std::move(reward_terms);
  }

  // The goal marker of a world, or the middle of it.
  static Vec3 middle_of(const World& world) {
    return world.markers().goal.value_or((world.bounds().min + world.bounds().max) / 2.0F);
  }
  Vec3 middle_of(const TaskContext& context, std::size_t env) {
    const std::int32_t world_index = context.state().world_index[env];
    const Eigen::Map<Vec3> middle(middles_.data() + 3 * env);
    if (middle_world_[env] != world_index) {
      Eigen::Map<Vec3>(middles_.data() + 3 * env) = middle_of(context.world_of(env));
      middle_world_[env] = world_index;
    }
    return middle;
  }
  const float* middles_of(const TaskContext& context, Together& envs) {
    const std::int32_t* const world_index = context.state().world_index.data();
    for (const std::uint32_t env : envs.drones()) {
      if (middle_world_[env] != world_index[env]) middle_of(context, env);
    }
    return envs.rows<3>(middles_);
  }

  // Velocity, up, angular velocity, rotor speeds.
  void observe_flight(const State& state, std::size_t drone, const Mat3& to_body, std::span<float> row) const {
    const Vec3 velocity = to_body * velocity_of(state, drone);
    const Vec3 up = to_body.col(2);
    const Vec3 spin = angular_velocity_of(state, drone) * (1.0F / kSpinUnit);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      row[k] = velocity[axis];
      row[3 + k] = up[axis];
      row[6 + k] = spin[axis];
    }
    Eigen::Map<Four>(row.data() + 9) = rotor_.action_for(Four(state.flight.rotor_speed.data() + kRotors * drone));
  }

  // Mean square of what the action changed by.
  float change(std::size_t env) const {
    const Four change = Four(action_now_.data() + kActions * env) - Four(action_before_.data() + kActions * env);
    return change.square().mean();
  }

  static double spin(const State& state, std::size_t drone) {
    return static_cast<double>(angular_velocity_of(state, drone).norm() / kSpinUnit);
  }

  double step_s() const { return step_s_; }
  const std::vector<float>& action_now() const { return action_now_; }
  const std::vector<float>& action_before() const { return action_before_; }

  TaskSpec spec_;

 private:
  FlightAction action_;
  ActionRanges rotor_;
  double step_s_ = 0.0;
  std::vector<float> middles_;              // (E, 3) m
  std::vector<std::int32_t> middle_world_;  // (E,) world_index that it is of; -1: none yet
  std::vector<float> action_before_;        // (E, 4) in [-1, 1], of the step before; 0 in the first
  std::vector<float> action_now_;           // (E, 4) likewise, of the present or last step
};

}  // namespace flockstep::task
