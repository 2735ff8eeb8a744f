// The equations of motion and of the controller. They are templates over the number type: F for flight itself, and numbers that
// keep derivatives for gradients. A is what loads a coefficient for them, such as At. Included once per SIMD target.
//
// Equations of motion, including rotor drag: R. Mahony, V. Kumar, P. Corke, "Multirotor aerial vehicles", IEEE Robotics and
// Automation Magazine 19(3), 2012. The attitude controller corrects the thrust direction first, then the heading: D.
// Brescianini and R. D'Andrea, "Tilt-prioritized quadrocopter attitude control", IEEE Transactions on Control Systems
// Technology 28(2), 2020.
#if defined(FLOCKSTEP_DYNAMICS_EQUATIONS_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_DYNAMICS_EQUATIONS_INL_HPP
#undef FLOCKSTEP_DYNAMICS_EQUATIONS_INL_HPP
#else
#define FLOCKSTEP_DYNAMICS_EQUATIONS_INL_HPP
#endif

#include <hwy/highway.h>

#include <cstddef>
#include <type_traits>

#include "dynamics/lanes-inl.hpp"

// If these functions are inlined in debug builds, builds with sanitizers take minutes.
#undef FLOCKSTEP_BIG_INLINE
#if defined(NDEBUG)
#define FLOCKSTEP_BIG_INLINE HWY_INLINE
#else
#define FLOCKSTEP_BIG_INLINE HWY_NOINLINE
#endif

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

constexpr float kG = static_cast<float>(kGravity);
constexpr float kTiny = 1e-6F;

using Numbers = LaneNumbers;

// Loads a number for the drones of one vector of lanes.
struct At {
  std::size_t lane;  // first lane
  HWY_INLINE F operator()(const Lane& number) const { return load(number, lane); }
};

// The integrated state of a drone. kRotors: columns that are computed, kMinRotors or kMaxRotors.
template <class T, std::size_t kRotors = kMinRotors>
struct OdeState {
  Wide3<T> travelled, velocity;
  Quaternion<T> rotation;
  Wide3<T> turn;
  T rotor[kRotors];
};

// Inputs of a leg.
template <class T>
struct Inputs {
  Wide3<T> wind;
  T height;
  const Lanes<kMaxRotors>& thrust_share;
  const Lanes<3>&push, &twist;
};

template <class T>
struct Forces {
  Wide3<T> acceleration;  // world frame
  Wide3<T> turning;       // angular acceleration, body frame
};

template <class T, class A>
HWY_INLINE T rotor_rate(const Numbers& n, A at, T speed, T command) {
  const T difference = command - speed;
  return difference * select(difference > 0.0F, at(n.inverse_lag_up), at(n.inverse_lag_down));
}

// The rotor speed after a tick or half a tick under the same command.
template <class T, class C>
HWY_INLINE T lagged(T speed, T command, C keep_up, C keep_down) {
  const T behind = speed - command;
  return command + behind * select(behind < 0.0F, keep_up, keep_down);
}

// Rotors without lag reach the commanded speed at once.
template <class T, class A, std::size_t kRotors>
HWY_INLINE void respond(const Physics& p, const Numbers& n, A at, const T* command, T (&speed)[kRotors]) {
  if (!p.instant_up && !p.instant_down) return;
  const auto instant_up = at(n.inverse_lag_up) == 0.0F;
  const auto instant_down = at(n.inverse_lag_down) == 0.0F;
  for (std::size_t i = 0; i < kRotors; ++i) {
    speed[i] = select(instant_up, max(speed[i], command[i]), speed[i]);
    speed[i] = select(instant_down, min(speed[i], command[i]), speed[i]);
  }
}

// m dv/dt = R (T e3 + sum H_i + D) - m g e3,
// J dw/dt = sum r_i x (F_i e3 + H_i) - sum s_i k F_i e3 - w x J w - w x h - dh/dt,  h = J_r sum s_i W_i e3,
// with F_i = c0 + c1 W_i + c2 W_i^2 >= 0, H_i = -W_i diag(d) v_i, v_i = R^T (v - wind) + w x r_i, D = -diag(l) v - |v| diag(q) v.
//
// Physics has a flag for each optional rotor term. If all of them are false, so is kHasRotorTerms, which removes their branches
// at compile time. Even an untaken branch for each rotor would cost a quarter of the time.
template <bool kHasRotorTerms, class T, class A, std::size_t kRotors>
FLOCKSTEP_BIG_INLINE Forces<T> forces(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, const T* command,
                                      const Inputs<T>& in) {
  const bool has_drag = kHasRotorTerms && p.rotor_drag, has_lift = kHasRotorTerms && p.rotor_lift;
  const bool has_ground = kHasRotorTerms && p.ground_effect, has_momentum = kHasRotorTerms && p.gyroscopic;
  const bool has_wash = kHasRotorTerms && p.downwash;
  const Matrix3<T> r = matrix(s.rotation);
  const Wide3<T> w = s.turn;
  const Wide3<T> air = transpose_times(r, s.velocity - in.wind);
  Wide3<T> force{0.0F, 0.0F, 0.0F};
  Wide3<T> torque = force;
  T momentum(0.0F);       // rad/s, signed sum of the rotor speeds about z
  T momentum_rate(0.0F);  // its rate of change
  for (std::size_t i = 0; i < kRotors; ++i) {
    const T speed = s.rotor[i];
    const auto x = at(n.rotors[i].position[0]), y = at(n.rotors[i].position[1]), z = at(n.rotors[i].position[2]);
    T push = max(at(n.rotors[i].thrust[0]) + (at(n.rotors[i].thrust[1]) + at(n.rotors[i].thrust[2]) * speed) * speed, 0.0F);
    if (has_drag || has_lift) {
      const Wide3<T> hub{air.x + (w.y * z - w.z * y), air.y + (w.z * x - w.x * z), air.z + (w.x * y - w.y * x)};
      if (has_lift) push = push + at(n.lift) * (hub.x * hub.x + hub.y * hub.y);
      if constexpr (kRotors > kMinRotors) push = select(at(n.rotors[i].yaw_sign) == 0.0F, 0.0F, push);
      if (has_drag) {
        const Wide3<T> drag{-(speed * (at(n.drag[0]) * hub.x)), -(speed * (at(n.drag[1]) * hub.y)),
                            -(speed * (at(n.drag[2]) * hub.z))};
        force = force + drag;
        torque.x = torque.x + (y * drag.z - z * drag.y);
        torque.y = torque.y + (z * drag.x - x * drag.z);
        torque.z = torque.z + (x * drag.y - y * drag.x);
      }
    }
    if (has_ground) {  // Cheeseman and Bennett: F / (1 - (r / 4h)^2), for upright drones only
      const T hub_height = in.height + s.travelled.z + (r.zx * x + r.zy * y + r.zz * z);
      const T near = at(n.ground_quarter) / max(hub_height, at(n.least_height));
      const T gain = 1.0F / (1.0F - near * near);
      push = push * select(r.zz > 0.0F, gain, 1.0F);
    }
    if (has_wash) push = push * at(in.thrust_share[i]);
    force.z = force.z + push;
    torque.x = torque.x + y * push;
    torque.y = torque.y - x * push;
    torque.z = torque.z + at(n.rotors[i].yaw_torque) * push;
    if (has_momentum) {
      momentum = momentum - at(n.rotors[i].yaw_sign) * speed;
      momentum_rate = momentum_rate - at(n.rotors[i].yaw_sign) * rotor_rate(n, at, speed, command[i]);
    }
  }
  if (p.body_drag) {
    const T fast = sqrt(dot(air, air));
    force.x = force.x - (at(n.linear_drag[0]) + at(n.quadratic_drag[0]) * fast) * air.x;
    force.y = force.y - (at(n.linear_drag[1]) + at(n.quadratic_drag[1]) * fast) * air.y;
    force.z = force.z - (at(n.linear_drag[2]) + at(n.quadratic_drag[2]) * fast) * air.z;
  }
  const Wide3<T> spin{at(n.inertia[0]) * w.x, at(n.inertia[1]) * w.y, at(n.inertia[2]) * w.z};
  torque = torque - cross(w, spin);
  if (has_momentum) {
    const T h = at(n.rotor_inertia) * momentum;
    torque.x = torque.x - w.y * h;
    torque.y = torque.y + w.x * h;
    torque.z = torque.z - at(n.rotor_inertia) * momentum_rate;
  }
  Wide3<T> acceleration = times(r, force * at(n.inverse_mass));
  acceleration.z = acceleration.z - kG;
  Wide3<T> turning{at(n.inverse_inertia[0]) * torque.x, at(n.inverse_inertia[1]) * torque.y, at(n.inverse_inertia[2]) * torque.z};
  if (p.pushed) {
    acceleration = acceleration + Wide3<T>{at(in.push[0]), at(in.push[1]), at(in.push[2])};
    turning = turning + Wide3<T>{at(in.twist[0]), at(in.twist[1]), at(in.twist[2])};
  }
  return {acceleration, turning};
}

// Midpoint method, second order. Rotor speeds are exact, and so is the attitude at a constant angular velocity.
template <bool kHasRotorTerms, class T, class A, std::size_t kRotors>
FLOCKSTEP_BIG_INLINE void midpoint(const Physics& p, const Numbers& n, A at, OdeState<T, kRotors>& s, const T* command,
                                   const Inputs<T>& in) {
  const T half(0.5F * p.dt);
  const T dt(p.dt);
  const Forces<T> first = forces<kHasRotorTerms>(p, n, at, s, command, in);
  OdeState<T, kRotors> middle;
  middle.velocity = s.velocity + first.acceleration * half;
  middle.turn = s.turn + first.turning * half;
  middle.travelled = s.travelled + s.velocity * half;
  middle.rotation = turned(s.rotation, s.turn, 0.25F * p.dt);
  for (std::size_t i = 0; i < kRotors; ++i)
    middle.rotor[i] = lagged(s.rotor[i], command[i], at(n.keep_half_up), at(n.keep_half_down));
  const Forces<T> mean = forces<kHasRotorTerms>(p, n, at, middle, command, in);
  s.travelled = s.travelled + middle.velocity * dt;
  s.velocity = s.velocity + mean.acceleration * dt;
  s.rotation = normalised(turned(s.rotation, middle.turn, half));
  s.turn = s.turn + mean.turning * dt;
  for (std::size_t i = 0; i < kRotors; ++i) s.rotor[i] = lagged(s.rotor[i], command[i], at(n.keep_up), at(n.keep_down));
}

template <class T, std::size_t kRotors>
struct Rates {
  Wide3<T> velocity, acceleration;
  Quaternion<T> rotation;
  Wide3<T> turning;
  T rotor[kRotors];
};

template <bool kHasRotorTerms, class T, class A, std::size_t kRotors>
HWY_INLINE Rates<T, kRotors> rates(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, const T* command,
                                   const Inputs<T>& in) {
  const Forces<T> f = forces<kHasRotorTerms>(p, n, at, s, command, in);
  Rates<T, kRotors> r{s.velocity, f.acceleration, rate_of(s.rotation, s.turn), f.turning, {}};
  for (std::size_t i = 0; i < kRotors; ++i) r.rotor[i] = rotor_rate(n, at, s.rotor[i], command[i]);
  return r;
}

template <class T, std::size_t kRotors>
HWY_INLINE OdeState<T, kRotors> moved(const OdeState<T, kRotors>& s, const Rates<T, kRotors>& r, std::type_identity_t<T> dt) {
  OdeState<T, kRotors> next{
      s.travelled + r.velocity * dt, s.velocity + r.acceleration * dt, s.rotation + r.rotation * dt, s.turn + r.turning * dt, {}};
  for (std::size_t i = 0; i < kRotors; ++i) next.rotor[i] = s.rotor[i] + r.rotor[i] * dt;
  return next;
}

template <class T, std::size_t kRotors>
HWY_INLINE void add(Rates<T, kRotors>& sum, const Rates<T, kRotors>& r, std::type_identity_t<T> weight) {
  sum.velocity = sum.velocity + r.velocity * weight;
  sum.acceleration = sum.acceleration + r.acceleration * weight;
  sum.rotation = sum.rotation + r.rotation * weight;
  sum.turning = sum.turning + r.turning * weight;
  for (std::size_t i = 0; i < kRotors; ++i) sum.rotor[i] = sum.rotor[i] + r.rotor[i] * weight;
}

// The classical fourth-order Runge-Kutta method, with the rotors as part of the state. The rates are summed as they are
// computed: four of them do not fit into registers.
template <bool kHasRotorTerms, class T, class A, std::size_t kRotors>
FLOCKSTEP_BIG_INLINE void runge_kutta(const Physics& p, const Numbers& n, A at, OdeState<T, kRotors>& s, const T* command,
                                      const Inputs<T>& in) {
  const T half(0.5F * p.dt);
  const T dt(p.dt);
  const T two(2.0F);
  Rates<T, kRotors> r = rates<kHasRotorTerms>(p, n, at, s, command, in);
  Rates<T, kRotors> sum = r;
  r = rates<kHasRotorTerms>(p, n, at, moved(s, r, half), command, in);
  add(sum, r, two);
  r = rates<kHasRotorTerms>(p, n, at, moved(s, r, half), command, in);
  add(sum, r, two);
  r = rates<kHasRotorTerms>(p, n, at, moved(s, r, dt), command, in);
  add(sum, r, 1.0F);
  s = moved(s, sum, p.dt / 6.0F);
  s.rotation = normalised(s.rotation);
}

// --------------------------------------------------------------------------------------------------------- the controller

// Factor that converts the sine of the angle between two directions to 2 sin(angle / 2). Unlike the sine, this increases all
// the way to half a turn.
template <class T>
HWY_INLINE T turn_gain(T cosine) {
  return 2.0F / sqrt(max(2.0F * (1.0F + cosine), kTiny));
}

// True if the angle between two directions is within 0.06 degrees of 180 degrees. Its sine then does not give the angle, and
// rounding decides the axis, so any axis will do.
template <class T>
HWY_INLINE auto are_opposite(T cosine, T square_of_sine) {
  return (square_of_sine < 1e-6F) & (cosine < 0.0F);
}

// Shortens a vector to at most this length.
template <class T>
HWY_INLINE Wide3<T> shortened(const Wide3<T>& v, std::type_identity_t<T> length) {
  const T square = dot(v, v);
  const T scale = length / sqrt(max(square, kTiny));
  return v * select(square > length * length, scale, 1.0F);
}

template <class T>
HWY_INLINE T clamp(T x, float limit) {
  return max(min(x, limit), -limit);
}

// The output of the outer loops, input of the attitude loop.
template <class T>
struct Aim {
  T thrust;     // m/s^2, along the body's z
  Wide3<T> up;  // unit, world frame; target direction of the body's z
  T yaw_rate;   // rad/s
};

// Converts a desired acceleration to thrust and direction. The horizontal part is reduced to keep within the maximum tilt.
template <class T>
HWY_INLINE Aim<T> push_along(const Physics& p, const Matrix3<T>& r, Wide3<T> desired) {
  desired.z = max(desired.z + kG, 0.3F * kG);
  const T sideways = sqrt(desired.x * desired.x + desired.y * desired.y);
  const T most = desired.z * p.max_tilt_tan;
  const T scale = select(sideways > most, most / max(sideways, kTiny), 1.0F);
  desired.x = desired.x * scale;
  desired.y = desired.y * scale;
  const T length = sqrt(dot(desired, desired));
  const T thrust = max(desired.x * r.xz + desired.y * r.yz + desired.z * r.zz, 0.0F);
  return {thrust, desired * (1.0F / length), 0.0F};
}

// Yaw rate (rad/s) towards the desired heading.
template <class T, class A>
HWY_INLINE T yaw_towards(const Numbers& n, A at, const Matrix3<T>& r, T cosine, T sine) {
  const T scale = 1.0F / sqrt(max(r.xx * r.xx + r.yx * r.yx, kTiny));
  const T x = r.xx * scale, y = r.yx * scale;
  const T across = x * sine - y * cosine;
  const T along = x * cosine + y * sine;
  return at(n.yaw_gain) * select(are_opposite(along, across * across), 2.0F, across * turn_gain(along));
}

// PI controller from desired velocity to acceleration.
template <class T, class A>
HWY_INLINE Wide3<T> accelerate(const Physics& p, const Numbers& n, A at, const Wide3<T>& velocity, const Wide3<T>& desired,
                               Wide3<T>& integral) {
  const Wide3<T> error = shortened(desired, p.max_speed_mps) - velocity;
  integral = shortened(integral + error * p.control_dt, at(n.max_integral));
  return shortened(error * at(n.velocity_gain) + integral * at(n.integral_gain), p.max_acceleration);
}

// Rotor speeds for a thrust (m/s^2) and body rates. If the rotors saturate, yaw is reduced first, then the thrust is shifted to
// make room for roll and pitch, and roll and pitch are reduced last.
template <class T, class A, std::size_t kRotors>
HWY_INLINE void mix(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, T thrust, Wide3<T> desired,
                    T* command) {
  const Wide3<T>& turn = s.turn;
  desired = {clamp(desired.x, p.max_rate), clamp(desired.y, p.max_rate), clamp(desired.z, p.max_yaw_rate)};
  const auto& inertia = n.known_inertia;
  const Wide3<T> spin{at(inertia[0]) * turn.x, at(inertia[1]) * turn.y, at(inertia[2]) * turn.z};
  const Wide3<T> gyro = cross(turn, spin);
  const T x = at(n.rate_torque[0]) * (desired.x - turn.x) + gyro.x;
  const T y = at(n.rate_torque[1]) * (desired.y - turn.y) + gyro.y;
  const T z = at(n.rate_torque[2]) * (desired.z - turn.z) + gyro.z;
  const T push = at(n.mass) * thrust;
  T tilt[kRotors], level[kRotors];
  T low, high;
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = at(n.rotors[i].mixer[0]) * push;
    tilt[i] = at(n.rotors[i].mixer[1]) * x + at(n.rotors[i].mixer[2]) * y;
    low = i == 0 ? tilt[i] : min(low, tilt[i]);
    high = i == 0 ? tilt[i] : max(high, tilt[i]);
  }
  const auto room = at(n.max_thrust) - at(n.min_thrust);
  const T scale = min(1.0F, room / max(high - low, at(n.thrust_tiny)));
  T below(0.0F), above(0.0F);  // N, excess beyond the range of the rotors
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = level[i] + scale * tilt[i];
    below = max(below, at(n.min_thrust) - level[i]);
    above = max(above, level[i] - at(n.max_thrust));
  }
  T share(1.0F);  // share of the desired yaw
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = level[i] + (below - above);
    const T yaw = at(n.rotors[i].mixer[3]) * z;
    const T left = select(yaw > 0.0F, at(n.max_thrust) - level[i], level[i] - at(n.min_thrust));
    share = min(share, max(left, 0.0F) / max(abs(yaw), at(n.thrust_tiny)));
  }
  for (std::size_t i = 0; i < kRotors; ++i) {
    const T want = max(min(level[i] + share * (at(n.rotors[i].mixer[3]) * z), at(n.max_thrust)), at(n.min_thrust));
    // Invert the thrust curve, which is a parabola or a straight line.
    const T root = sqrt(max(at(n.discriminant) + at(n.four_c2) * want, 0.0F)) - at(n.known_thrust[1]);
    T speed = root * at(n.half_over_c2);
    if (p.linear_thrust) {
      const T straight = (want - at(n.known_thrust[0])) * at(n.one_over_c1);
      speed = select(at(n.known_thrust[2]) > 0.0F, speed, straight);
    }
    if (p.leads) {
      const T leading = s.rotor[i] + at(n.lead) * (speed - s.rotor[i]);
      speed = select(at(n.lead) > 1.0F, leading, speed);
    }
    command[i] = max(min(speed, at(n.max_speed)), at(n.min_speed));
    if constexpr (kRotors > kMinRotors) command[i] = select(at(n.rotors[i].yaw_sign) == 0.0F, 0.0F, command[i]);  // absent
  }
}

// Runs the outer loops, starting at the stage of the setpoint.
template <class T, class A, std::size_t kRotors>
HWY_INLINE Aim<T> aim_of(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, const Matrix3<T>& r,
                         const T* set, Wide3<T>& integral) {
  if (p.stage == Stage::attitude) return {set[0], {set[1], set[2], set[3]}, yaw_towards(n, at, r, set[4], set[5])};
  Wide3<T> desired{set[0], set[1], set[2]};
  if (p.stage == Stage::acceleration) {
    desired = shortened(desired, p.max_acceleration);
  } else {
    if (p.stage == Stage::position) {
      desired = (desired - s.travelled) * at(n.position_gain);
    } else if (p.stage == Stage::heading_velocity) {
      const T scale = 1.0F / sqrt(max(r.xx * r.xx + r.yx * r.yx, kTiny));
      const T x = r.xx * scale, y = r.yx * scale;
      desired = {x * set[0] - y * set[1], y * set[0] + x * set[1], set[2]};
    }
    desired = accelerate(p, n, at, s.velocity, desired, integral);
  }
  const bool has_rate = p.stage == Stage::velocity || p.stage == Stage::heading_velocity;
  Aim<T> aim = push_along(p, r, desired);
  aim.yaw_rate = has_rate ? set[3] : yaw_towards(n, at, r, set[3], set[4]);
  return aim;
}

// Body rates that turn the body's z to `up` the shortest way and yaw about `up`. An inverted drone turns about x.
template <class T, class A>
HWY_INLINE Wide3<T> rates_towards(const Physics& p, const Numbers& n, A at, const Matrix3<T>& r, const Aim<T>& aim) {
  const Wide3<T> up = transpose_times(r, aim.up);
  const T gain = at(n.attitude_gain) * turn_gain(up.z);
  const T yaw = clamp(aim.yaw_rate, p.max_yaw_rate);
  const auto is_inverted = are_opposite(up.z, up.x * up.x + up.y * up.y);
  const T roll = select(is_inverted, at(n.twice_attitude_gain), -(up.y * gain));
  const T pitch = select(is_inverted, 0.0F, up.x * gain);
  return {roll + r.zx * yaw, pitch + r.zy * yaw, r.zz * yaw};
}

// The controller cascade. It is not inlined, so that the loops over ticks are compiled once instead of once for each stage.
template <class T, class A, std::size_t kRotors>
HWY_NOINLINE void control(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, const T* set,
                          Wide3<T>& integral, T* command) {
  if (p.stage == Stage::rotors) {
    for (std::size_t i = 0; i < kRotors; ++i) command[i] = set[i];
    return;
  }
  T thrust = set[0];
  Wide3<T> turn{set[1], set[2], set[3]};
  if (p.stage != Stage::rates) {
    const Matrix3<T> r = matrix(s.rotation);
    const Aim<T> aim = aim_of(p, n, at, s, r, set, integral);
    thrust = aim.thrust;
    turn = rates_towards(p, n, at, r, aim);
  }
  mix(p, n, at, s, thrust, turn, command);
}

// Runs the controller with its lag, and lets the motors follow as far as their battery allows.
template <class T, class A, std::size_t kRotors>
HWY_NOINLINE void drive(const Physics& p, const Numbers& n, A at, const OdeState<T, kRotors>& s, const T* set, Wide3<T>& integral,
                        const Lanes<kMaxRotors>& share, T* command) {
  T wanted[kRotors];
  control(p, n, at, s, set, integral, wanted);
  for (std::size_t i = 0; i < kRotors; ++i) {
    if (p.drains) wanted[i] = wanted[i] * at(share[i]);
    command[i] = wanted[i] + (command[i] - wanted[i]) * p.command_keep;
  }
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
