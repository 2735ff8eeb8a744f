#include "dynamics/step_gradient.hpp"

#include <algorithm>
#include <iterator>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics/step_gradient.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/step_gradient-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

void pull_back_lanes(const StepGradient& gradient, Control command_of, const StepStart& start, const LaneNumbers& numbers,
                     const Lanes<4>& command, TapeMemory<float>& memory, FlownLanes& d_flown, Lanes<4>& d_command) {
  Tape<F> tape(memory);
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    tape.clear();
    Flown<R> before = input_of(start.flown, lane, tape);
    R given[4], set[7];
    for (std::size_t i = 0; i < 4; ++i) given[i] = R::input(load(command[i], lane), tape);
    for (R& number : set) number = R(0.0F);
    set_from_command(command_of, gradient.physics, numbers, At{lane}, given, set);
    // Speeds beyond a rotor's range are cut off; rounding of a thrust at its end does not take it out of the range.
    constexpr float kBeyond = 1e-5F;
    for (std::size_t i = 0; gradient.physics.stage == Stage::rotors && i < kRotors; ++i) {
      const F least = load(numbers.min_speed, lane) * (1.0F - kBeyond), most = load(numbers.max_speed, lane) * (1.0F + kBeyond);
      set[i] = max(min(set[i], most), least);
    }
    Flown<R> after = flown_after(gradient, start, numbers, lane, set, 0, before);
    tape.begin();
    for_each_number(after, [&](R& number, std::size_t i) HWY_ATTR { tape.add_derivative(number.id, load(d_flown[i], lane)); });
    tape.flow_back();
    for_each_number(before, [&](R& number, std::size_t i) HWY_ATTR { store(tape.derivative(number.id), d_flown[i], lane); });
    for (std::size_t i = 0; i < 4; ++i) store(tape.derivative(given[i].id), d_command[i], lane);
  }
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include "base/require.hpp"

namespace flockstep::dynamics {

HWY_EXPORT(pull_back_lanes);

void pull_back(const StepGradient& gradient, Control control, const StepStart& start, const LaneNumbers& numbers,
               const Lanes<4>& command, TapeMemory<float>& memory, FlownLanes& d_flown, Lanes<4>& d_command) {
  HWY_DYNAMIC_DISPATCH(pull_back_lanes)(gradient, control, start, numbers, command, memory, d_flown, d_command);
}

void StepGradient::require_derivatives(const Fleet& fleet) {
  const Control control = fleet.config.control;
  require(control == Control::rotor_speeds || control == Control::rotor_thrusts || control == Control::body_rates ||
              control == Control::velocity || control == Control::heading_velocity,
          "control", "rotor_speeds, rotor_thrusts, body_rates, velocity or heading_velocity, which have derivatives",
          EnumNames<Control>::kNames[static_cast<std::size_t>(control)]);
  require(fleet.num_rotors() == kRotors, "drone", "quadrotors, whose flight has derivatives",
          "one with " + std::to_string(fleet.num_rotors()) + " rotors");
}

StepGradient::StepGradient(const Fleet& fleet, int ticks_of_step)
    : ticks(ticks_of_step), fleet_(fleet), dt_s_(fleet.clock.step_s() / ticks_of_step) {
  require_derivatives(fleet);
  physics = Physics(fleet.airframes[0], fleet.config, dt_s_, 1);
  physics.include(fleet.physics);  // all airframes' terms, which do not depend on the length of a tick
  physics.is_rk4 = physics.ground_effect = false;
  physics.downwash = fleet.physics.downwash;
  physics.drains = fleet.physics.drains;
  physics.pushed = fleet.physics.pushed;
}

void StepGradient::read(const State& state, const LaneDrones& drones, FlownLanes& flown) {
  for_each_flown(state, [&](const std::vector<float>& array, std::size_t first, std::size_t columns) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float* const row = array.data() + columns * drones[lane];
      for (std::size_t k = 0; k < columns; ++k) flown[first + k][lane] = row[k];
    }
  });
}

void StepGradient::read(const State& state, const LaneDrones& drones, StepStart& start) const {
  read(state, drones, start.flown);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const DroneIndex drone = drones[lane];
    for (std::size_t k = 0; k < 3; ++k) start.wind[k][lane] = state.flight.wind[3 * drone + k];
    for (std::size_t i = 0; physics.downwash && i < kRotors; ++i) {
      start.thrust_share[i][lane] = fleet_.thrust_share[kRotors * drone + i];
    }
    if (physics.drains) {
      const auto shares = fleet_.speed_share(state, drone, state.tick[fleet_.env_of(drone)]);
      for (std::size_t i = 0; i < kRotors; ++i) start.speed_share[i][lane] = shares[i];
    }
    if (physics.pushed) {
      const DroneParameters parameters = Fleet::parameters_of(state, drone);
      for (std::size_t k = 0; k < 3; ++k) {
        start.push[k][lane] = parameters.push_mps2[k];
        start.twist[k][lane] = parameters.twist_radps2[k];
      }
    }
  }
}

void StepGradient::read_numbers(const State& state, const LaneDrones& drones, LaneNumbers& numbers) const {
  std::array<AirframeNumbers<float>, kLanes> own;
  std::array<const AirframeNumbers<float>*, kLanes> rows{};
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    rows[lane] = &own[lane];
    if (lane > 0 && (drones[lane] == drones[lane - 1] || !fleet_.has_parameters())) {
      if (fleet_.airframe_row(drones[lane]) == fleet_.airframe_row(drones[lane - 1])) {
        rows[lane] = rows[lane - 1];
        continue;
      }
    }
    const Airframe& frame = fleet_.airframe_of(drones[lane]);
    own[lane] = numbers_of(frame, fleet_.config, dt_s_, dt_s_);
    if (!fleet_.has_parameters()) continue;
    const DroneParameters parameters = Fleet::parameters_of(state, drones[lane]);
    own[lane] =
        numbers_of(frame, varied(frame, parameters), AirframeNumbers<float>(own[lane]), parameters, fleet_.config, dt_s_, dt_s_);
  }
  set_lanes(rows, numbers);
}

}  // namespace flockstep::dynamics
#endif
