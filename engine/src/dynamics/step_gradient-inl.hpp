// The state after a step as a function of recorded numbers. Included once per SIMD target.
#if defined(FLOCKSTEP_DYNAMICS_STEP_GRADIENT_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_DYNAMICS_STEP_GRADIENT_INL_HPP
#undef FLOCKSTEP_DYNAMICS_STEP_GRADIENT_INL_HPP
#else
#define FLOCKSTEP_DYNAMICS_STEP_GRADIENT_INL_HPP
#endif

#include <hwy/highway.h>

#include <cstddef>

#include "base/recorded-inl.hpp"
#include "dynamics/equations-inl.hpp"
#include "dynamics/step_gradient.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

// A drone in flight. `ode.travelled` is its position.
template <class T>
struct Flown {
  OdeState<T> ode;
  Wide3<T> integral;
  T command[kRotors];
};

// Calls f(number, index) for each of the kFlown numbers.
template <class T, class Function>
HWY_INLINE void for_each_number(Flown<T>& s, const Function& f) {
  OdeState<T>& o = s.ode;
  T* const first[] = {&o.travelled.x, &o.travelled.y, &o.travelled.z, &o.velocity.x, &o.velocity.y, &o.velocity.z,
                      &o.rotation.w,  &o.rotation.x,  &o.rotation.y,  &o.rotation.z, &o.turn.x,     &o.turn.y,
                      &o.turn.z,      &s.integral.x,  &s.integral.y,  &s.integral.z};
  static_assert(std::size(first) == kFlownRotor);
  for (std::size_t i = 0; i < kFlownRotor; ++i) f(*first[i], i);
  for (std::size_t i = 0; i < kRotors; ++i) f(o.rotor[i], kFlownRotor + i);
  for (std::size_t i = 0; i < kRotors; ++i) f(s.command[i], kFlownRotor + kRotors + i);
}

// The setpoint of a command, see setpoint_of(). Rotor thrusts are those of the airframe as the controller knows it.
template <class T, class A>
HWY_INLINE void set_from_command(Control control, const Physics& p, const Numbers& n, A at, const T* command, T* set) {
  for (std::size_t i = 0; i < kRotors; ++i) {
    set[i] = command[i];
    if (control != Control::rotor_thrusts) continue;
    set[i] = (sqrt(max(at(n.discriminant) + at(n.four_c2) * command[i], 0.0F)) - at(n.known_thrust[1])) * at(n.half_over_c2);
    if (!p.linear_thrust) continue;
    const T straight = (command[i] - at(n.known_thrust[0])) * at(n.one_over_c1);
    set[i] = select(at(n.known_thrust[2]) > 0.0F, set[i], straight);
  }
}

// Flies a step of a few ticks, with the controller in each. stride: numbers between the setpoints of two ticks, 0 if they all
// have the same.
template <class T, class A>
HWY_NOINLINE void fly_ticks(const Physics& p, int ticks, const Numbers& n, A at, const T* set, std::size_t stride,
                            const Inputs<T>& in, const Lanes<kMaxRotors>& speed_share, Flown<T>& s) {
  const bool has_own_drive = p.drains || p.command_keep != 0.0F;
  for (int tick = 0; tick < ticks; ++tick, set += stride) {
    const OdeState<T> seen = s.ode;
    if (has_own_drive) {
      drive(p, n, at, seen, set, s.integral, speed_share, s.command);
    } else {
      control(p, n, at, seen, set, s.integral, s.command);
    }
    respond(p, n, at, s.command, s.ode.rotor);
    midpoint<true>(p, n, at, s.ode, s.command, in);
  }
}

using R = Recorded<F>;

// A drone before a step as inputs of the tape.
HWY_INLINE Flown<R> input_of(const FlownLanes& flown, std::size_t lane, Tape<F>& tape) {
  Flown<R> s;
  for_each_number(s, [&](R& number, std::size_t i) HWY_ATTR { number = R::input(load(flown[i], lane), tape); });
  return s;
}

HWY_INLINE Flown<R> flown_after(const StepGradient& gradient, const StepStart& start, const Numbers& n, std::size_t lane,
                                const R* set, std::size_t stride, Flown<R> s) {
  const V3 wind = load3(start.wind, lane);
  const Inputs<R> in{{wind.x, wind.y, wind.z}, R(0.0F), start.thrust_share, start.push, start.twist};
  fly_ticks(gradient.physics, gradient.ticks, n, At{lane}, set, stride, in, start.speed_share, s);
  return s;
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
