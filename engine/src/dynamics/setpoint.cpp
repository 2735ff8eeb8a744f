#include "dynamics/setpoint.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace flockstep::dynamics {

float yaw_of(const Quat& q) {
  return std::atan2(2.0F * (q.x() * q.y() + q.w() * q.z()), 1.0F - 2.0F * (q.y() * q.y() + q.z() * q.z()));
}

Setpoint setpoint_of(Control control, const Airframe& frame, const float* command, const float* position) {
  const float a = command[0], b = command[1], c = command[2], d = command[3];
  switch (control) {
    case Control::rotor_speeds:
    case Control::rotor_thrusts: {
      Setpoint speeds{};
      for (std::size_t i = 0; i < frame.num_rotors(); ++i) {
        const double given = static_cast<double>(command[i]);
        const double speed = control == Control::rotor_speeds ? given : frame.speed_for(given);
        speeds[i] = static_cast<float>(std::clamp(speed, frame.min_speed_radps, frame.max_speed_radps));
      }
      return speeds;
    }
    case Control::body_rates:
    case Control::velocity:
    case Control::heading_velocity:
      return {a, b, c, d};
    case Control::attitude: {
      // R_z(yaw) R_y(pitch) R_x(roll) e3
      const float cr = std::cos(b), sr = std::sin(b), cp = std::cos(c), sp = std::sin(c), cy = std::cos(d), sy = std::sin(d);
      return {a, cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr, cy, sy};
    }
    case Control::acceleration:
      return {a, b, c, std::cos(d), std::sin(d)};
    default: {  // position
      const Vec3 way = Vec3(a, b, c) - Vec3::Map(position);
      return {way.x(), way.y(), way.z(), std::cos(d), std::sin(d)};
    }
  }
}

Setpoint setpoint_of(const Pose& from, const Pose& target, float step_s) {
  const Vec3 velocity = (target.position - from.position) / step_s;
  const float turn = std::remainder(yaw_of(target.rotation) - yaw_of(from.rotation), 2.0F * std::numbers::pi_v<float>);
  return {velocity.x(), velocity.y(), velocity.z(), turn / step_s};
}

}  // namespace flockstep::dynamics
