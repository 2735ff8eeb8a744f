// Equations of motion, including rotor drag: R. Mahony, V. Kumar, P. Corke, "Multirotor aerial vehicles", IEEE Robotics and
// Automation Magazine 19(3), 2012. The attitude controller corrects the thrust direction first, then the heading: D.
// Brescianini and R. D'Andrea, "Tilt-prioritized quadrocopter attitude control", IEEE Transactions on Control Systems
// Technology 28(2), 2020.
#include "dynamics/flight.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics/flight.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

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

// The integrated state of a drone.
struct OdeState {
  V3 travelled, velocity;
  Q rotation;
  V3 turn;
  F rotor[kRotors];
};

// Inputs of a leg.
struct Inputs {
  V3 wind;
  F height;
  const Lanes<kRotors>& thrust_share;
  const Lanes<3>&push, &twist;
};

struct Forces {
  V3 acceleration;  // world frame
  V3 turning;       // angular acceleration, body frame
};

HWY_INLINE F rotor_rate(const Numbers& n, At at, F speed, F command) {
  const F difference = command - speed;
  return difference * select(difference > 0.0F, at(n.inverse_lag_up), at(n.inverse_lag_down));
}

// The rotor speed after a tick or half a tick under the same command.
HWY_INLINE F lagged(F speed, F command, F keep_up, F keep_down) {
  const F behind = speed - command;
  return command + behind * select(behind < 0.0F, keep_up, keep_down);
}

// Rotors without lag reach the commanded speed at once.
HWY_INLINE void respond(const Physics& p, const Numbers& n, At at, const F* command, F* speed) {
  if (!p.instant_up && !p.instant_down) return;
  const F::Mask instant_up = at(n.inverse_lag_up) == 0.0F;
  const F::Mask instant_down = at(n.inverse_lag_down) == 0.0F;
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
template <bool kHasRotorTerms>
FLOCKSTEP_BIG_INLINE Forces forces(const Physics& p, const Numbers& n, At at, const OdeState& s, const F* command,
                                   const Inputs& in) {
  const bool has_drag = kHasRotorTerms && p.rotor_drag, has_lift = kHasRotorTerms && p.rotor_lift;
  const bool has_ground = kHasRotorTerms && p.ground_effect, has_momentum = kHasRotorTerms && p.gyroscopic;
  const bool has_wash = kHasRotorTerms && p.downwash;
  const M3 r = matrix(s.rotation);
  const V3 w = s.turn;
  const V3 air = transpose_times(r, s.velocity - in.wind);
  V3 force{0.0F, 0.0F, 0.0F};
  V3 torque = force;
  F momentum(0.0F);       // rad/s, signed sum of the rotor speeds about z
  F momentum_rate(0.0F);  // its rate of change
  for (std::size_t i = 0; i < kRotors; ++i) {
    const F speed = s.rotor[i];
    const F x = at(n.position[i][0]), y = at(n.position[i][1]), z = at(n.position[i][2]);
    F push = max(at(n.thrust[i][0]) + (at(n.thrust[i][1]) + at(n.thrust[i][2]) * speed) * speed, 0.0F);
    if (has_drag || has_lift) {
      const V3 hub{air.x + (w.y * z - w.z * y), air.y + (w.z * x - w.x * z), air.z + (w.x * y - w.y * x)};
      if (has_lift) push = push + at(n.lift) * (hub.x * hub.x + hub.y * hub.y);
      if (has_drag) {
        const V3 drag{-(speed * (at(n.drag[0]) * hub.x)), -(speed * (at(n.drag[1]) * hub.y)), -(speed * (at(n.drag[2]) * hub.z))};
        force = force + drag;
        torque.x = torque.x + (y * drag.z - z * drag.y);
        torque.y = torque.y + (z * drag.x - x * drag.z);
        torque.z = torque.z + (x * drag.y - y * drag.x);
      }
    }
    if (has_ground) {  // Cheeseman and Bennett: F / (1 - (r / 4h)^2), for upright drones only
      const F hub_height = in.height + s.travelled.z + (r.zx * x + r.zy * y + r.zz * z);
      const F near = at(n.ground_quarter) / max(hub_height, at(n.least_height));
      const F gain = 1.0F / (1.0F - near * near);
      push = push * select(r.zz > 0.0F, gain, 1.0F);
    }
    if (has_wash) push = push * at(in.thrust_share[i]);
    force.z = force.z + push;
    torque.x = torque.x + y * push;
    torque.y = torque.y - x * push;
    torque.z = torque.z + at(n.yaw_torque[i]) * push;
    if (has_momentum) {
      momentum = momentum - at(n.yaw_sign[i]) * speed;
      momentum_rate = momentum_rate - at(n.yaw_sign[i]) * rotor_rate(n, at, speed, command[i]);
    }
  }
  if (p.body_drag) {
    const F fast = sqrt(dot(air, air));
    force.x = force.x - (at(n.linear_drag[0]) + at(n.quadratic_drag[0]) * fast) * air.x;
    force.y = force.y - (at(n.linear_drag[1]) + at(n.quadratic_drag[1]) * fast) * air.y;
    force.z = force.z - (at(n.linear_drag[2]) + at(n.quadratic_drag[2]) * fast) * air.z;
  }
  const V3 spin{at(n.inertia[0]) * w.x, at(n.inertia[1]) * w.y, at(n.inertia[2]) * w.z};
  torque = torque - cross(w, spin);
  if (has_momentum) {
    const F h = at(n.rotor_inertia) * momentum;
    torque.x = torque.x - w.y * h;
    torque.y = torque.y + w.x * h;
    torque.z = torque.z - at(n.rotor_inertia) * momentum_rate;
  }
  V3 acceleration = times(r, force * at(n.inverse_mass));
  acceleration.z = acceleration.z - kG;
  V3 turning{at(n.inverse_inertia[0]) * torque.x, at(n.inverse_inertia[1]) * torque.y, at(n.inverse_inertia[2]) * torque.z};
  if (p.pushed) {
    acceleration = acceleration + V3{at(in.push[0]), at(in.push[1]), at(in.push[2])};
    turning = turning + V3{at(in.twist[0]), at(in.twist[1]), at(in.twist[2])};
  }
  return {acceleration, turning};
}

// Midpoint method, second order. Rotor speeds are exact, and so is the attitude at a constant angular velocity.
template <bool kHasRotorTerms>
FLOCKSTEP_BIG_INLINE void midpoint(const Physics& p, const Numbers& n, At at, OdeState& s, const F* command, const Inputs& in) {
  const F half(0.5F * p.dt);
  const F dt(p.dt);
  const Forces first = forces<kHasRotorTerms>(p, n, at, s, command, in);
  OdeState middle;
  middle.velocity = s.velocity + first.acceleration * half;
  middle.turn = s.turn + first.turning * half;
  middle.travelled = s.travelled + s.velocity * half;
  middle.rotation = turned(s.rotation, s.turn, 0.25F * p.dt);
  for (std::size_t i = 0; i < kRotors; ++i)
    middle.rotor[i] = lagged(s.rotor[i], command[i], at(n.keep_half_up), at(n.keep_half_down));
  const Forces mean = forces<kHasRotorTerms>(p, n, at, middle, command, in);
  s.travelled = s.travelled + middle.velocity * dt;
  s.velocity = s.velocity + mean.acceleration * dt;
  s.rotation = normalised(turned(s.rotation, middle.turn, half));
  s.turn = s.turn + mean.turning * dt;
  for (std::size_t i = 0; i < kRotors; ++i) s.rotor[i] = lagged(s.rotor[i], command[i], at(n.keep_up), at(n.keep_down));
}

struct Rates {
  V3 velocity, acceleration;
  Q rotation;
  V3 turning;
  F rotor[kRotors];
};

template <bool kHasRotorTerms>
HWY_INLINE Rates rates(const Physics& p, const Numbers& n, At at, const OdeState& s, const F* command, const Inputs& in) {
  const Forces f = forces<kHasRotorTerms>(p, n, at, s, command, in);
  Rates r{s.velocity, f.acceleration, rate_of(s.rotation, s.turn), f.turning, {}};
  for (std::size_t i = 0; i < kRotors; ++i) r.rotor[i] = rotor_rate(n, at, s.rotor[i], command[i]);
  return r;
}

HWY_INLINE OdeState moved(const OdeState& s, const Rates& r, F dt) {
  OdeState next{
      s.travelled + r.velocity * dt, s.velocity + r.acceleration * dt, s.rotation + r.rotation * dt, s.turn + r.turning * dt, {}};
  for (std::size_t i = 0; i < kRotors; ++i) next.rotor[i] = s.rotor[i] + r.rotor[i] * dt;
  return next;
}

HWY_INLINE void add(Rates& sum, const Rates& r, F weight) {
  sum.velocity = sum.velocity + r.velocity * weight;
  sum.acceleration = sum.acceleration + r.acceleration * weight;
  sum.rotation = sum.rotation + r.rotation * weight;
  sum.turning = sum.turning + r.turning * weight;
  for (std::size_t i = 0; i < kRotors; ++i) sum.rotor[i] = sum.rotor[i] + r.rotor[i] * weight;
}

// The classical fourth-order Runge-Kutta method, with the rotors as part of the state. The rates are summed as they are
// computed: four of them do not fit into registers.
template <bool kHasRotorTerms>
FLOCKSTEP_BIG_INLINE void runge_kutta(const Physics& p, const Numbers& n, At at, OdeState& s, const F* command,
                                      const Inputs& in) {
  const F half(0.5F * p.dt);
  const F dt(p.dt);
  const F two(2.0F);
  Rates r = rates<kHasRotorTerms>(p, n, at, s, command, in);
  Rates sum = r;
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
HWY_INLINE F turn_gain(F cosine) { return 2.0F / sqrt(max(2.0F * (1.0F + cosine), kTiny)); }

// True if the angle between two directions is within 0.06 degrees of 180 degrees. Its sine then does not give the angle, and
// rounding decides the axis, so any axis will do.
HWY_INLINE F::Mask are_opposite(F cosine, F square_of_sine) { return (square_of_sine < 1e-6F) & (cosine < 0.0F); }

// Shortens a vector to at most this length.
HWY_INLINE V3 shortened(const V3& v, F length) {
  const F square = dot(v, v);
  const F scale = length / sqrt(max(square, kTiny));
  return v * select(square > length * length, scale, 1.0F);
}

HWY_INLINE F clamp(F x, float limit) { return max(min(x, limit), -limit); }

// The output of the outer loops, input of the attitude loop.
struct Aim {
  F thrust;    // m/s^2, along the body's z
  V3 up;       // unit, world frame; target direction of the body's z
  F yaw_rate;  // rad/s
};

// Converts a desired acceleration to thrust and direction. The horizontal part is reduced to keep within the maximum tilt.
HWY_INLINE Aim push_along(const Physics& p, const M3& r, V3 desired) {
  desired.z = max(desired.z + kG, 0.3F * kG);
  const F sideways = sqrt(desired.x * desired.x + desired.y * desired.y);
  const F most = desired.z * p.max_tilt_tan;
  const F scale = select(sideways > most, most / max(sideways, kTiny), 1.0F);
  desired.x = desired.x * scale;
  desired.y = desired.y * scale;
  const F length = sqrt(dot(desired, desired));
  const F thrust = max(desired.x * r.xz + desired.y * r.yz + desired.z * r.zz, 0.0F);
  return {thrust, desired * (1.0F / length), 0.0F};
}

// Yaw rate (rad/s) towards the desired heading.
HWY_INLINE F yaw_towards(const Numbers& n, At at, const M3& r, F cosine, F sine) {
  const F scale = 1.0F / sqrt(max(r.xx * r.xx + r.yx * r.yx, kTiny));
  const F x = r.xx * scale, y = r.yx * scale;
  const F across = x * sine - y * cosine;
  const F along = x * cosine + y * sine;
  return at(n.yaw_gain) * select(are_opposite(along, across * across), 2.0F, across * turn_gain(along));
}

// PI controller from desired velocity to acceleration.
HWY_INLINE V3 accelerate(const Physics& p, const Numbers& n, At at, const V3& velocity, const V3& desired, V3& integral) {
  const V3 error = shortened(desired, p.max_speed_mps) - velocity;
  integral = shortened(integral + error * p.control_dt, at(n.max_integral));
  return shortened(error * at(n.velocity_gain) + integral * at(n.integral_gain), p.max_acceleration);
}

// Rotor speeds for a thrust (m/s^2) and body rates. If the rotors saturate, yaw is reduced first, then the thrust is shifted to
// make room for roll and pitch, and roll and pitch are reduced last.
HWY_INLINE void mix(const Physics& p, const Numbers& n, At at, const OdeState& s, F thrust, V3 desired, F* command) {
  const V3& turn = s.turn;
  desired = {clamp(desired.x, p.max_rate), clamp(desired.y, p.max_rate), clamp(desired.z, p.max_yaw_rate)};
  const auto& inertia = n.known_inertia;
  const V3 spin{at(inertia[0]) * turn.x, at(inertia[1]) * turn.y, at(inertia[2]) * turn.z};
  const V3 gyro = cross(turn, spin);
  const F x = at(n.rate_torque[0]) * (desired.x - turn.x) + gyro.x;
  const F y = at(n.rate_torque[1]) * (desired.y - turn.y) + gyro.y;
  const F z = at(n.rate_torque[2]) * (desired.z - turn.z) + gyro.z;
  const F push = at(n.mass) * thrust;
  F tilt[kRotors], level[kRotors];
  F low, high;
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = at(n.mixer[i][0]) * push;
    tilt[i] = at(n.mixer[i][1]) * x + at(n.mixer[i][2]) * y;
    low = i == 0 ? tilt[i] : min(low, tilt[i]);
    high = i == 0 ? tilt[i] : max(high, tilt[i]);
  }
  const F room = at(n.max_thrust) - at(n.min_thrust);
  const F scale = min(1.0F, room / max(high - low, at(n.thrust_tiny)));
  F below(0.0F), above(0.0F);  // N, excess beyond the range of the rotors
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = level[i] + scale * tilt[i];
    below = max(below, at(n.min_thrust) - level[i]);
    above = max(above, level[i] - at(n.max_thrust));
  }
  F share(1.0F);  // share of the desired yaw
  for (std::size_t i = 0; i < kRotors; ++i) {
    level[i] = level[i] + (below - above);
    const F yaw = at(n.mixer[i][3]) * z;
    const F left = select(yaw > 0.0F, at(n.max_thrust) - level[i], level[i] - at(n.min_thrust));
    share = min(share, max(left, 0.0F) / max(abs(yaw), at(n.thrust_tiny)));
  }
  for (std::size_t i = 0; i < kRotors; ++i) {
    const F want = max(min(level[i] + share * (at(n.mixer[i][3]) * z), at(n.max_thrust)), at(n.min_thrust));
    // Invert the thrust curve, which is a parabola or a straight line.
    const F root = sqrt(max(at(n.discriminant) + at(n.four_c2) * want, 0.0F)) - at(n.known_thrust[1]);
    F speed = root * at(n.half_over_c2);
    if (p.linear_thrust) {
      const F straight = (want - at(n.known_thrust[0])) * at(n.one_over_c1);
      speed = select(at(n.known_thrust[2]) > 0.0F, speed, straight);
    }
    if (p.leads) {
      const F leading = s.rotor[i] + at(n.lead) * (speed - s.rotor[i]);
      speed = select(at(n.lead) > 1.0F, leading, speed);
    }
    command[i] = max(min(speed, at(n.max_speed)), at(n.min_speed));
  }
}

// Runs the outer loops, starting at the stage of the setpoint.
HWY_INLINE Aim aim_of(const Physics& p, const Numbers& n, At at, const OdeState& s, const M3& r, const F* set, V3& integral) {
  if (p.stage == Stage::attitude) return {set[0], {set[1], set[2], set[3]}, yaw_towards(n, at, r, set[4], set[5])};
  V3 desired{set[0], set[1], set[2]};
  if (p.stage == Stage::acceleration) {
    desired = shortened(desired, p.max_acceleration);
  } else {
    if (p.stage == Stage::position) {
      desired = (desired - s.travelled) * at(n.position_gain);
    } else if (p.stage == Stage::heading_velocity) {
      const F scale = 1.0F / sqrt(max(r.xx * r.xx + r.yx * r.yx, kTiny));
      const F x = r.xx * scale, y = r.yx * scale;
      desired = {x * set[0] - y * set[1], y * set[0] + x * set[1], set[2]};
    }
    desired = accelerate(p, n, at, s.velocity, desired, integral);
  }
  const bool has_rate = p.stage == Stage::velocity || p.stage == Stage::heading_velocity;
  Aim aim = push_along(p, r, desired);
  aim.yaw_rate = has_rate ? set[3] : yaw_towards(n, at, r, set[3], set[4]);
  return aim;
}

// Body rates that turn the body's z to `up` the shortest way and yaw about `up`. An inverted drone turns about x.
HWY_INLINE V3 rates_towards(const Physics& p, const Numbers& n, At at, const M3& r, const Aim& aim) {
  const V3 up = transpose_times(r, aim.up);
  const F gain = at(n.attitude_gain) * turn_gain(up.z);
  const F yaw = clamp(aim.yaw_rate, p.max_yaw_rate);
  const F::Mask is_inverted = are_opposite(up.z, up.x * up.x + up.y * up.y);
  const F roll = select(is_inverted, at(n.twice_attitude_gain), -(up.y * gain));
  const F pitch = select(is_inverted, 0.0F, up.x * gain);
  return {roll + r.zx * yaw, pitch + r.zy * yaw, r.zz * yaw};
}

// The controller cascade. It is not inlined, so that the loops over ticks are compiled once instead of once for each stage.
HWY_NOINLINE void control(const Physics& p, const Numbers& n, At at, const OdeState& s, const F* set, V3& integral, F* command) {
  if (p.stage == Stage::rotors) {
    for (std::size_t i = 0; i < kRotors; ++i) command[i] = set[i];
    return;
  }
  F thrust = set[0];
  V3 turn{set[1], set[2], set[3]};
  if (p.stage != Stage::rates) {
    const M3 r = matrix(s.rotation);
    const Aim aim = aim_of(p, n, at, s, r, set, integral);
    thrust = aim.thrust;
    turn = rates_towards(p, n, at, r, aim);
  }
  mix(p, n, at, s, thrust, turn, command);
}

// -------------------------------------------------------------------------------------------------------------- the flight

// 1 or 0, see Flock::is_good. Comparisons with NaN are false.
HWY_INLINE F goodness(const Physics& p, const OdeState& s) {
  const F fastest = max(max(abs(s.velocity.x), abs(s.velocity.y)), abs(s.velocity.z));
  const F turn2 = dot(s.turn, s.turn);
  const F square =
      s.rotation.w * s.rotation.w + s.rotation.x * s.rotation.x + s.rotation.y * s.rotation.y + s.rotation.z * s.rotation.z;
  // 0 times a non-finite number is NaN.
  F nothing = (dot(s.velocity, s.velocity) + turn2 + dot(s.travelled, s.travelled) + square) * 0.0F;
  for (std::size_t i = 0; i < kRotors; ++i) nothing = nothing + s.rotor[i] * 0.0F;
  const F yes = select(nothing < 1.0F, F(1.0F), 0.0F);
  const F slow = select(turn2 > p.max_turn * p.max_turn, 0.0F, yes);
  return select(fastest > kMaxSpeed, 0.0F, select(abs(square - 1.0F) < 1e-2F, slow, 0.0F));
}

// Runs the controller with its lag, and lets the motors follow as far as their battery allows.
HWY_NOINLINE void drive(const Physics& p, const Numbers& n, At at, const OdeState& s, const F* set, V3& integral,
                        const Lanes<kRotors>& share, F* command) {
  F wanted[kRotors];
  control(p, n, at, s, set, integral, wanted);
  for (std::size_t i = 0; i < kRotors; ++i) {
    if (p.drains) wanted[i] = wanted[i] * at(share[i]);
    command[i] = wanted[i] + (command[i] - wanted[i]) * p.command_keep;
  }
}

template <bool kRk4, bool kHasRotorTerms>
void fly_all(const Physics& p, const Numbers& n, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    const At at{lane};
    OdeState s{load3(flock.travelled, lane),
               load3(flock.velocity, lane),
               load_rotation(flock.rotation, lane),
               load3(flock.turn, lane),
               {}};
    V3 integral = load3(flock.error_integral, lane);
    F command[kRotors];
    for (std::size_t i = 0; i < kRotors; ++i) {
      s.rotor[i] = load(flock.rotor[i], lane);
      command[i] = load(flock.rotor_command[i], lane);
    }
    const Inputs in{load3(flock.wind, lane), load(flock.height, lane), flock.thrust_share, flock.push, flock.twist};
    F set[7];
    for (std::size_t i = 0; i < 7; ++i) set[i] = load(flock.setpoint[i], lane);
    const bool has_own_drive = p.drains || p.command_keep != 0.0F;
    F reach2(0.0F);
    V3 velocity_before = s.velocity;
    V3 turn_before = s.turn;
    for (int tick = first_tick; tick < first_tick + ticks; ++tick) {
      if (tick % p.control_ticks == 0) {
        const OdeState seen = s;  // a copy lets the state itself stay in registers
        if (!flock.arrivals.empty()) take_arrivals(flock.arrivals, tick, lane, set);
        if (has_own_drive) {
          drive(p, n, at, seen, set, integral, flock.speed_share, command);
        } else {
          control(p, n, at, seen, set, integral, command);
        }
      }
      respond(p, n, at, command, s.rotor);
      velocity_before = s.velocity;
      turn_before = s.turn;
      if constexpr (kRk4) {
        runge_kutta<kHasRotorTerms>(p, n, at, s, command, in);
      } else {
        midpoint<kHasRotorTerms>(p, n, at, s, command, in);
      }
      reach2 = max(reach2, dot(s.travelled, s.travelled));
      if (path != nullptr) store3(s.travelled, path[tick - first_tick], lane);
    }
    const F per_second(1.0F / p.dt);
    store3((s.velocity - velocity_before) * per_second, flock.acceleration, lane);
    store3((s.turn - turn_before) * per_second, flock.angular_acceleration, lane);
    store3(s.travelled, flock.travelled, lane);
    store3(s.velocity, flock.velocity, lane);
    store_rotation(s.rotation, flock.rotation, lane);
    store3(s.turn, flock.turn, lane);
    store3(integral, flock.error_integral, lane);
    for (std::size_t i = 0; i < kRotors; ++i) {
      store(s.rotor[i], flock.rotor[i], lane);
      store(command[i], flock.rotor_command[i], lane);
    }
    store(reach2, flock.reach2, lane);
    store(goodness(p, s), flock.is_good, lane);
  }
}

void fly(const Physics& p, const Numbers& n, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  const bool has_rotor_terms = p.rotor_drag || p.rotor_lift || p.gyroscopic || p.ground_effect || p.downwash;
  if (p.is_rk4) {
    has_rotor_terms ? fly_all<true, true>(p, n, flock, first_tick, ticks, path)
                    : fly_all<true, false>(p, n, flock, first_tick, ticks, path);
  } else {
    has_rotor_terms ? fly_all<false, true>(p, n, flock, first_tick, ticks, path)
                    : fly_all<false, false>(p, n, flock, first_tick, ticks, path);
  }
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::dynamics {

HWY_EXPORT(fly);

void fly(const Physics& physics, const LaneNumbers& numbers, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  HWY_DYNAMIC_DISPATCH(fly)(physics, numbers, flock, first_tick, ticks, path);
}

void fly(const Physics& physics, Flock& flock, int first_tick, int ticks) {
  fly(physics, physics.lanes, flock, first_tick, ticks);
}

}  // namespace flockstep::dynamics
#endif
