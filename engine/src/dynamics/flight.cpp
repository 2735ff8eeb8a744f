#include "dynamics/flight.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics/flight.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/equations-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

// 1 or 0, see Flock::is_good. Comparisons with NaN are false.
template <std::size_t kRotors>
HWY_INLINE F goodness(const Physics& p, const OdeState<F, kRotors>& s) {
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

template <bool kRk4, bool kHasRotorTerms, std::size_t kRotors>
void fly_all(const Physics& p, const Numbers& n, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    const At at{lane};
    OdeState<F, kRotors> s{load3(flock.travelled, lane),
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
    const Inputs<F> in{load3(flock.wind, lane), load(flock.height, lane), flock.thrust_share, flock.push, flock.twist};
    F set[kSetpoint];
    for (std::size_t i = 0; i < kSetpoint; ++i) set[i] = load(flock.setpoint[i], lane);
    const bool has_own_drive = p.drains || p.command_keep != 0.0F;
    F reach2(0.0F);
    V3 velocity_before = s.velocity;
    V3 turn_before = s.turn;
    for (int tick = first_tick; tick < first_tick + ticks; ++tick) {
      if (tick % p.control_ticks == 0) {
        const OdeState<F, kRotors> seen = s;  // a copy lets the state itself stay in registers
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

template <std::size_t kRotors>
void fly_with(const Physics& p, const Numbers& n, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  const bool has_rotor_terms = p.rotor_drag || p.rotor_lift || p.gyroscopic || p.ground_effect || p.downwash;
  if (p.is_rk4) {
    has_rotor_terms ? fly_all<true, true, kRotors>(p, n, flock, first_tick, ticks, path)
                    : fly_all<true, false, kRotors>(p, n, flock, first_tick, ticks, path);
  } else {
    has_rotor_terms ? fly_all<false, true, kRotors>(p, n, flock, first_tick, ticks, path)
                    : fly_all<false, false, kRotors>(p, n, flock, first_tick, ticks, path);
  }
}

void fly(const Physics& p, const Numbers& n, Flock& flock, int first_tick, int ticks, Lanes<3>* path) {
  p.num_rotors > kMinRotors ? fly_with<kMaxRotors>(p, n, flock, first_tick, ticks, path)
                            : fly_with<kMinRotors>(p, n, flock, first_tick, ticks, path);
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
