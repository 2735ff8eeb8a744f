// FlightAction: converts actions in [-1, 1] to commands of rotor-driven drones.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>

#include "dynamics/setpoint.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/state.hpp"

namespace flockstep::task {

inline constexpr std::size_t kActions = 4;

using Four = Eigen::Array4f;  // a vector avoids branches: the signs of actions are unpredictable

// Piecewise linear range of one action: low at -1, middle at 0, high at 1.
struct ActionRange {
  double low = -1.0, middle = 0.0, high = 1.0;
};

class ActionRanges {
 public:
  ActionRanges() : ActionRanges(ActionRange(), ActionRange(), ActionRange(), ActionRange()) {}
  ActionRanges(const ActionRange& a, const ActionRange& b, const ActionRange& c, const ActionRange& d) {
    const std::array ranges{a, b, c, d};
    for (std::size_t k = 0; k < ranges.size(); ++k) {
      const auto [low, middle, high] = ranges[k];
      const auto at = static_cast<Eigen::Index>(k);
      middle_[at] = static_cast<float>(middle);
      down_[at] = static_cast<float>(middle - low);
      up_[at] = static_cast<float>(high - middle);
      inverse_down_[at] = static_cast<float>(1.0 / (middle - low));
      inverse_up_[at] = static_cast<float>(1.0 / (high - middle));
    }
  }

  // Returns the values for an action within [-1, 1].
  Four at(const Four& action) const { return middle_ + (action.min(0.0F) * down_ + action.max(0.0F) * up_); }
  // The same for one of several alike numbers: those of rotors.
  float at(float action) const { return at(Four(Four::Constant(action)))[0]; }
  const Four& middle() const { return middle_; }  // at 0
  const Four& down() const { return down_; }      // magnitude of the change to -1
  const Four& up() const { return up_; }          // change to 1
  // Inverse of at(). Values beyond the range give actions beyond [-1, 1].
  Four action_for(const Four& value) const {
    const Four away = value - middle_;
    return away.min(0.0F) * inverse_down_ + away.max(0.0F) * inverse_up_;
  }
  float action_for(float value) const { return action_for(Four(Four::Constant(value)))[0]; }

 private:
  Four middle_, down_, up_, inverse_down_, inverse_up_;
};

// Rotor speeds, rad/s; an action of 0 is hover speed. most_n: limit of a rotor's commanded thrust.
inline ActionRanges rotor_speed_ranges(const Airframe& frame, double most_n = std::numeric_limits<double>::infinity()) {
  const double fastest = most_n < frame.max_thrust() ? frame.speed_for(most_n) : frame.max_speed_radps;
  const ActionRange range{frame.min_speed_radps, frame.hover_speed(), fastest};
  return {range, range, range, range};
}

// True if an action of this control commands a thrust.
inline bool commands_thrust(Control control) {
  return control == Control::rotor_speeds || control == Control::rotor_thrusts || control == Control::body_rates ||
         control == Control::attitude;
}

// The meaning of an action for each control. 0 hovers, and 1 is the maximum:
//   rotor_speeds, rotor_thrusts   from the slowest speed of the rotors over hovering to the fastest
//   body_rates                    thrust in the same range; rates up to max_rate_dps and max_yaw_rate_dps
//   attitude                      thrust in the same range; roll and pitch up to max_tilt_deg; yaw up to half a turn from the
//                                 current heading
//   acceleration                  up to max_acceleration_mps2 along each axis; yaw as for attitude
//   velocity, heading_velocity    up to max_speed_mps along each axis; yaw rate up to max_yaw_rate_dps
//   position                      up to 1 m from the current position along each axis of the world; yaw as for attitude
class FlightAction {
 public:
  FlightAction() = default;
  // max_thrust_to_weight: limit of the commanded total thrust over the weight, for controls that command a thrust.
  FlightAction(const DynamicsConfig& config, const Airframe& frame,
               double max_thrust_to_weight = std::numeric_limits<double>::infinity())
      : control_(config.control) {
    const auto even = [](double most) { return ActionRange{-most, 0.0, most}; };
    const auto radians = [](float degrees) { return static_cast<double>(degrees) * std::numbers::pi / 180.0; };
    const double half_turn = std::numbers::pi;
    const double max_speed = static_cast<double>(config.max_speed_mps);
    const double max_acceleration = static_cast<double>(config.max_acceleration_mps2);
    const double to_acceleration = static_cast<double>(frame.num_rotors()) / frame.mass_kg;
    const double least = frame.thrust_at(frame.min_speed_radps);
    const double most = std::min(to_acceleration * frame.max_thrust(), max_thrust_to_weight * kGravity);
    const double hover_n = frame.mass_kg * kGravity / static_cast<double>(frame.num_rotors());  // one rotor's thrust
    const ActionRange thrust{to_acceleration * least, kGravity, most};
    const ActionRange rotor{least, hover_n, std::min(frame.max_thrust(), max_thrust_to_weight * hover_n)};
    const ActionRange rate = even(radians(config.max_rate_dps)), yaw_rate = even(radians(config.max_yaw_rate_dps));
    const ActionRange tilt = even(radians(config.max_tilt_deg)), yaw = even(half_turn);
    switch (control_) {
      case Control::rotor_speeds:
        ranges_ = rotor_speed_ranges(frame, max_thrust_to_weight * hover_n);
        break;
      case Control::rotor_thrusts:
        ranges_ = {rotor, rotor, rotor, rotor};
        break;
      case Control::body_rates:
        ranges_ = {thrust, rate, rate, yaw_rate};
        break;
      case Control::attitude:
        ranges_ = {thrust, tilt, tilt, yaw};
        break;
      case Control::acceleration:
        ranges_ = {even(max_acceleration), even(max_acceleration), even(max_acceleration), yaw};
        break;
      case Control::velocity:
      case Control::heading_velocity:
        ranges_ = {even(max_speed), even(max_speed), even(max_speed), yaw_rate};
        break;
      case Control::position:
        ranges_ = {even(1.0), even(1.0), even(1.0), yaw};
        break;
      case Control::pose:
        break;
    }
  }

  // Writes the command for an action of as many numbers, which are clipped to [-1, 1].
  void command(std::span<const float> action, const State& state, DroneIndex drone, float* out) const {
    if (action.size() == 4) {
      Eigen::Map<Four>{out} = command(Four(action.data()).max(-1.0F).min(1.0F), state, drone);
      return;
    }
    for (const float number : action) *out++ = rotor(std::clamp(number, -1.0F, 1.0F));
  }
  // The command of one rotor. action: within [-1, 1].
  float rotor(float action) const { return ranges_.at(action); }
  // Commands by action, of controls whose commands do not depend on the drone's state.
  const ActionRanges& ranges() const { return ranges_; }
  // action: within [-1, 1].
  Four command(const Four& action, const State& state, DroneIndex drone) const {
    Four command = ranges_.at(action);
    if (control_ == Control::position) command.head<3>() += position_of(state, drone).array();
    if (control_ == Control::attitude || control_ == Control::acceleration || control_ == Control::position) {
      command[3] += dynamics::yaw_of(pose_of(state, drone).rotation);
    }
    return command;
  }

 private:
  Control control_ = Control::pose;
  ActionRanges ranges_;
};

}  // namespace flockstep::task
