// Flight: the motion of drones by their rotors, sixteen side by side, and the controller that flies them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"

namespace flockstep::dynamics {

inline constexpr std::size_t kLanes = 16;
inline constexpr float kMaxSpeed = 1e4F;  // m/s, along each axis, and rad/s

using Lane = std::array<float, kLanes>;  // one number of each of the drones
template <std::size_t kCount>
using Lanes = std::array<Lane, kCount>;

// Drones in flight, structure of arrays, in the world frame unless marked as body. A leg is a number of ticks that are flown
// without storing the state.
struct alignas(64) Flock {
  // The state.
  Lanes<3> travelled{};            // m, since the leg began: small numbers, so that small motions far from the origin are kept
  Lanes<3> velocity{};             // m/s
  Lanes<4> rotation{};             // w, x, y, z: unit, body to world
  Lanes<3> turn{};                 // angular velocity, rad/s, body
  Lanes<kRotors> rotor{};          // rad/s
  Lanes<kRotors> rotor_command{};  // rad/s: the last commanded speeds
  Lanes<3> error_integral{};       // m: of the velocity, for the controller
  // Inputs, constant for the whole leg.
  Lanes<3> wind{};      // m/s
  Lane height{};        // m, above the ground, at the leg's begin; infinite without ground
  Lanes<7> setpoint{};  // see Stage
  // Results of the leg.
  Lanes<3> acceleration{};          // m/s^2, mean of the last tick
  Lanes<3> angular_acceleration{};  // rad/s^2, body, mean of the last tick
  Lane reach2{};                    // m^2: square of the largest distance from the leg's begin
  Lane is_good{};                   // 1 if the state is finite, unit, within kMaxSpeed and max_turn; else 0
  // The position, which the equations of motion do not use; see update_position().
  Lanes<3> origin{};     // m: where the leg, or its part after the last contact, begins
  Lanes<3> position{};   // m: origin + travelled
  Lanes<3> remainder{};  // m: what float32 rounds off of the position
};

// Which of the cascade's stages a setpoint enters at, and what its numbers are then.
enum class Stage : std::uint8_t {
  rotors,            // rotor speeds rad/s
  rates,             // thrust m/s^2, body rates rad/s
  attitude,          // thrust m/s^2, unit vector to push along, cosine and sine of the heading
  acceleration,      // m/s^2, cosine and sine of the heading
  velocity,          // m/s, yaw rate rad/s
  heading_velocity,  // likewise, forward, left, up
  position,          // m from where the leg began, cosine and sine of the heading
};
Stage stage_of(Control control);

// The controller's gains, and how they follow from the lag of the rotors: with a lag T, rates damped by 0.7 allow 0.5 / T; each
// loop around has a third of the bandwidth of the one within, the position half of that. Rotors slower than 35 ms are overdriven:
// the commanded change of speed is scaled by T / 35 ms, up to four times.
struct Gains {
  double lead = 1.0;
  double rate = 0.0;      // 1/s, about x and y
  double yaw_rate = 0.0;  // 1/s, about z
  double attitude = 0.0;  // 1/s
  double yaw = 0.0;       // 1/s
  double velocity = 0.0;  // 1/s
  double integral = 0.0;  // 1/s^2, of the velocity
  double position = 0.0;  // 1/s

  static Gains of(const Airframe& frame, const DynamicsConfig& config, double control_dt_s);
};

// Whether rk4, for which the rotors are part of the state, can follow them: it takes ticks of at most twice their lag.
bool can_rk4(const Airframe& frame, const DynamicsConfig& config, double dt_s);

// The rate, 1/s, at which drag and the rotors' spin change the drone's motion at full rotor speed: the fastest mode of the
// linearised equations. Explicit integration diverges for ticks longer than about 2 over this.
double stiffness(const Airframe& frame, const DynamicsConfig& config);

// The numbers of an airframe and of its controller, in the form in which the equations need them. T is float for one airframe,
// and Lane for the drones of a flock. Every member is a T or an array of T.
template <class T>
struct AirframeNumbers {
  // the body
  T mass{}, inverse_mass{};
  std::array<T, 3> inertia{}, inverse_inertia{};
  std::array<T, 3> linear_drag{}, quadratic_drag{};
  // the rotors
  std::array<std::array<T, 3>, kRotors> position{};
  std::array<T, kRotors> yaw_sign{};    // of the torque about z: -1 for a rotor that turns counter-clockwise
  std::array<T, kRotors> yaw_torque{};  // m: signed torque about z over thrust
  std::array<T, 3> thrust{};            // c0, c1, c2
  T min_speed{}, max_speed{};
  T min_thrust{}, max_thrust{};
  T thrust_tiny{};  // N: a millionth of the largest thrust
  // speed = (sqrt(discriminant + 4 c2 thrust) - c1) / (2 c2), or (thrust - c0) / c1 if c2 is 0
  T discriminant{}, four_c2{}, half_over_c2{}, one_over_c1{};
  T keep_half_up{}, keep_up{};  // share of a difference of speed that is left after half a tick and a tick
  T keep_half_down{}, keep_down{};
  T inverse_lag_up{}, inverse_lag_down{};  // 1/s; 0 without a lag
  T rotor_inertia{};
  std::array<T, 3> drag{};
  T lift{};
  T ground_quarter{};  // m: a quarter of the radius
  T least_height{};    // m: nearer to the ground the effect does not grow
  // the controller
  std::array<std::array<T, 4>, kRotors> mixer{};  // thrust of each rotor by thrust, and torque about x, y, z
  T lead{};
  std::array<T, 3> rate_torque{};  // N m / (rad/s): rate gain times inertia, about x, y, z
  T attitude_gain{}, twice_attitude_gain{}, yaw_gain{};
  T velocity_gain{}, integral_gain{}, position_gain{};
  T max_integral{};
};

// The numbers of the drones of a flock.
struct alignas(64) LaneNumbers : AirframeNumbers<Lane> {};
void set_lanes(const std::array<const AirframeNumbers<float>*, kLanes>& numbers, LaneNumbers& lanes);

// How a batch flies, the same for all of its drones; the numbers of its airframe.
struct Physics {
  Physics() = default;
  // dt_s: of a tick; control_ticks: ticks from one call of the controller to the next.
  Physics(const Airframe& frame, const DynamicsConfig& config, double dt_s, int control_ticks);
  // Turns on what the other needs too, so that drones of both airframes can fly in one flock; by rk4 only if both would.
  void include(const Physics& other);

  Stage stage = Stage::rotors;
  bool is_rk4 = false;
  bool rotor_drag = false, rotor_lift = false, body_drag = false, gyroscopic = false, ground_effect = false;
  bool instant_up = false, instant_down = false;  // rotors without a lag
  bool linear_thrust = false;                     // thrust that grows in proportion to the speed
  bool leads = false;                             // rotors are commanded beyond the desired speed
  int control_ticks = 1;
  float dt = 0.0F;
  float max_turn = 0.0F;  // rad/s: half a turn in a tick; faster ones would look like slow ones
  float control_dt = 0.0F;
  float max_rate = 0.0F, max_yaw_rate = 0.0F;
  float max_speed_mps = 0.0F, max_acceleration = 0.0F, max_tilt_tan = 0.0F;
  AirframeNumbers<float> numbers;
  LaneNumbers lanes;  // the same numbers in every lane
};

// Flies all lanes for some ticks, the first of which is the first_tick-th of its step, without a look at obstacles. What comes
// out of a lane depends on what goes into that lane alone; every operation rounds correctly, so that all SIMD targets agree.
// Drones of different airframes have numbers of their own in each lane; what Physics turns on is computed for all lanes, and a
// number of 0 turns it off for one.
void fly(const Physics& physics, const LaneNumbers& numbers, Flock& flock, int first_tick, int ticks);
void fly(const Physics& physics, Flock& flock, int first_tick, int ticks);  // the same airframe in every lane

}  // namespace flockstep::dynamics
