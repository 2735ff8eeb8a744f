#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "dynamics/flight.hpp"

namespace flockstep::dynamics {
namespace {

constexpr double kFastest = 0.25;      // of the controller's own rate: the fastest loop that it can close
constexpr double kYawShare = 1.0 / 3;  // yaw torque is small, and what it takes is taken from the rest
constexpr double kIntegralShare = 0.1;
constexpr double kUsualLag = 0.035;  // s
constexpr double kMostLead = 4.0;

float narrow(double value) { return static_cast<float>(value); }

std::array<float, 3> narrow(const Airframe::Triple& values) { return {narrow(values[0]), narrow(values[1]), narrow(values[2])}; }

double radians(float degrees) { return static_cast<double>(degrees) * std::numbers::pi / 180.0; }

bool any(const Airframe::Triple& values) {
  return std::any_of(values.begin(), values.end(), [](double value) { return value != 0.0; });
}

}  // namespace

Stage stage_of(Control control) {
  switch (control) {
    case Control::rotor_speeds:
    case Control::rotor_thrusts:
      return Stage::rotors;
    case Control::body_rates:
      return Stage::rates;
    case Control::attitude:
      return Stage::attitude;
    case Control::acceleration:
      return Stage::acceleration;
    case Control::heading_velocity:
      return Stage::heading_velocity;
    case Control::position:
      return Stage::position;
    default:
      return Stage::velocity;
  }
}

Gains Gains::of(const Airframe& frame, const DynamicsConfig& config, double control_dt_s) {
  const double lag = config.rotor_lag ? 0.5 * (frame.lag_up_s + frame.lag_down_s) : 0.0;
  Gains gains;
  gains.lead = std::clamp(lag / kUsualLag, 1.0, kMostLead);
  gains.rate = std::min(lag > 0.0 ? 0.5 * gains.lead / lag : kFastest / control_dt_s, kFastest / control_dt_s);
  gains.yaw_rate = kYawShare * gains.rate;
  gains.attitude = gains.rate / 3.0;
  gains.yaw = kYawShare * gains.attitude;
  gains.velocity = gains.attitude / 3.0;
  gains.integral = kIntegralShare * gains.velocity * gains.velocity;
  gains.position = gains.velocity / 2.0;
  return gains;
}

bool can_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s) {
  const auto fits = [dt_s](double lag) { return lag == 0.0 || dt_s <= 2.0 * lag; };
  return !config.rotor_lag || (fits(frame.lag_up_s) && fits(frame.lag_down_s));
}

double stiffness(const Airframe& frame, const DynamicsConfig& config) {
  // Of the drag: the force or torque for a unit of velocity or turn, over mass or inertia.
  const double rotors = config.rotor_drag ? frame.max_speed_radps : 0.0;
  const double body = config.body_drag ? 1.0 : 0.0;
  const auto& drag = frame.rotor_drag;
  double fastest = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double linear =
        body * (frame.linear_drag[axis] + 2.0 * frame.quadratic_drag[axis] * static_cast<double>(config.max_speed_mps));
    fastest = std::max(fastest, (kRotors * rotors * drag[axis] + linear) / frame.mass_kg);
    const std::size_t second = (axis + 1) % 3, third = (axis + 2) % 3;
    double torque = 0.0;
    for (const auto& at : frame.position_m) {
      torque += rotors * (at[second] * at[second] * drag[third] + at[third] * at[third] * drag[second]);
    }
    fastest = std::max(fastest, torque / frame.inertia_kgm2[axis]);
  }
  // Of the spin, if two opposite rotors are at full speed and the others at rest.
  const double momentum = config.gyroscopic ? 2.0 * frame.rotor_inertia_kgm2 * frame.max_speed_radps : 0.0;
  const double slowest = std::sqrt(frame.inertia_kgm2[0] * frame.inertia_kgm2[1]);
  return std::max(fastest, momentum / slowest);
}

Physics::Physics(const Airframe& frame, const DynamicsConfig& config, double dt_s, int ticks)
    : stage(stage_of(config.control)),
      is_rk4(config.integrator == Integrator::rk4 ||
             (config.integrator == Integrator::automatic && config.tells_rotors() && can_rk4(frame, config, dt_s))),
      rotor_drag(config.rotor_drag && any(frame.rotor_drag)),
      rotor_lift(config.rotor_drag && frame.rotor_lift != 0.0),
      body_drag(config.body_drag && (any(frame.linear_drag) || any(frame.quadratic_drag))),
      gyroscopic(config.gyroscopic && frame.rotor_inertia_kgm2 != 0.0),
      ground_effect(config.ground_effect && frame.radius_m != 0.0),
      control_ticks(ticks),
      dt(narrow(dt_s)) {
  max_turn = std::min(narrow(std::numbers::pi / dt_s), kMaxSpeed);
  inverse_mass = narrow(1.0 / frame.mass_kg);
  mass = narrow(frame.mass_kg);
  inertia = narrow(frame.inertia_kgm2);
  for (std::size_t i = 0; i < 3; ++i) inverse_inertia[i] = narrow(1.0 / frame.inertia_kgm2[i]);
  linear_drag = narrow(frame.linear_drag);
  quadratic_drag = narrow(frame.quadratic_drag);

  Eigen::Matrix4d allocation;  // thrust, and torque about x, y, z, by the thrust of each rotor
  for (std::size_t i = 0; i < kRotors; ++i) {
    position[i] = narrow(frame.position_m[i]);
    yaw_sign[i] = frame.spin[i] == Spin::ccw ? -1.0F : 1.0F;
    allocation.col(static_cast<Eigen::Index>(i)) << 1.0, frame.position_m[i][1], -frame.position_m[i][0],
        static_cast<double>(yaw_sign[i]) * frame.torque_ratio_m;
  }
  const Eigen::Matrix4d inverse = allocation.inverse();
  for (std::size_t i = 0; i < kRotors; ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      mixer[i][k] = narrow(inverse(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)));
    }
  }
  thrust = narrow(frame.thrust_n);
  torque_ratio = narrow(frame.torque_ratio_m);
  min_speed = narrow(frame.min_speed_radps);
  max_speed = narrow(frame.max_speed_radps);
  min_thrust = narrow(frame.thrust_at(frame.min_speed_radps));
  max_thrust = narrow(frame.max_thrust());
  const double up = config.rotor_lag ? frame.lag_up_s : 0.0;
  const double down = config.rotor_lag ? frame.lag_down_s : 0.0;
  const auto keep = [](double time, double lag) { return lag > 0.0 ? narrow(std::exp(-time / lag)) : 0.0F; };
  keep_half_up = keep(dt_s / 2.0, up);
  keep_up = keep(dt_s, up);
  keep_half_down = keep(dt_s / 2.0, down);
  keep_down = keep(dt_s, down);
  inverse_lag_up = up > 0.0 ? narrow(1.0 / up) : 0.0F;
  inverse_lag_down = down > 0.0 ? narrow(1.0 / down) : 0.0F;
  rotor_inertia = narrow(frame.rotor_inertia_kgm2);
  drag = narrow(frame.rotor_drag);
  lift = narrow(frame.rotor_lift);
  ground_quarter = narrow(frame.radius_m / 4.0);
  least_height = narrow(frame.radius_m / 2.0);

  control_dt = narrow(dt_s * ticks);
  const Gains gains = Gains::of(frame, config, dt_s * ticks);
  lead = narrow(gains.lead);
  rate_gain = narrow(gains.rate);
  yaw_rate_gain = narrow(gains.yaw_rate);
  attitude_gain = narrow(gains.attitude);
  yaw_gain = narrow(gains.yaw);
  velocity_gain = narrow(gains.velocity);
  integral_gain = narrow(gains.integral);
  position_gain = narrow(gains.position);
  max_rate = narrow(radians(config.max_rate_dps));
  max_yaw_rate = narrow(radians(config.max_yaw_rate_dps));
  max_speed_mps = config.max_speed_mps;
  max_acceleration = config.max_acceleration_mps2;
  max_tilt_tan = narrow(std::tan(radians(config.max_tilt_deg)));
  max_integral = narrow(0.5 * static_cast<double>(config.max_acceleration_mps2) / gains.integral);  // half of the acceleration
}

}  // namespace flockstep::dynamics
