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
#include "flockstep/task.hpp"
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

// What scores are made of, of some drones side by side: roots, quotients and exponentials take vectors.
class Together {
 public:
  static constexpr std::size_t kCount = 16;
  using Floats = Eigen::Array<float, kCount, 1>;
  using Doubles = Eigen::Array<double, kCount, 1>;

  void set_way(std::size_t i, const Vec3& from, const Vec3& to) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<Eigen::Index>(axis);
      way_[axis][static_cast<Eigen::Index>(i)] = static_cast<double>(from[k]) - static_cast<double>(to[k]);
    }
  }
  void set_flight(std::size_t i, const State& state, std::size_t drone) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      velocity_[axis][static_cast<Eigen::Index>(i)] = state.flight.velocity[3 * drone + axis];
      spin_[axis][static_cast<Eigen::Index>(i)] = state.flight.angular_velocity[3 * drone + axis];
    }
  }

  Doubles distance() const { return norm(way_); }   // m
  Floats speed() const { return norm(velocity_); }  // m/s
  Floats spin() const { return norm(spin_) / kSpinUnit; }

 private:
  template <class Lanes>
  static Lanes norm(const std::array<Lanes, 3>& v) {
    return (v[0].square() + v[1].square() + v[2].square()).sqrt();
  }

  std::array<Doubles, 3> way_{Doubles::Zero(), Doubles::Zero(), Doubles::Zero()};
  std::array<Floats, 3> velocity_{Floats::Zero(), Floats::Zero(), Floats::Zero()};
  std::array<Floats, 3> spin_{Floats::Zero(), Floats::Zero(), Floats::Zero()};
};

template <class F>
void for_each_together(std::span<const std::uint32_t> envs, const F& f) {
  for (std::size_t first = 0; first < envs.size(); first += Together::kCount) {
    f(envs.subspan(first, std::min(Together::kCount, envs.size() - first)));
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
    middles_.resize(context.num_envs());
    action_before_.resize(kActions * context.num_envs());
    action_now_.resize(kActions * context.num_envs());
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

  // The goal marker of an env's world, or the middle of it.
  const Vec3& middle_of(const TaskContext& context, std::size_t env) {
    Middle& middle = middles_[env];
    const std::int32_t world_index = context.state().world_index[env];
    if (middle.world_index != world_index) {
      const World& world = context.world_of(env);
      middle = {world.markers().goal.value_or((world.bounds().min + world.bounds().max) / 2.0F), world_index};
    }
    return middle.at;
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

  TaskSpec spec_;

 private:
  struct Middle {
    Vec3 at = Vec3::Zero();         // m
    std::int32_t world_index = -1;  // of the world that it is of
  };

  FlightAction action_;
  ActionRanges rotor_;
  double step_s_ = 0.0;
  std::vector<Middle> middles_;       // (E,)
  std::vector<float> action_before_;  // (E, 4) in [-1, 1], of the step before; 0 in the first
  std::vector<float> action_now_;     // (E, 4) likewise, of the present or last step
};

}  // namespace flockstep::task
