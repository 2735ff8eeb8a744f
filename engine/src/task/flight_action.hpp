// FlightAction: what actions in [-1, 1] tell drones that fly by their rotors.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <numbers>
#include <span>

#include "dynamics/setpoint.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::task {

// A number that an action goes through from low over middle to high, in two straight lines: at -1, 0 and 1.
class ActionRange {
 public:
  ActionRange() = default;
  ActionRange(double low, double middle, double high)
      : middle_(static_cast<float>(middle)),
        down_(static_cast<float>(middle - low)),
        up_(static_cast<float>(high - middle)),
        inverse_down_(static_cast<float>(1.0 / (middle - low))),
        inverse_up_(static_cast<float>(1.0 / (high - middle))) {}

  float at(float action) const {
    const float a = std::clamp(action, -1.0F, 1.0F);
    return middle_ + a * (a < 0.0F ? down_ : up_);
  }
  // The action that tells this; beyond the range it is beyond [-1, 1].
  float action_for(float value) const { return (value - middle_) * (value < middle_ ? inverse_down_ : inverse_up_); }

 private:
  float middle_ = 0.0F, down_ = 1.0F, up_ = 1.0F, inverse_down_ = 1.0F, inverse_up_ = 1.0F;
};

// A rotor's speed, rad/s: at 0 as in hovering.
inline ActionRange rotor_speed_range(const Airframe& frame) {
  return {frame.min_speed_radps, frame.hover_speed(), frame.max_speed_radps};
}

// By control, 0 hovers and 1 is the most:
//   rotor_speeds, rotor_thrusts   from the slowest over hovering to the fastest the rotors can
//   body_rates                    thrust likewise; rates up to max_rate_dps and max_yaw_rate_dps
//   attitude                      thrust likewise; roll and pitch up to max_tilt_deg; yaw from the present heading, half a turn
//   acceleration                  up to max_acceleration_mps2 along each axis; yaw likewise
//   velocity, heading_velocity    up to max_speed_mps along each axis; yaw rate up to max_yaw_rate_dps
//   position                      up to 1 m from where the drone is along each axis of the world; yaw likewise
class FlightAction {
 public:
  FlightAction() = default;
  FlightAction(const DynamicsConfig& config, const Airframe& frame) : control_(config.control) {
    const auto even = [](double most) { return ActionRange(-most, 0.0, most); };
    const auto radians = [](float degrees) { return static_cast<double>(degrees) * std::numbers::pi / 180.0; };
    const double half_turn = std::numbers::pi;
    const double max_speed = static_cast<double>(config.max_speed_mps);
    const double max_acceleration = static_cast<double>(config.max_acceleration_mps2);
    const double to_acceleration = static_cast<double>(kRotors) / frame.mass_kg;
    const double least = frame.thrust_at(frame.min_speed_radps);
    const ActionRange thrust{to_acceleration * least, kGravity, to_acceleration * frame.max_thrust()};
    const ActionRange rate = even(radians(config.max_rate_dps)), yaw_rate = even(radians(config.max_yaw_rate_dps));
    const ActionRange tilt = even(radians(config.max_tilt_deg)), yaw = even(half_turn);
    switch (control_) {
      case Control::rotor_speeds:
        ranges_.fill(rotor_speed_range(frame));
        break;
      case Control::rotor_thrusts:
        ranges_.fill({least, frame.mass_kg * kGravity / static_cast<double>(kRotors), frame.max_thrust()});
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

  std::array<float, 4> command(std::span<const float> action, const Pose& now) const {
    std::array<float, 4> command;
    for (std::size_t k = 0; k < 4; ++k) command[k] = ranges_[k].at(action[k]);
    if (control_ == Control::position) {
      for (std::size_t k = 0; k < 3; ++k) command[k] += now.position[static_cast<Eigen::Index>(k)];
    }
    if (control_ == Control::attitude || control_ == Control::acceleration || control_ == Control::position) {
      command[3] += dynamics::yaw_of(now.rotation);
    }
    return command;
  }

 private:
  Control control_ = Control::pose;
  std::array<ActionRange, 4> ranges_{};
};

}  // namespace flockstep::task
