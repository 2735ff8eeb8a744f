// A lower bound for flight: the minimal code that solves the same equations. It has gravity, thrust, rotor lag up and down, and
// body drag. Its commands are rotor speeds. It has no other terms, no controller, no switches, and reports no accelerations and
// no reach. Included once per SIMD target.
#ifndef FLOCKSTEP_BENCH_BARE_FLIGHT_TYPES
#define FLOCKSTEP_BENCH_BARE_FLIGHT_TYPES
#include <cstddef>

#include "dynamics/flight.hpp"

namespace bench {

// Parameters of a quadrotor in SI units. Frames and signs are as in docs/concepts/flight-model.md.
struct Quadrotor {
  float mass, inertia[3];
  float x[4], y[4], yaw[4];  // per rotor: x and y, and the ratio of torque about z to thrust
  float thrust[3];           // c0, c1, c2
  float lag_up, lag_down;    // s
  float linear_drag[3], quadratic_drag[3];
};

// One run of `ticks` ticks of dt seconds. The setpoints are rotor speeds. `fused` enables fused multiply-add, which the engine
// leaves out because results would differ between processors.
struct Flight {
  float dt;
  int ticks;
  bool is_rk4, fused;
};

void fly_bare(const Quadrotor& quadrotor, const Flight& flight, flockstep::dynamics::Flock& flock);

}  // namespace bench
#endif

#if defined(FLOCKSTEP_BENCH_BARE_FLIGHT_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_BENCH_BARE_FLIGHT_INL_HPP
#undef FLOCKSTEP_BENCH_BARE_FLIGHT_INL_HPP
#else
#define FLOCKSTEP_BENCH_BARE_FLIGHT_INL_HPP
#endif

#include <hwy/highway.h>

#include <cmath>
#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace bench::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;
using flockstep::dynamics::Flock;
using flockstep::dynamics::kLanes;

constexpr hn::CappedTag<float, kLanes> kFloats;
using V = hn::Vec<decltype(kFloats)>;

// State and derivative layout: position 0 to 2, velocity 3 to 5, rotation 6 to 9, angular velocity 10 to 12, rotors 13 to 16.
constexpr std::size_t kPlace = 0, kVelocity = 3, kRotation = 6, kTurn = 10, kRotor = 13, kStates = 17;

template <bool kFused>
struct Bare {
  static HWY_INLINE V set(float x) { return hn::Set(kFloats, x); }
  static HWY_INLINE V mul(V a, V b) { return hn::Mul(a, b); }
  static HWY_INLINE V add(V a, V b) { return hn::Add(a, b); }
  static HWY_INLINE V sub(V a, V b) { return hn::Sub(a, b); }
  static HWY_INLINE V add_to(V c, V a, V b) { return kFused ? hn::MulAdd(a, b, c) : add(c, mul(a, b)); }        // c + a b
  static HWY_INLINE V take_from(V c, V a, V b) { return kFused ? hn::NegMulAdd(a, b, c) : sub(c, mul(a, b)); }  // c - a b

  const Quadrotor& quadrotor;
  const float dt;
  const float to_force[3] = {1.0F / quadrotor.mass, 1.0F / quadrotor.mass, 1.0F / quadrotor.mass};
  // The constants of Euler's equations: 1 / J, and (J_y - J_z) / J_x with its cyclic permutations.
  const float inverse_inertia[3] = {1.0F / quadrotor.inertia[0], 1.0F / quadrotor.inertia[1], 1.0F / quadrotor.inertia[2]};
  const float gyro[3] = {(quadrotor.inertia[1] - quadrotor.inertia[2]) / quadrotor.inertia[0],
                         (quadrotor.inertia[2] - quadrotor.inertia[0]) / quadrotor.inertia[1],
                         (quadrotor.inertia[0] - quadrotor.inertia[1]) / quadrotor.inertia[2]};
  const float keep_up[2] = {std::exp(-0.5F * dt / quadrotor.lag_up), std::exp(-dt / quadrotor.lag_up)};
  const float keep_down[2] = {std::exp(-0.5F * dt / quadrotor.lag_down), std::exp(-dt / quadrotor.lag_down)};

  // Computes accelerations: linear in a[0..2], angular in a[3..5].
  HWY_INLINE void accelerate(const V* s, V* a) const {
    const V *v = s + kVelocity, *q = s + kRotation, *w = s + kTurn;
    const V x2 = add(q[1], q[1]), y2 = add(q[2], q[2]), z2 = add(q[3], q[3]);
    const V yy = mul(q[2], y2), zz = mul(q[3], z2);
    const V wx = mul(q[0], x2), wy = mul(q[0], y2), wz = mul(q[0], z2);
    const V one = set(1.0F);
    const V r[9] = {sub(sub(one, yy), zz),
                    sub(mul(q[1], y2), wz),
                    add_to(wy, q[1], z2),
                    add_to(wz, q[1], y2),
                    take_from(sub(one, zz), q[1], x2),
                    sub(mul(q[2], z2), wx),
                    sub(mul(q[1], z2), wy),
                    add_to(wx, q[2], z2),
                    take_from(sub(one, yy), q[1], x2)};
    V air[3];
    for (std::size_t i = 0; i < 3; ++i) air[i] = add_to(add_to(mul(r[i], v[0]), r[3 + i], v[1]), r[6 + i], v[2]);
    const V fast = hn::Sqrt(add_to(add_to(mul(air[0], air[0]), air[1], air[1]), air[2], air[2]));
    V push[4];
    for (std::size_t i = 0; i < 4; ++i) {
      const V speed = s[kRotor + i];
      const V slope = add_to(set(quadrotor.thrust[1]), set(quadrotor.thrust[2]), speed);
      push[i] = hn::Max(add_to(set(quadrotor.thrust[0]), slope, speed), hn::Zero(kFloats));
    }
    V force[3];
    for (std::size_t i = 0; i < 3; ++i) {
      const V drag = add_to(set(quadrotor.linear_drag[i]), set(quadrotor.quadratic_drag[i]), fast);
      force[i] = i < 2 ? hn::Neg(mul(drag, air[i])) : take_from(add(add(push[0], push[1]), add(push[2], push[3])), drag, air[i]);
      force[i] = mul(force[i], set(to_force[i]));
    }
    for (std::size_t i = 0; i < 3; ++i) {
      a[i] = add_to(add_to(mul(r[3 * i], force[0]), r[3 * i + 1], force[1]), r[3 * i + 2], force[2]);
    }
    a[2] = sub(a[2], set(static_cast<float>(flockstep::kGravity)));
    V torque[3] = {mul(set(quadrotor.y[0]), push[0]), mul(set(-quadrotor.x[0]), push[0]), mul(set(quadrotor.yaw[0]), push[0])};
    for (std::size_t i = 1; i < 4; ++i) {
      torque[0] = add_to(torque[0], set(quadrotor.y[i]), push[i]);
      torque[1] = take_from(torque[1], set(quadrotor.x[i]), push[i]);
      torque[2] = add_to(torque[2], set(quadrotor.yaw[i]), push[i]);
    }
    for (std::size_t i = 0; i < 3; ++i) {
      a[3 + i] = add_to(mul(torque[i], set(inverse_inertia[i])), set(gyro[i]), mul(w[(i + 1) % 3], w[(i + 2) % 3]));
    }
  }

  // Quaternion product of q and (s, v).
  static HWY_INLINE void product(const V* q, V s, const V* v, V* out) {
    out[0] = take_from(take_from(take_from(mul(q[0], s), q[1], v[0]), q[2], v[1]), q[3], v[2]);
    out[1] = take_from(add_to(add_to(mul(q[0], v[0]), q[1], s), q[2], v[2]), q[3], v[1]);
    out[2] = add_to(add_to(take_from(mul(q[0], v[1]), q[1], v[2]), q[2], s), q[3], v[0]);
    out[3] = add_to(take_from(add_to(mul(q[0], v[2]), q[1], v[1]), q[2], v[0]), q[3], s);
  }

  // Rotates q at angular velocity w for a time of 2 * `half`, using the series of sine and cosine.
  static HWY_INLINE void turn(const V* q, const V* w, float half, V* out) {
    const V v[3] = {mul(w[0], set(half)), mul(w[1], set(half)), mul(w[2], set(half))};
    const V x = add_to(add_to(mul(v[0], v[0]), v[1], v[1]), v[2], v[2]);
    const V cosine = take_from(set(1.0F), x, take_from(set(1.0F / 2), x, take_from(set(1.0F / 24), x, set(1.0F / 720))));
    const V sine = take_from(set(1.0F), x, take_from(set(1.0F / 6), x, take_from(set(1.0F / 120), x, set(1.0F / 5040))));
    const V axis[3] = {mul(v[0], sine), mul(v[1], sine), mul(v[2], sine)};
    product(q, cosine, axis, out);
  }

  static HWY_INLINE void normalise(V* q) {
    const V square = add_to(add_to(add_to(mul(q[0], q[0]), q[1], q[1]), q[2], q[2]), q[3], q[3]);
    const V scale = take_from(set(1.5F), set(0.5F), square);
    for (std::size_t i = 0; i < 4; ++i) q[i] = mul(q[i], scale);
  }

  HWY_INLINE V lagged(V speed, V told, int which) const {
    const V behind = sub(speed, told);
    const V keep = hn::IfThenElse(hn::Lt(behind, hn::Zero(kFloats)), set(keep_up[which]), set(keep_down[which]));
    return add_to(told, behind, keep);
  }

  HWY_INLINE void midpoint(V* s, const V* told) const {
    const V half = set(0.5F * dt), whole = set(dt);
    V a[6], middle[kStates];
    accelerate(s, a);
    for (std::size_t i = 0; i < 3; ++i) middle[kVelocity + i] = add_to(s[kVelocity + i], a[i], half);
    for (std::size_t i = 0; i < 3; ++i) middle[kTurn + i] = add_to(s[kTurn + i], a[3 + i], half);
    turn(s + kRotation, s + kTurn, 0.25F * dt, middle + kRotation);
    for (std::size_t i = kRotor; i < kStates; ++i) middle[i] = lagged(s[i], told[i - kRotor], 0);
    accelerate(middle, a);
    V rotation[4];
    turn(s + kRotation, middle + kTurn, 0.5F * dt, rotation);
    normalise(rotation);
    for (std::size_t i = 0; i < 4; ++i) s[kRotation + i] = rotation[i];
    for (std::size_t i = 0; i < 3; ++i) {
      s[kPlace + i] = add_to(s[kPlace + i], middle[kVelocity + i], whole);
      s[kVelocity + i] = add_to(s[kVelocity + i], a[i], whole);
      s[kTurn + i] = add_to(s[kTurn + i], a[3 + i], whole);
    }
    for (std::size_t i = kRotor; i < kStates; ++i) s[i] = lagged(s[i], told[i - kRotor], 1);
  }

  HWY_INLINE void rates(const V* s, const V* told, V* rate) const {
    V a[6];
    accelerate(s, a);
    for (std::size_t i = 0; i < 3; ++i) {
      rate[kPlace + i] = s[kVelocity + i];
      rate[kVelocity + i] = a[i];
      rate[kTurn + i] = a[3 + i];
    }
    const V half[3] = {mul(s[kTurn], set(0.5F)), mul(s[kTurn + 1], set(0.5F)), mul(s[kTurn + 2], set(0.5F))};
    const V* q = s + kRotation;
    rate[kRotation] = hn::Neg(add_to(add_to(mul(q[1], half[0]), q[2], half[1]), q[3], half[2]));
    rate[kRotation + 1] = take_from(add_to(mul(q[0], half[0]), q[2], half[2]), q[3], half[1]);
    rate[kRotation + 2] = add_to(take_from(mul(q[0], half[1]), q[1], half[2]), q[3], half[0]);
    rate[kRotation + 3] = take_from(add_to(mul(q[0], half[2]), q[1], half[1]), q[2], half[0]);
    for (std::size_t i = 0; i < 4; ++i) {
      const V behind = sub(told[i], s[kRotor + i]);
      const V per_second =
          hn::IfThenElse(hn::Gt(behind, hn::Zero(kFloats)), set(1.0F / quadrotor.lag_up), set(1.0F / quadrotor.lag_down));
      rate[kRotor + i] = mul(behind, per_second);
    }
  }

  HWY_INLINE void rk4(V* s, const V* told) const {
    constexpr float kAhead[3] = {0.5F, 0.5F, 1.0F};
    V rate[kStates], sum[kStates], at[kStates];
    rates(s, told, rate);
    for (std::size_t i = 0; i < kStates; ++i) sum[i] = rate[i];
    for (std::size_t stage = 0; stage < 3; ++stage) {
      for (std::size_t i = 0; i < kStates; ++i) at[i] = add_to(s[i], rate[i], set(kAhead[stage] * dt));
      rates(at, told, rate);
      for (std::size_t i = 0; i < kStates; ++i) sum[i] = stage < 2 ? add_to(sum[i], rate[i], set(2.0F)) : add(sum[i], rate[i]);
    }
    for (std::size_t i = 0; i < kStates; ++i) s[i] = add_to(s[i], sum[i], set(dt / 6.0F));
    normalise(s + kRotation);
  }

  template <bool kRk4>
  void fly(int ticks, Flock& flock) const {
    for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(kFloats)) {
      V s[kStates], told[4];
      const auto each = [&](auto&& f) {
        for (std::size_t i = 0; i < 3; ++i) f(flock.travelled[i], s[kPlace + i]);
        for (std::size_t i = 0; i < 3; ++i) f(flock.velocity[i], s[kVelocity + i]);
        for (std::size_t i = 0; i < 4; ++i) f(flock.rotation[i], s[kRotation + i]);
        for (std::size_t i = 0; i < 3; ++i) f(flock.turn[i], s[kTurn + i]);
        for (std::size_t i = 0; i < 4; ++i) f(flock.rotor[i], s[kRotor + i]);
      };
      each([&](const auto& lanes, V& value) HWY_ATTR { value = hn::Load(kFloats, lanes.data() + lane); });
      for (std::size_t i = 0; i < 4; ++i) told[i] = hn::Load(kFloats, flock.setpoint[i].data() + lane);
      for (int tick = 0; tick < ticks; ++tick) {
        if constexpr (kRk4) {
          rk4(s, told);
        } else {
          midpoint(s, told);
        }
      }
      each([&](auto& lanes, const V& value) HWY_ATTR { hn::Store(value, kFloats, lanes.data() + lane); });
    }
  }
};

template <bool kFused>
void fly_bare_by(const Quadrotor& quadrotor, const Flight& flight, Flock& flock) {
  const Bare<kFused> bare{quadrotor, flight.dt};
  flight.is_rk4 ? bare.template fly<true>(flight.ticks, flock) : bare.template fly<false>(flight.ticks, flock);
}

void fly_bare(const Quadrotor& quadrotor, const Flight& flight, Flock& flock) {
  flight.fused ? fly_bare_by<true>(quadrotor, flight, flock) : fly_bare_by<false>(quadrotor, flight, flock);
}

}  // namespace bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
