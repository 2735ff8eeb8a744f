// Losses and observations of flight tasks, templates over the number type. Where an episode ends without a derivative, by a
// contact or a missed gate, a smooth term stands in for it. The weights are for learning; the task's reward has its own.
#include "tasks/flight_gradient.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/flight_gradient.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/step_gradient-inl.hpp"
#include "tasks/flight_task.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
using namespace flockstep::dynamics;
using namespace flockstep::dynamics::HWY_NAMESPACE;

// The constants of the lanes, and their number in an observation.
struct Constants {
  std::span<const Lane> lanes;
  std::size_t lane;
  HWY_INLINE F operator[](std::size_t i) const { return load(lanes[i], lane); }
  HWY_INLINE V3 at(std::size_t i) const { return {(*this)[i], (*this)[i + 1], (*this)[i + 2]}; }
};

// The arguments of a loss.
struct Step {
  const Flown<R>&before, &after;
  const R *action, *action_before;
  Constants c;
  F discount;
  float step_s;
};

HWY_INLINE Wide3<R> recorded(const V3& v) { return {v.x, v.y, v.z}; }
HWY_INLINE R length(const Wide3<R>& v, float least) { return sqrt(dot(v, v) + least * least); }
HWY_INLINE R change(const Step& s) {
  R sum(0.0F);
  for (std::size_t i = 0; i < kActions; ++i) {
    const R difference = s.action[i] - s.action_before[i];
    sum = sum + difference * difference;
  }
  return sum;
}
HWY_INLINE R spin(const Step& s) {
  const Wide3<R>& turn = s.after.ode.turn;
  return dot(turn, turn) * (1.0F / (kSpinUnit * kSpinUnit));
}

HWY_INLINE void put(const Wide3<R>& v, R*& to) {
  *to++ = v.x;
  *to++ = v.y;
  *to++ = v.z;
}
// Velocity, up vector, angular velocity and rotor speeds; the constants `at` hold the unit of the rotor speeds.
HWY_INLINE void put_flight(const Flown<R>& s, const Matrix3<R>& to_world, const Constants& c, std::size_t at, R*& to) {
  put(transpose_times(to_world, s.ode.velocity), to);
  put({to_world.zx, to_world.zy, to_world.zz}, to);
  put(s.ode.turn * R(1.0F / kSpinUnit), to);
  for (std::size_t i = 0; i < kRotors; ++i) {
    const R away = s.ode.rotor[i] - c[at];
    *to++ = away * select(away > 0.0F, c[at + 2], c[at + 1]);
  }
}

// Constants: the point, and the unit of the rotor speeds (hovering, 1 / below, 1 / above).
struct HoverTerms {
  static HWY_INLINE void observe(const Flown<R>& s, const R*, const Constants& c, R* to) {
    const Matrix3<R> r = matrix(s.ode.rotation);
    put(transpose_times(r, recorded(c.at(0)) - s.ode.travelled), to);
    put_flight(s, r, c, 3, to);
  }
  static HWY_INLINE R loss(const Step& s) {
    R effort(0.0F);
    for (std::size_t i = 0; i < kActions; ++i) effort = effort + s.action[i] * s.action[i];
    return length(recorded(s.c.at(0)) - s.after.ode.travelled, 0.1F) + length(s.after.ode.velocity, 0.1F) * 0.1F +
           spin(s) * 0.005F + effort * 0.005F;
  }
};

// Constants: point and velocity of the path after the step, sine and cosine of its yaw then and now, the unit of the rotor
// speeds, and the observed points.
struct TrackTerms {
  static constexpr std::size_t kYawAfter = 6, kYawNow = 8, kUnit = 10, kPoints = 13;

  // Sine and cosine of the yaw that is missing.
  static HWY_INLINE void missing(const Matrix3<R>& r, F sine, F cosine, R* out) {
    const R scale = 1.0F / sqrt(max(r.xx * r.xx + r.yx * r.yx, 1e-6F));
    out[0] = (r.xx * sine - r.yx * cosine) * scale;
    out[1] = (r.xx * cosine + r.yx * sine) * scale;
  }
  static HWY_INLINE void observe(const Flown<R>& s, const R*, const Constants& c, R* to) {
    const Matrix3<R> r = matrix(s.ode.rotation);
    for (std::size_t i = kPoints; i < c.lanes.size(); i += 3) put(transpose_times(r, recorded(c.at(i)) - s.ode.travelled), to);
    put_flight(s, r, c, kUnit, to);
    missing(r, c[kYawNow], c[kYawNow + 1], to);
  }
  static HWY_INLINE R loss(const Step& s) {
    R yaw[2];
    missing(matrix(s.after.ode.rotation), s.c[kYawAfter], s.c[kYawAfter + 1], yaw);
    return length(recorded(s.c.at(0)) - s.after.ode.travelled, 0.05F) +
           length(recorded(s.c.at(3)) - s.after.ode.velocity, 0.1F) * 0.1F + (1.0F - yaw[1]) * 0.1F + spin(s) * 0.005F +
           change(s) * 0.005F;
  }
};

// Constants: centre of the gate that is next after the step, 1 if it is another one than before, the scale of the observation,
// the least height, left and up of the gate before the step, the cap on the speed, and the observed gates: centre and normal of
// each.
struct RaceTerms {
  static constexpr std::size_t kPassed = 3, kScale = 4, kLowest = 5, kLeft = 6, kUp = 9, kCap = 12, kGates = 13;
  static constexpr float kOpening = 0.15F;  // m from the centre within which a crossing costs nothing
  static constexpr float kWide = 3.0F;      // m beyond which it is no crossing of the gate
  static constexpr float kAhead = 0.25F;    // of a step: a crossing is seen before its contact

  static HWY_INLINE void observe(const Flown<R>& s, const R* action_before, const Constants& c, R* to) {
    const Matrix3<R> r = matrix(s.ode.rotation);
    const R scale = c[kScale];
    for (std::size_t i = kGates; i < c.lanes.size(); i += 6) {
      put(transpose_times(r, recorded(c.at(i)) - s.ode.travelled) * scale, to);
      put(transpose_times(r, recorded(c.at(i + 3))), to);
    }
    put(transpose_times(r, s.ode.velocity) * scale, to);
    put({r.zx, r.zy, r.zz}, to);
    put(s.ode.turn * scale, to);
    for (std::size_t i = 0; i < kActions; ++i) to[i] = action_before[i];
  }
  static HWY_INLINE R loss(const Step& s) {
    const Wide3<R> from_center = s.after.ode.travelled - recorded(s.c.at(kGates));
    const Wide3<R> normal = recorded(s.c.at(kGates + 3));
    const R before = dot(s.before.ode.travelled - recorded(s.c.at(kGates)), normal);
    const R after = dot(from_center + s.after.ode.velocity * R(kAhead * s.step_s), normal);
    const R left = dot(from_center, recorded(s.c.at(kLeft))), up = dot(from_center, recorded(s.c.at(kUp)));
    const R aside = max(length({left, up, 0.0F}, 1e-3F) - kOpening, 0.0F);
    const auto crosses = (before < 0.0F) & (after >= 0.0F) & (aside < kWide);
    const R progress = select(s.c[kPassed] > 0.5F, R(0.0F), length(from_center, 0.01F)) -
                       length(s.after.ode.travelled - recorded(s.c.at(0)), 0.01F) * s.discount;
    const R fast = max(length(s.after.ode.velocity, 0.1F) - s.c[kCap], 0.0F);
    const R low = max(s.c[kLowest] - s.after.ode.travelled.z, 0.0F);
    return progress + select(crosses, aside * aside * 100.0F, R(0.0F)) + low * low + fast * 0.1F + spin(s) * 0.05F +
           change(s) * 0.003F;
  }
};

template <class Task>
double step_of(const StepGradient& gradient, Control control, const GroupNumbers& numbers, const GradientStep& step,
               TapeMemory<float>& memory, FlownLanes& d_flown, Lanes<4>& d_action, Lanes<4>& d_action_before,
               TickCommands* late) {
  Tape<F> tape(memory);
  constexpr std::size_t kSet = 7;
  const std::size_t late_ticks = late != nullptr ? late->command.size() : 0;
  AlignedVector<R> late_commands(kActions * late_ticks), late_sets(kSet * late_ticks, R(0.0F));
  double total = 0.0;
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    tape.clear();
    Flown<R> before = input_of(step.start.flown, lane, tape);
    R action[kActions], action_before[kActions], command[kActions], set[kSet];
    for (std::size_t i = 0; i < kActions; ++i) {
      action[i] = R::input(load(step.action[i], lane), tape);
      action_before[i] = R::input(load(step.action_before[i], lane), tape);
      const auto slope = select(action[i] > 0.0F, load(numbers.up[i], lane), load(numbers.down[i], lane));
      if (late == nullptr) command[i] = action[i] * slope + load(numbers.middle[i], lane);
    }
    for (std::size_t tick = 0; tick < late_ticks; ++tick) {
      R* const of_tick = late_commands.data() + kActions * tick;
      for (std::size_t i = 0; i < kActions; ++i) of_tick[i] = R::input(load(late->command[tick][i], lane), tape);
      set_from_command(control, gradient.physics, numbers.numbers, At{lane}, of_tick, late_sets.data() + kSet * tick);
    }
    if (late == nullptr) {
      for (R& number : set) number = R(0.0F);
      set_from_command(control, gradient.physics, numbers.numbers, At{lane}, command, set);
    }
    Flown<R> after = flown_after(gradient, step.start, numbers.numbers, lane, late != nullptr ? late_sets.data() : set,
                                 late != nullptr ? kSet : 0, before);
    const auto goes_on = load(step.goes_on, lane) > 0.5F;
    for_each_number(after, [&](R& number, std::size_t i) HWY_ATTR {
      number = with_value(number, select(goes_on, load(step.after[i], lane), number.value));
    });
    const F weight = load(step.weight, lane);
    const R loss =
        Task::loss({before, after, action, action_before, {step.constants, lane}, load(step.discount, lane), gradient.step_s()});
    tape.begin();
    tape.add_derivative(loss.id, weight);
    for_each_number(after, [&](R& number, std::size_t i)
                               HWY_ATTR { tape.add_derivative(number.id, value_if(goes_on, load(d_flown[i], lane))); });
    tape.flow_back();
    for_each_number(before, [&](R& number, std::size_t i) HWY_ATTR { store(tape.derivative(number.id), d_flown[i], lane); });
    for (std::size_t i = 0; i < kActions; ++i) {
      store(tape.derivative(action[i].id), d_action[i], lane);
      store(tape.derivative(action_before[i].id), d_action_before[i], lane);
      for (std::size_t tick = 0; tick < late_ticks; ++tick) {
        store(tape.derivative(late_commands[kActions * tick + i].id), late->d_command[tick][i], lane);
      }
    }
    alignas(64) float losses[F::kCount];
    (value_if(weight > 0.0F, loss.value) * weight).store(losses);
    for (const float each : losses) total += static_cast<double>(each);
  }
  return total;
}

double step_back(Terms terms, const StepGradient& gradient, Control control, const GroupNumbers& numbers,
                 const GradientStep& step, TapeMemory<float>& memory, FlownLanes& d_flown, Lanes<4>& d_action,
                 Lanes<4>& d_action_before, TickCommands* late) {
  switch (terms) {
    case Terms::hover:
      return step_of<HoverTerms>(gradient, control, numbers, step, memory, d_flown, d_action, d_action_before, late);
    case Terms::track:
      return step_of<TrackTerms>(gradient, control, numbers, step, memory, d_flown, d_action, d_action_before, late);
    case Terms::race:
      break;
  }
  return step_of<RaceTerms>(gradient, control, numbers, step, memory, d_flown, d_action, d_action_before, late);
}

void observe_terms(Terms terms, const Flown<R>& s, const R* action_before, const Constants& c, R* to) {
  switch (terms) {
    case Terms::hover:
      return HoverTerms::observe(s, action_before, c, to);
    case Terms::track:
      return TrackTerms::observe(s, action_before, c, to);
    case Terms::race:
      return RaceTerms::observe(s, action_before, c, to);
  }
}

constexpr std::size_t kMostObserved = 80;  // numbers of an observation, at most

// Calls f(lane, tape, state, last action, observation) for each vector of lanes.
template <class Function>
void for_each_observation(Terms terms, const GradientStep& step, TapeMemory<float>& memory, const Function& f) {
  Tape<F> tape(memory);
  R observation[kMostObserved];
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    tape.clear();
    Flown<R> s = input_of(step.start.flown, lane, tape);
    R action_before[kActions];
    for (std::size_t i = 0; i < kActions; ++i) action_before[i] = R::input(load(step.action_before[i], lane), tape);
    observe_terms(terms, s, action_before, {step.constants, lane}, observation);
    f(lane, tape, s, action_before, observation);
  }
}

void observation_back(Terms terms, const GradientStep& step, std::span<const Lane> d_observation, TapeMemory<float>& memory,
                      FlownLanes& d_flown, Lanes<4>& d_action_before) {
  for_each_observation(
      terms, step, memory, [&](std::size_t lane, Tape<F>& tape, Flown<R>& s, const R* before, const R* observation) HWY_ATTR {
        tape.begin();
        for (std::size_t i = 0; i < d_observation.size(); ++i) {
          tape.add_derivative(observation[i].id, load(d_observation[i], lane));
        }
        tape.flow_back();
        for_each_number(s, [&](R& number, std::size_t i)
                               HWY_ATTR { store(load(d_flown[i], lane) + tape.derivative(number.id), d_flown[i], lane); });
        for (std::size_t i = 0; i < kActions; ++i) {
          store(load(d_action_before[i], lane) + tape.derivative(before[i].id), d_action_before[i], lane);
        }
      });
}

void observation_of(Terms terms, const GradientStep& step, TapeMemory<float>& memory, std::span<Lane> out) {
  for_each_observation(terms, step, memory, [&](std::size_t lane, Tape<F>&, Flown<R>&, const R*, const R* observation) HWY_ATTR {
    for (std::size_t i = 0; i < out.size(); ++i) store(observation[i].value, out[i], lane);
  });
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {

HWY_EXPORT(step_back);
HWY_EXPORT(observation_back);
HWY_EXPORT(observation_of);

double pull_back_step(Terms terms, const dynamics::StepGradient& gradient, Control control, const GroupNumbers& numbers,
                      const GradientStep& step, TapeMemory<float>& memory, dynamics::FlownLanes& d_flown,
                      dynamics::Lanes<4>& d_action, dynamics::Lanes<4>& d_action_before, TickCommands* late) {
  return HWY_DYNAMIC_DISPATCH(step_back)(terms, gradient, control, numbers, step, memory, d_flown, d_action, d_action_before,
                                         late);
}
void pull_back_observation(Terms terms, const GradientStep& step, std::span<const dynamics::Lane> d_observation,
                           TapeMemory<float>& memory, dynamics::FlownLanes& d_flown, dynamics::Lanes<4>& d_action_before) {
  HWY_DYNAMIC_DISPATCH(observation_back)(terms, step, d_observation, memory, d_flown, d_action_before);
}
void observe(Terms terms, const GradientStep& step, TapeMemory<float>& memory, std::span<dynamics::Lane> observation) {
  HWY_DYNAMIC_DISPATCH(observation_of)(terms, step, memory, observation);
}

}  // namespace flockstep::task
#endif
