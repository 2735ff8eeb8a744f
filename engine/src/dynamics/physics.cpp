#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numbers>
#include <optional>

#include "dynamics/flight.hpp"
#include "dynamics/lane_group.hpp"
#include "dynamics/parameters.hpp"

namespace flockstep::dynamics {
namespace {

constexpr double kFastest = 0.25;      // fastest loop, as a share of the controller's rate
constexpr double kYawShare = 1.0 / 3;  // yaw torque is small and takes thrust from the other axes
constexpr double kIntegralShare = 0.1;
constexpr double kUsualLag = 0.035;  // s
constexpr double kMaxLead = 4.0;

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
  const ControllerConfig& given = config.controller;
  const auto or_else = [](const std::optional<float>& value, double otherwise) {
    return value ? static_cast<double>(*value) : otherwise;
  };
  const double lag = config.rotor_lag ? 0.5 * (frame.lag_up_s + frame.lag_down_s) : 0.0;
  const double fastest = kFastest / control_dt_s;
  Gains gains;
  gains.lead = or_else(given.lead, std::clamp(lag / kUsualLag, 1.0, kMaxLead));
  gains.rate = std::min(or_else(given.rate_gain_per_s, lag > 0.0 ? 0.5 * gains.lead / lag : fastest), fastest);
  gains.yaw_rate = std::min(or_else(given.yaw_rate_gain_per_s, kYawShare * gains.rate), fastest);
  gains.attitude = or_else(given.attitude_gain_per_s, gains.rate / 3.0);
  gains.yaw = or_else(given.yaw_gain_per_s, kYawShare * gains.attitude);
  gains.velocity = or_else(given.velocity_gain_per_s, gains.attitude / 3.0);
  gains.integral = or_else(given.velocity_integral_per_s2, kIntegralShare * gains.velocity * gains.velocity);
  gains.position = or_else(given.position_gain_per_s, gains.velocity / 2.0);
  return gains;
}

bool can_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s) {
  const auto fits = [dt_s](double lag) { return lag == 0.0 || dt_s <= 2.0 * lag; };
  return !config.rotor_lag || (fits(frame.lag_up_s) && fits(frame.lag_down_s));
}

double stiffness(const Airframe& frame, const DynamicsConfig& config) {
  // Drag: force per velocity over mass, or torque per angular velocity over inertia.
  const double rotors = config.rotor_drag ? frame.max_speed_radps : 0.0;
  const double body = config.body_drag ? 1.0 : 0.0;
  const auto& drag = frame.rotor_drag;
  double fastest = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double linear =
        body * (frame.linear_drag[axis] + 2.0 * frame.quadratic_drag[axis] * static_cast<double>(config.max_speed_mps));
    fastest = std::max(fastest, (static_cast<double>(frame.num_rotors()) * rotors * drag[axis] + linear) / frame.mass_kg);
    const std::size_t second = (axis + 1) % 3, third = (axis + 2) % 3;
    double torque = 0.0;
    for (const auto& at : frame.position_m) {
      torque += rotors * (at[second] * at[second] * drag[third] + at[third] * at[third] * drag[second]);
    }
    fastest = std::max(fastest, torque / frame.inertia_kgm2[axis]);
  }
  // Rotor spin: half of the rotors at full speed, those that turn the other way at rest.
  const double half = 0.5 * static_cast<double>(frame.num_rotors());
  const double momentum = config.gyroscopic ? half * frame.rotor_inertia_kgm2 * frame.max_speed_radps : 0.0;
  const double slowest = std::sqrt(frame.inertia_kgm2[0] * frame.inertia_kgm2[1]);
  return std::max(fastest, momentum / slowest);
}

namespace {

// Sets the gains of a controller that scales them.
void set_gains(const Gains& gains, const DroneParameters& scales, const DynamicsConfig& config, AirframeNumbers<float>& n) {
  const float rate = narrow(gains.rate) * scales.rate_gain_scale, yaw_rate = narrow(gains.yaw_rate) * scales.rate_gain_scale;
  const auto& inertia = n.known_inertia;
  n.rate_torque = {inertia[0] * rate, inertia[1] * rate, inertia[2] * yaw_rate};
  n.attitude_gain = narrow(gains.attitude) * scales.attitude_gain_scale;
  n.twice_attitude_gain = 2.0F * n.attitude_gain;
  n.yaw_gain = narrow(gains.yaw) * scales.attitude_gain_scale;
  n.velocity_gain = narrow(gains.velocity) * scales.velocity_gain_scale;
  n.integral_gain = narrow(gains.integral) * scales.velocity_gain_scale;
  n.position_gain = narrow(gains.position) * scales.position_gain_scale;
  n.max_integral = narrow(0.5 * static_cast<double>(config.max_acceleration_mps2) / gains.integral) /
                   scales.velocity_gain_scale;  // half the acceleration
}

// Sets the coefficients of the body and of the rotors.
void set_body(const Airframe& frame, const DynamicsConfig& config, double dt_s, AirframeNumbers<float>& n) {
  n.inverse_mass = narrow(1.0 / frame.mass_kg);
  n.inertia = narrow(frame.inertia_kgm2);
  for (std::size_t i = 0; i < 3; ++i) n.inverse_inertia[i] = narrow(1.0 / frame.inertia_kgm2[i]);
  n.linear_drag = narrow(frame.linear_drag);
  n.quadratic_drag = narrow(frame.quadratic_drag);
  const auto torque_ratio = narrow(frame.torque_ratio_m);
  for (std::size_t i = 0; i < frame.num_rotors(); ++i) {
    RotorNumbers<float>& rotor = n.rotors[i];
    rotor.position = narrow(frame.position_m[i]);
    rotor.yaw_sign = frame.spin[i] == Spin::ccw ? -1.0F : 1.0F;
    rotor.yaw_torque = rotor.yaw_sign * torque_ratio;
    rotor.thrust = narrow(frame.thrust_n);
  }
  const double up = config.rotor_lag ? frame.lag_up_s : 0.0;
  const double down = config.rotor_lag ? frame.lag_down_s : 0.0;
  const auto keep = [](double time, double lag) { return lag > 0.0 ? narrow(std::exp(-time / lag)) : 0.0F; };
  n.keep_half_up = keep(dt_s / 2.0, up);
  n.keep_up = keep(dt_s, up);
  n.keep_half_down = keep(dt_s / 2.0, down);
  n.keep_down = keep(dt_s, down);
  n.inverse_lag_up = up > 0.0 ? narrow(1.0 / up) : 0.0F;
  n.inverse_lag_down = down > 0.0 ? narrow(1.0 / down) : 0.0F;
  n.rotor_inertia = narrow(frame.rotor_inertia_kgm2);
  n.drag = narrow(frame.rotor_drag);
  n.lift = narrow(frame.rotor_lift);
  n.ground_quarter = narrow(frame.radius_m / 4.0);
  n.least_height = std::max(narrow(frame.radius_m / 2.0), 1e-6F);
}

}  // namespace

AirframeNumbers<float> numbers_of(const Airframe& frame, const DynamicsConfig& config, double dt_s, double control_dt_s) {
  AirframeNumbers<float> n;
  set_body(frame, config, dt_s, n);
  n.mass = narrow(frame.mass_kg);
  n.known_inertia = n.inertia;
  const auto num_rotors = static_cast<Eigen::Index>(frame.num_rotors());
  Eigen::Matrix4Xd allocation(4, num_rotors);  // from rotor thrusts to total thrust and torque about x, y, z
  for (std::size_t i = 0; i < frame.num_rotors(); ++i) {
    allocation.col(static_cast<Eigen::Index>(i)) << 1.0, frame.position_m[i][1], -frame.position_m[i][0],
        static_cast<double>(n.rotors[i].yaw_sign) * frame.torque_ratio_m;
  }
  // With more than four rotors, the thrusts with the least sum of squares. Of small matrices, Eigen multiplies all lazily, but
  // would compile the product of large ones, too.
  Eigen::MatrixXd inverse = Eigen::Matrix4d(allocation.leftCols<4>()).inverse();
  const Eigen::Matrix4d squares = allocation.lazyProduct(allocation.transpose());
  if (num_rotors > 4) inverse = allocation.transpose() * squares.inverse();
  for (std::size_t i = 0; i < kMaxRotors; ++i) {
    const auto row = static_cast<Eigen::Index>(i < frame.num_rotors() ? i : 0);
    for (std::size_t k = 0; k < 4; ++k) n.rotors[i].mixer[k] = narrow(inverse(row, static_cast<Eigen::Index>(k)));
  }
  n.known_thrust = narrow(frame.thrust_n);
  const auto [c0, c1, c2] = n.known_thrust;
  const bool is_linear = !(c2 > 0.0F);
  n.discriminant = c1 * c1 - 4.0F * c2 * c0;
  n.four_c2 = 4.0F * c2;
  n.half_over_c2 = is_linear ? 0.0F : 0.5F / c2;
  n.one_over_c1 = is_linear ? 1.0F / c1 : 0.0F;
  n.min_speed = narrow(frame.min_speed_radps);
  n.max_speed = narrow(frame.max_speed_radps);
  const float most = narrow(frame.max_thrust());
  n.min_thrust = std::max(narrow(frame.thrust_at(frame.min_speed_radps)), config.controller.min_throttle * most);
  n.max_thrust = config.controller.max_throttle * most;
  n.thrust_tiny = 1e-6F * n.max_thrust;
  const Gains gains = Gains::of(frame, config, control_dt_s);
  n.lead = narrow(gains.lead);
  set_gains(gains, {}, config, n);
  return n;
}

AirframeNumbers<float> numbers_of(const Airframe& frame, const Airframe& made, const AirframeNumbers<float>& known,
                                  const DroneParameters& parameters, const DynamicsConfig& config, double dt_s,
                                  double control_dt_s) {
  AirframeNumbers<float> n = known;
  set_body(made, config, dt_s, n);
  for (std::size_t i = 0; i < frame.num_rotors(); ++i) {
    for (float& c : n.rotors[i].thrust) c *= parameters.rotor_thrust_scale[i];
  }
  set_gains(Gains::of(frame, config, control_dt_s), parameters, config, n);
  return n;
}

Physics::Physics(const Airframe& frame, const DynamicsConfig& config, double dt_s, int ticks)
    : stage(stage_of(config.control)),
      is_rk4(flies_by_rk4(frame, config, dt_s)),
      rotor_drag(config.rotor_drag && any(frame.rotor_drag)),
      rotor_lift(config.rotor_drag && frame.rotor_lift != 0.0),
      body_drag(config.body_drag && (any(frame.linear_drag) || any(frame.quadratic_drag))),
      gyroscopic(config.gyroscopic && frame.rotor_inertia_kgm2 != 0.0),
      ground_effect(config.ground_effect && frame.radius_m != 0.0),
      downwash(config.downwash && frame.radius_m != 0.0),
      control_ticks(ticks),
      num_rotors(frame.num_rotors()),
      dt(narrow(dt_s)),
      control_dt(narrow(dt_s * ticks)),
      numbers(numbers_of(frame, config, dt_s, dt_s * ticks)) {
  max_turn = std::min(narrow(std::numbers::pi / dt_s), kMaxSpeed);
  linear_thrust = !(numbers.known_thrust[2] > 0.0F);
  instant_up = numbers.inverse_lag_up == 0.0F;
  instant_down = numbers.inverse_lag_down == 0.0F;
  leads = numbers.lead != 1.0F;
  if (config.controller.command_lag_s > 0.0F) {
    command_keep = narrow(std::exp(-dt_s * ticks / static_cast<double>(config.controller.command_lag_s)));
  }
  max_rate = narrow(radians(config.max_rate_dps));
  max_yaw_rate = narrow(radians(config.max_yaw_rate_dps));
  max_speed_mps = config.max_speed_mps;
  max_acceleration = config.max_acceleration_mps2;
  max_tilt_tan = narrow(std::tan(radians(config.max_tilt_deg)));
  std::array<const AirframeNumbers<float>*, kLanes> same;
  same.fill(&numbers);
  set_lanes(same, lanes);
}

bool Physics::flies_by_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s) {
  if (config.integrator != Integrator::automatic) return config.integrator == Integrator::rk4;
  return config.tells_rotors() && can_rk4(frame, config, dt_s);
}

void Physics::include(const Physics& other) {
  for (bool Physics::* const term :
       {&Physics::rotor_drag, &Physics::rotor_lift, &Physics::body_drag, &Physics::gyroscopic, &Physics::ground_effect,
        &Physics::downwash, &Physics::instant_up, &Physics::instant_down, &Physics::linear_thrust, &Physics::leads}) {
    this->*term |= other.*term;
  }
  is_rk4 &= other.is_rk4;
  num_rotors = std::max(num_rotors, other.num_rotors);
}

// Transposes four numbers at a time with vector instructions: one number at a time takes twice as long.
void set_lanes(const std::array<const AirframeNumbers<float>*, kLanes>& numbers, LaneNumbers& lanes) {
  using Four = std::array<float, 4>;
  constexpr std::size_t kWhole = sizeof(AirframeNumbers<float>) / sizeof(Four),
                        kRest = sizeof(AirframeNumbers<float>) % sizeof(Four);
  static_assert(sizeof(lanes) == kLanes * sizeof(AirframeNumbers<float>), "one lane for each number, and nothing between");
  std::array<std::array<Four, kLanes>, kWhole + 1> rows;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const auto* const from = reinterpret_cast<const std::byte*>(numbers[lane]);
    for (std::size_t i = 0; i < kWhole; ++i) std::memcpy(rows[i][lane].data(), from + i * sizeof(Four), sizeof(Four));
    rows[kWhole][lane] = {};
    std::memcpy(rows[kWhole][lane].data(), from + kWhole * sizeof(Four), kRest);
  }
  alignas(64) std::array<Lanes<4>, kWhole + 1> to;
  for (std::size_t i = 0; i <= kWhole; ++i) load_rows(rows[i][0].data(), to[i]);
  std::memcpy(static_cast<void*>(&lanes), to.data(), sizeof(lanes));
}

namespace {

constexpr std::size_t kFloats = sizeof(AirframeNumbers<float>) / sizeof(float);

Lane* lanes_of(LaneNumbers& numbers) { return reinterpret_cast<Lane*>(&numbers); }
const Lane* lanes_of(const LaneNumbers& numbers) { return reinterpret_cast<const Lane*>(&numbers); }

}  // namespace

void set_lane(const AirframeNumbers<float>& numbers, std::size_t lane, LaneNumbers& lanes) {
  const auto* const from = reinterpret_cast<const float*>(&numbers);
  for (std::size_t i = 0; i < kFloats; ++i) lanes_of(lanes)[i][lane] = from[i];
}

void copy_lane(const LaneNumbers& from, std::size_t lane, LaneNumbers& to, std::size_t to_lane, std::size_t num_rotors) {
  const std::size_t count = kFloats - (kMaxRotors - num_rotors) * sizeof(RotorNumbers<float>) / sizeof(float);
  for (std::size_t i = 0; i < count; ++i) lanes_of(to)[i][to_lane] = lanes_of(from)[i][lane];
}

}  // namespace flockstep::dynamics
