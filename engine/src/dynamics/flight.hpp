// Flight: the rotor dynamics of drones and their controller, for sixteen drones side by side.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/airframe.hpp"
#include "flockstep/drones/variation.hpp"
#include "flockstep/dynamics.hpp"

namespace flockstep::dynamics {

inline constexpr std::size_t kLanes = 16;
inline constexpr float kMaxSpeed = 1e4F;  // m/s along each axis, also rad/s

using Lane = std::array<float, kLanes>;  // one number for each drone
template <std::size_t kCount>
using Lanes = std::array<Lane, kCount>;

// The numbers of a setpoint, see Stage; unused ones are 0. Only rotor speeds are more than six.
inline constexpr std::size_t kSetpoint = kMaxRotors;
using Setpoint = std::array<float, kSetpoint>;

// A command that takes effect within a leg: from this tick of the step on, for each lane; infinite: not at all.
struct alignas(64) Arrival {
  Lane tick;
  Lanes<kSetpoint> setpoint;
};

// Drones in flight as a structure of arrays, in the world frame unless marked as body. A leg is a run of ticks flown without
// storing the state.
struct alignas(64) Flock {
  // The state.
  Lanes<3> travelled{};               // m, since the leg began: stays small, to resolve small motions far from the origin
  Lanes<3> velocity{};                // m/s
  Lanes<4> rotation{};                // w, x, y, z: unit, body to world
  Lanes<3> turn{};                    // angular velocity, rad/s, body
  Lanes<kMaxRotors> rotor{};          // rad/s; those that no drone of the batch has are neither read nor written
  Lanes<kMaxRotors> rotor_command{};  // rad/s, last commanded speeds
  Lanes<3> error_integral{};          // m, integral of the velocity error in the controller
  // Inputs, constant for the whole leg.
  Lanes<3> wind{};                   // m/s
  Lane height{};                     // m above the ground at the start of the leg; infinite without ground
  Lanes<kMaxRotors> thrust_share{};  // share of its thrust that each rotor keeps in the wash of other drones; see Fleet
  Lanes<kSetpoint> setpoint{};       // see Stage
  Lanes<kMaxRotors> speed_share{};   // share of its commanded speed that each rotor is driven to; read if Physics::drains
  Lanes<3> push{};                   // m/s^2, world frame; acceleration by a force from outside; read if Physics::pushed
  Lanes<3> twist{};                  // rad/s^2, angular acceleration by a torque from outside; read if Physics::pushed
  // Results of the leg.
  Lanes<3> acceleration{};          // m/s^2, mean of the last tick
  Lanes<3> angular_acceleration{};  // rad/s^2, body, mean of the last tick
  Lane reach2{};                    // m^2, square of the largest distance from the start of the leg
  Lane is_good{};                   // 1 if finite, with a unit rotation, within kMaxSpeed, max_turn and the world; else 0
  // The position, which the equations of motion do not use; see update_position().
  Lanes<3> origin{};     // m, start of the leg, or of its part after the last contact
  Lanes<3> position{};   // m, origin + travelled
  Lanes<3> remainder{};  // m, float32 rounding error of the position
  // Further setpoints, in the order of their commands. The last member, so that all lanes are aligned.
  std::span<Arrival> arrivals{};
};

// The stage of the controller cascade that takes the setpoint, and the numbers of that setpoint.
enum class Stage : std::uint8_t {
  rotors,            // rotor speeds rad/s
  rates,             // thrust m/s^2, body rates rad/s
  attitude,          // thrust m/s^2, unit thrust direction, cosine and sine of the heading
  acceleration,      // m/s^2, cosine and sine of the heading
  velocity,          // m/s, yaw rate rad/s
  heading_velocity,  // m/s forward, left and up; yaw rate rad/s
  position,          // m from the start of the leg, cosine and sine of the heading
};
Stage stage_of(Control control);
// True if the stage integrates the velocity error.
inline bool has_integral(Stage stage) { return stage >= Stage::velocity; }

// The controller's gains: those of ControllerConfig, otherwise derived from the lag T of the rotors. With a damping of 0.7 the
// rate gain is 0.5 / T. Each outer loop has a third of the bandwidth of the loop inside it; the position loop has half. Rotors
// slower than 35 ms are overdriven: the commanded change of speed is scaled by T / 35 ms, at most by four.
struct Gains {
  double lead = 1.0;
  double rate = 0.0;      // 1/s, about x and y
  double yaw_rate = 0.0;  // 1/s, about z
  double attitude = 0.0;  // 1/s
  double yaw = 0.0;       // 1/s
  double velocity = 0.0;  // 1/s
  double integral = 0.0;  // 1/s^2, integral gain of the velocity
  double position = 0.0;  // 1/s

  static Gains of(const Airframe& frame, const DynamicsConfig& config, double control_dt_s);
};

// True if rk4 can integrate the rotors, which are part of its state: a tick may be at most twice their lag.
bool can_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s);

// The fastest mode (1/s) of the linearised equations: the rate at which drag and rotor spin change the drone's motion at full
// rotor speed. Explicit integration diverges if a tick is longer than about 2 over this rate.
double stiffness(const Airframe& frame, const DynamicsConfig& config);

// The coefficients of a rotor. One that the airframe does not have is zero, except for the mixer, which is that of the first
// rotor and so limits nothing: the sign tells.
template <class T>
struct RotorNumbers {
  std::array<T, 3> position{};
  T yaw_sign{};               // sign of the torque about z: -1 for a rotor that turns counter-clockwise, 0 for none
  T yaw_torque{};             // m, signed torque about z over thrust
  std::array<T, 3> thrust{};  // c0, c1, c2
  std::array<T, 4> mixer{};   // thrust from total thrust and torque about x, y, z
};

// The coefficients of an airframe and its controller, precomputed for the equations. T is float for one airframe and Lane for
// the drones of a flock. Every member is a T or an array of T.
template <class T>
struct AirframeNumbers {
  // the body
  T inverse_mass{};
  std::array<T, 3> inertia{}, inverse_inertia{};
  std::array<T, 3> linear_drag{}, quadratic_drag{};
  // the rotors
  T keep_half_up{}, keep_up{};  // share of a speed difference left after half a tick and after a tick
  T keep_half_down{}, keep_down{};
  T inverse_lag_up{}, inverse_lag_down{};  // 1/s; 0 without a lag
  T rotor_inertia{};
  std::array<T, 3> drag{};
  T lift{};
  T ground_quarter{};  // m, a quarter of the rotor radius
  T least_height{};    // m, below this the ground effect stops growing
  // the controller, which knows the drone as its airframe is
  T mass{};
  std::array<T, 3> known_inertia{};
  T min_speed{}, max_speed{};
  T min_thrust{}, max_thrust{};
  T thrust_tiny{};                  // N, a millionth of the largest thrust
  std::array<T, 3> known_thrust{};  // c0, c1, c2
  // speed = (sqrt(discriminant + 4 c2 thrust) - c1) / (2 c2), or (thrust - c0) / c1 if c2 is 0
  T discriminant{}, four_c2{}, half_over_c2{}, one_over_c1{};
  T lead{};
  std::array<T, 3> rate_torque{};  // N m / (rad/s), rate gain times inertia, about x, y, z
  T attitude_gain{}, twice_attitude_gain{}, yaw_gain{};
  T velocity_gain{}, integral_gain{}, position_gain{};
  T max_integral{};
  // The last member, so that batches of quadrotors read only the first half.
  std::array<RotorNumbers<T>, kMaxRotors> rotors{};
};

// The coefficients of the drones of a flock.
struct alignas(64) LaneNumbers : AirframeNumbers<Lane> {};
void set_lanes(const std::array<const AirframeNumbers<float>*, kLanes>& numbers, LaneNumbers& lanes);
// Sets one lane, or copies one.
void set_lane(const AirframeNumbers<float>& numbers, std::size_t lane, LaneNumbers& lanes);
// num_rotors: that are copied.
void copy_lane(const LaneNumbers& from, std::size_t lane, LaneNumbers& to, std::size_t to_lane, std::size_t num_rotors);

// The coefficients of an airframe and of the controller made for it. control_dt_s: time between its calls.
AirframeNumbers<float> numbers_of(const Airframe& frame, const DynamicsConfig& config, double dt_s, double control_dt_s);
// Those of a drone with these parameters, which make `made` of its airframe, with the controller of `known`, the numbers of the
// airframe.
AirframeNumbers<float> numbers_of(const Airframe& frame, const Airframe& made, const AirframeNumbers<float>& known,
                                  const DroneParameters& parameters, const DynamicsConfig& config, double dt_s,
                                  double control_dt_s);

// The flight settings that all drones of a batch share, and the coefficients of one airframe.
struct Physics {
  Physics() = default;
  // dt_s: duration of a tick. control_ticks: ticks from one call of the controller to the next.
  Physics(const Airframe& frame, const DynamicsConfig& config, double dt_s, int control_ticks);
  // True if drones of this airframe fly by rk4.
  static bool flies_by_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s);
  // Turns on the terms and rotors that the other needs, so that drones of both airframes can fly in one flock. Uses rk4 only if
  // both do.
  void include(const Physics& other);

  Stage stage = Stage::rotors;
  bool is_rk4 = false;
  bool rotor_drag = false, rotor_lift = false, body_drag = false, gyroscopic = false, ground_effect = false;
  bool downwash = false;
  bool instant_up = false, instant_down = false;  // rotors without a lag
  bool linear_thrust = false;                     // thrust curves without a quadratic term
  bool leads = false;                             // rotors commanded beyond the desired speed
  bool drains = false;                            // batteries that lose voltage, or rotors that die
  bool pushed = false;                            // forces from outside
  float command_keep = 0.0F;                      // share of the last command left after the controller's lag; 0: no lag
  int control_ticks = 1;
  std::size_t num_rotors = kMinRotors;  // the largest number of any airframe
  float dt = 0.0F;
  float max_turn = 0.0F;  // rad/s, half a turn in a tick: faster turns would alias to slower ones
  float control_dt = 0.0F;
  float max_rate = 0.0F, max_yaw_rate = 0.0F;
  float max_speed_mps = 0.0F, max_acceleration = 0.0F, max_tilt_tan = 0.0F;
  AirframeNumbers<float> numbers;
  LaneNumbers lanes;  // `numbers` in every lane
};

// Flies all lanes for `ticks` ticks, ignoring obstacles. first_tick is the index of the first tick in its step. The result of a
// lane depends only on the inputs of that lane. Every operation rounds correctly, so all SIMD targets agree. The terms that
// Physics turns on are computed for all lanes; a coefficient of 0 turns a term off for one lane.
// path: if not null, receives `travelled` after each tick.
void fly(const Physics& physics, const LaneNumbers& numbers, Flock& flock, int first_tick, int ticks, Lanes<3>* path = nullptr);
void fly(const Physics& physics, Flock& flock, int first_tick, int ticks);  // the same airframe in every lane

}  // namespace flockstep::dynamics
