// FlightTask: base of the tasks for rotor-driven drones. Handles the actions and the observation of a drone's own flight.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "base/require.hpp"
#include "dynamics/flight.hpp"
#include "flockstep/task.hpp"
#include "planning/navigable.hpp"
#include "tasks/configured_task.hpp"
#include "tasks/flight_action.hpp"
#include "tasks/flight_gradient.hpp"

namespace flockstep::task {

inline constexpr std::size_t kOwnFlight = 9;  // numbers of the own flight before the rotors' speeds
inline constexpr float kSpinUnit = 10.0F;     // rad/s, unit of observed and scored angular velocities
inline constexpr std::uint32_t kStartStream = 0;

inline Vec3 sensed_velocity_of(const TaskContext& context, DroneIndex drone) {
  const float* const v = context.sensed_velocity().data() + 3 * drone;
  return {v[0], v[1], v[2]};
}
inline Vec3 angular_velocity_of(const State& state, DroneIndex drone) {
  const float* const w = state.flight.angular_velocity.data() + 3 * drone;
  return {w[0], w[1], w[2]};
}

inline Field flight_field(std::size_t size) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {.name = "observation", .shape = {static_cast<std::int64_t>(size)}, .low = {-kInfinity}, .high = {kInfinity}};
}

// Array rows of up to kLanes drones, read in place if the drones are consecutive, otherwise gathered.
class GatheredRows {
 public:
  static constexpr std::size_t kCount = dynamics::kLanes;

  // Takes 1 to kCount drones; the last drone fills the remaining lanes.
  explicit GatheredRows(std::span<const DroneIndex> drones) : drones_(drones) {
    is_contiguous_ = drones.size() == kCount;
    for (std::size_t i = 1; i < drones.size(); ++i) is_contiguous_ &= drones[i] == drones[0] + i;
  }

  std::span<const DroneIndex> drones() const { return drones_; }
  bool is_contiguous() const { return is_contiguous_; }

  // Returns the rows of an array (N, kColumns). They are valid as long as this object.
  template <std::size_t kColumns>
  const float* rows(std::span<const float> array) {
    if (is_contiguous_) return array.data() + kColumns * drones_[0];
    float* const out = gathered_.at(count_++).data();
    for (std::size_t i = 0; i < kCount; ++i) {
      std::copy_n(array.data() + kColumns * drones_[std::min(i, drones_.size() - 1)], kColumns, out + kColumns * i);
    }
    return out;
  }

 private:
  std::span<const DroneIndex> drones_;
  bool is_contiguous_ = false;
  std::size_t count_ = 0;
  std::array<std::array<float, 4 * kCount>, 6> gathered_;
};

// Calls f(rows) for each group of kLanes drones of the list.
template <class F>
void for_each_lanes(std::span<const DroneIndex> drones, const F& f) {
  for (std::size_t first = 0; first < drones.size(); first += GatheredRows::kCount) {
    GatheredRows rows(drones.subspan(first, std::min(GatheredRows::kCount, drones.size() - first)));
    f(rows);
  }
}

class FlightTask : public Task {
 public:
  bool takes(Control control) const override { return control != Control::pose; }

  void setup(const TaskContext& context) override {
    action_.clear();
    rotor_.clear();
    for (const Airframe& frame : context.airframes()) {
      action_.emplace_back(context.dynamics(), frame, max_thrust_to_weight_);
      rotor_.push_back(rotor_speed_ranges(frame));
    }
    num_rotors_ = context.num_rotors();
    num_actions_ = context.command_size();
    step_s_ = context.clock().step_s();
    targets_.resize(3 * context.num_drones());
    target_world_.assign(context.num_drones(), -1);
    action_before_.resize(num_actions_ * context.num_drones());
    action_now_.resize(num_actions_ * context.num_drones());
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    const bool is_marked = world.markers().goal.has_value();
    require_free(world, drone, is_marked ? "markers.goal" : "the middle (markers.goal sets another point)", target_of(world));
  }

  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      std::fill_n(action_before_.data() + num_actions_ * drone, num_actions_, 0.0F);
      std::fill_n(action_now_.data() + num_actions_ * drone, num_actions_, 0.0F);
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    const State& state = block.context.state();
    if (num_actions_ != kActions) return command_rotors(block, actions, setpoints);
    for (const DroneIndex drone : block.drones) {
      const Four action = Four(actions.row<float>(drone).data()).max(-1.0F).min(1.0F);
      const FlightAction& meaning = action_[block.context.airframe_row(drone)];
      Eigen::Map<Four>(setpoints.command.data() + kActions * drone) = meaning.command(action, state, drone);
      Eigen::Map<Four> now(action_now_.data() + kActions * drone);
      Eigen::Map<Four>(action_before_.data() + kActions * drone) = now;
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
  // The goal marker of a world, or the centre of the world if it has none.
  static Vec3 target_of(const World& world) {
    return world.markers().goal.value_or((world.bounds().min + world.bounds().max) / 2.0F);
  }
  Vec3 target_of(const TaskContext& context, DroneIndex drone) {
    const EnvIndex env = context.env_of(drone);
    const std::int32_t world_index = context.state().world_index[env];
    Eigen::Map<Vec3> target(targets_.data() + 3 * drone);
    if (target_world_[drone] != world_index) {
      target = target_of(context.world_of(env));
      target_world_[drone] = world_index;
    }
    return target;
  }
  const float* targets_of(const TaskContext& context, GatheredRows& rows) {
    const std::int32_t* const world_index = context.state().world_index.data();
    for (const DroneIndex drone : rows.drones()) {
      if (target_world_[drone] != world_index[context.env_of(drone)]) target_of(context, drone);
    }
    return rows.rows<3>(targets_);
  }

  // Writes velocity, up vector, angular velocity and rotor speeds to a row.
  void observe_flight(const TaskContext& context, DroneIndex drone, const Mat3& to_body, std::span<float> row) const {
    const State& state = context.state();
    const Vec3 velocity = to_body * sensed_velocity_of(context, drone);
    const Vec3 up = to_body.col(2);
    const Vec3 spin = angular_velocity_of(state, drone) * (1.0F / kSpinUnit);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      row[k] = velocity[axis];
      row[3 + k] = up[axis];
      row[6 + k] = spin[axis];
    }
    const ActionRanges& range = rotor_[context.airframe_row(drone)];
    Eigen::Map<Four>(row.data() + kOwnFlight) = range.action_for(Four(state.flight.rotor_speed.data() + num_rotors_ * drone));
    for (std::size_t k = kMinRotors; k < num_rotors_; ++k) row[kOwnFlight + k] = rotor_level(context, drone, k);
  }

  // The speed of a rotor as the action that commands it; 0 if the drone has no such rotor.
  float rotor_level(const TaskContext& context, DroneIndex drone, std::size_t rotor) const {
    if (rotor >= rotors_of(context, drone)) return 0.0F;
    return rotor_[context.airframe_row(drone)].action_for(context.state().flight.rotor_speed[num_rotors_ * drone + rotor]);
  }

  // The unit of a drone's observed rotor speeds: at hovering, and 1 over the range below and above it.
  std::array<float, 3> rotor_unit(const TaskContext& context, DroneIndex drone) const {
    const ActionRanges& range = rotor_[context.airframe_row(drone)];
    return {range.middle()[0], 1.0F / range.down()[0], 1.0F / range.up()[0]};
  }

  // The mean squared change of the action.
  float change(const TaskContext& context, DroneIndex drone) const {
    if (num_actions_ != kActions) {
      const std::size_t rotors = rotors_of(context, drone);
      float squares = 0.0F;
      for (std::size_t i = num_actions_ * drone; i < num_actions_ * drone + rotors; ++i) {
        squares += (action_now_[i] - action_before_[i]) * (action_now_[i] - action_before_[i]);
      }
      return squares / static_cast<float>(rotors);
    }
    const Four change = Four(action_now_.data() + kActions * drone) - Four(action_before_.data() + kActions * drone);
    return change.square().mean();
  }

  static double spin(const State& state, DroneIndex drone) {
    return static_cast<double>(angular_velocity_of(state, drone).norm() / kSpinUnit);
  }

  static std::size_t rotors_of(const TaskContext& context, DroneIndex drone) {
    return context.airframes()[context.airframe_row(drone)].num_rotors();
  }

  const FlightAction& action_of(const TaskContext& context, DroneIndex drone) const {
    return action_[context.airframe_row(drone)];
  }

  double step_s() const { return step_s_; }
  std::size_t num_rotors() const { return num_rotors_; }    // columns of rotor speeds; 4 before setup()
  std::size_t num_actions() const { return num_actions_; }  // numbers of an action; 4 before setup()
  const std::vector<float>& action_now() const { return action_now_; }
  const std::vector<float>& action_before() const { return action_before_; }

  double max_thrust_to_weight_ = std::numeric_limits<double>::infinity();  // limit of actions, set before setup()

 private:
  // Actions with a number for each rotor, of which the drone may lack some.
  void command_rotors(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) {
    for (const DroneIndex drone : block.drones) {
      const std::span<const float> given = actions.row<float>(drone);
      const FlightAction& meaning = action_[block.context.airframe_row(drone)];
      const std::size_t rotors = rotors_of(block.context, drone);
      for (std::size_t k = 0; k < num_actions_; ++k) {
        const bool is_there = k < rotors;
        const float action = is_there ? std::clamp(given[k], -1.0F, 1.0F) : 0.0F;
        const std::size_t at = num_actions_ * drone + k;
        setpoints.command[at] = is_there ? meaning.rotor(action) : 0.0F;
        action_before_[at] = action_now_[at];
        action_now_[at] = action;
      }
    }
  }

  std::vector<FlightAction> action_;  // by row of the airframes
  std::vector<ActionRanges> rotor_;   // by row of the airframes
  std::size_t num_rotors_ = kMinRotors, num_actions_ = kActions;
  double step_s_ = 0.0;
  std::vector<float> targets_;              // (N, 3) m
  std::vector<std::int32_t> target_world_;  // (N,) world_index of each target; -1: none yet
  std::vector<float> action_before_;        // (N, A) in [-1, 1], previous action; 0 in the first step
  std::vector<float> action_now_;           // (N, A) in [-1, 1], action of the current or last step
};

template <class Config>
class ConfiguredFlightTask : public ConfiguredTask<Config, FlightTask> {
 public:
  void setup(const TaskContext& context) override {
    FlightTask::setup(context);
    this->spec_.action.shape = {static_cast<std::int64_t>(this->num_actions())};
  }

 protected:
  explicit ConfiguredFlightTask(const Config& config)
      : ConfiguredTask<Config, FlightTask>(config, {.name = "action", .shape = {kActions}}) {}
};

// The same for tasks whose loss has derivatives.
template <class Config>
class DifferentiableTask : public ConfiguredFlightTask<Config>, public FlightGradient {
 public:
  const ActionRanges& ranges_of(const TaskContext& context, DroneIndex drone) const override {
    return this->action_of(context, drone).ranges();
  }
  std::span<const float> last_actions() const override { return this->action_now(); }

 protected:
  using ConfiguredFlightTask<Config>::ConfiguredFlightTask;
};

}  // namespace flockstep::task
