// The derivatives of a flown step: those of the recorded equations in double precision agree with differences, and pull_back()
// agrees with those.
#include "dynamics/step_gradient.hpp"

#include "dynamics/step_gradient-inl.hpp"
#include "flight_state.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {
namespace {
using namespace flockstep::testing;

using Doubles = Wide<hn::CappedTag<double, 8>>;
using Taped = Recorded<Doubles>;

struct AtDouble {
  std::size_t lane;
  HWY_INLINE Doubles operator()(const Lane& number) const {
    return convert<Doubles>(Wide<hn::Rebind<float, Doubles::Tag>>::load(number.data() + lane));
  }
};

constexpr std::size_t kGiven = kFlown + 4;  // state and command
template <std::size_t kCount>
using Rows = std::array<Doubles, kCount>;

// Numbers that change a step about as much, by kind.
constexpr std::array<double, kFlown> kUnits{1, 1,   1,   1,   1,  1,  0.01, 0.01, 0.01, 0.01, 1,  1,
                                            1, 0.1, 0.1, 0.1, 50, 50, 50,   50,   50,   50,   50, 50};

struct Flight {
  const StepGradient& gradient;
  Control control;
  StepStart start{};
  LaneNumbers numbers;
  alignas(64) Lanes<4> command{};

  // The state after a step from a state and a command.
  template <class T>
  void fly(std::size_t lane, const T* given, T* after) const {
    const AtDouble at{lane};
    Flown<T> s;
    for_each_number(s, [&](T& number, std::size_t i) HWY_ATTR { number = given[i]; });
    T set[7];
    for (T& number : set) number = T(0.0);
    set_from_command(control, gradient.physics, numbers, at, given + kFlown, set);
    const Inputs<T> in{
        {at(start.wind[0]), at(start.wind[1]), at(start.wind[2])}, T(0.0), start.thrust_share, start.push, start.twist};
    fly_ticks(gradient.physics, gradient.ticks, numbers, at, set, 0, in, start.speed_share, s);
    for_each_number(s, [&](T& number, std::size_t i) HWY_ATTR { after[i] = number; });
  }

  Rows<kGiven> given(std::size_t lane) const {
    Rows<kGiven> x;
    for (std::size_t i = 0; i < kGiven; ++i) x[i] = AtDouble{lane}(i < kFlown ? start.flown[i] : command[i - kFlown]);
    return x;
  }

  Rows<kGiven> pull_back(std::size_t lane, const Rows<kFlown>& weights, TapeMemory<double>& memory) const {
    Tape<Doubles> tape(memory);
    tape.clear();
    const Rows<kGiven> x = given(lane);
    Taped inputs[kGiven], after[kFlown];
    for (std::size_t i = 0; i < kGiven; ++i) inputs[i] = Taped::input(x[i], tape);
    fly(lane, inputs, after);
    tape.begin();
    for (std::size_t i = 0; i < kFlown; ++i) tape.add_derivative(after[i].id, weights[i]);
    tape.flow_back();
    Rows<kGiven> result;
    for (std::size_t i = 0; i < kGiven; ++i) result[i] = tape.derivative(inputs[i].id);
    return result;
  }

  // The derivative of the weighted state along a direction, by central differences of two distances (Richardson).
  Doubles difference(std::size_t lane, const Rows<kFlown>& weights, const Rows<kGiven>& along, double distance) const {
    const Rows<kGiven> x = given(lane);
    const auto slope = [&](double h) HWY_ATTR {
      Doubles sum(0.0);
      Rows<kFlown> ahead, behind;
      Rows<kGiven> to;
      for (std::size_t i = 0; i < kGiven; ++i) to[i] = x[i] + along[i] * h;
      fly(lane, to.data(), ahead.data());
      for (std::size_t i = 0; i < kGiven; ++i) to[i] = x[i] - along[i] * h;
      fly(lane, to.data(), behind.data());
      for (std::size_t i = 0; i < kFlown; ++i) sum = sum + weights[i] * (ahead[i] - behind[i]);
      return sum / (2.0 * h);
    };
    return (4.0 * slope(0.5 * distance) - slope(distance)) / 3.0;
  }
};

template <std::size_t kCount, class Unit>
Rows<kCount> random_rows(Random& random, const Unit& unit) {
  Rows<kCount> rows;
  for (std::size_t i = 0; i < kCount; ++i) {
    alignas(64) double lanes[Doubles::kCount];
    for (double& number : lanes) {
      const float drawn = random.within(-1.0F, 1.0F);
      number = random.within(0.0F, 1.0F) < 0.5F ? unit(i) * static_cast<double>(drawn) : 0.0;
    }
    rows[i] = Doubles::load(lanes);
  }
  return rows;
}

std::vector<Variation> all_that_differs() {
  std::vector<Variation> list;
  const auto add = [&](const char* name, float low, float high) {
    list.push_back({.parameter = name, .low = low, .high = high});
  };
  for (const char* name : {"mass_scale", "stretch", "arm_scale", "thrust_scale", "rotor_thrust_scale", "torque_scale",
                           "lag_up_scale", "lag_down_scale", "body_drag_scale", "rotor_drag_scale", "rate_gain_scale",
                           "attitude_gain_scale", "velocity_gain_scale"}) {
    add(name, 0.9F, 1.1F);
  }
  add("center_m", -0.01F, 0.01F);
  add("payload_kg", 0.0F, 0.002F);
  add("payload_below_m", 0.0F, 0.1F);
  for (const char* name : {"battery_used", "battery_fall", "battery_sag"}) add(name, 0.0F, 0.3F);
  for (const char* name : {"push_mps2", "twist_radps2", "wind_mps"}) add(name, -2.0F, 2.0F);
  return list;
}

// Counts of states whose derivatives were compared, that are near a kink, and whose derivatives in float32 are on its other side.
struct Compared {
  long states = 0, kinks = 0, other_sides = 0;
};

class Comparison {
 public:
  Comparison(std::span<const Airframe> airframes, const DynamicsConfig& config, bool differ)
      : airframes_(airframes.begin(), airframes.end()), control_(config.control), state_(flight_state(kLanes, 1)) {
    std::vector<std::int32_t> rows;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      rows.push_back(static_cast<std::int32_t>(lane % airframes_.size()));
      drones_[lane] = DroneIndex(lane);
    }
    state_.parameters.params.resize(kNumParameters * kLanes);
    state_.parameters.battery.resize(kLanes);
    const std::vector<Variation> variations = differ ? all_that_differs() : std::vector<Variation>();
    const ClockConfig clock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 500.0F};
    fleet_ = std::make_unique<Fleet>(airframes_, rows, config, clock, 1, Variations(variations, airframes_, clock));
    std::ranges::fill(fleet_->thrust_share, 0.9F);
    for (const DroneIndex drone : drones_) fleet_->begin_parameters(state_, drone);
  }

  void run(Random& random, int ticks, long rounds, Compared& counts) {
    const StepGradient gradient(*fleet_, ticks);
    Flight flight{.gradient = gradient, .control = control_};
    gradient.read_numbers(state_, drones_, flight.numbers);
    for (long round = 0; round < rounds; ++round) {
      draw(random);
      gradient.read(state_, drones_, flight.start);
      std::vector<Airframe> frames;
      for (const DroneIndex drone : drones_) frames.push_back(fleet_->airframe_of(drone));
      const std::vector<float> command = flight_commands(random, control_, frames);
      for (std::size_t i = 0; i < command.size(); ++i) flight.command[i % 4][i / 4] = command[i];
      compare(random, flight, counts);
    }
  }

 private:
  void draw(Random& random) {
    const auto put = [](std::vector<float>& array, std::size_t row, std::initializer_list<float> values) {
      std::ranges::copy(values, array.begin() + static_cast<std::ptrdiff_t>(values.size() * row));
    };
    const auto put3 = [&](std::vector<float>& array, std::size_t row, const Vec3& v) { put(array, row, {v.x(), v.y(), v.z()}); };
    FlightState& f = state_.flight;
    for (std::size_t row = 0; row < kLanes; ++row) {
      const Airframe& frame = fleet_->airframe_of(drones_[row]);
      put3(state_.position, row, random.point(2.0F));
      const Quat q = random.rotation();
      const float length = row % 4 == 0 ? 1.01F : 1.0F;
      put(state_.quat_wxyz, row, {q.w() * length, q.x() * length, q.y() * length, q.z() * length});
      put3(f.velocity, row, random.point(4.0F));
      put3(f.angular_velocity, row, random.point(5.0F));
      put3(f.error_integral, row, random.point(0.3F));
      put3(f.wind, row, random.point(2.0F));
      for (auto* const speeds : {&f.rotor_speed, &f.rotor_command}) {
        for (std::size_t i = 0; i < kRotors; ++i) {
          (*speeds)[kRotors * row + i] =
              random.within(static_cast<float>(frame.min_speed_radps), static_cast<float>(frame.max_speed_radps));
        }
      }
    }
  }

  void compare(Random& random, const Flight& flight, Compared& counts) {
    const auto command_unit = [&](std::size_t i) {
      return control_ == Control::rotor_speeds ? 50.0 : control_ == Control::rotor_thrusts ? 0.1 : i == 0 ? 0.5 : 0.2;
    };
    const auto unit = [&](std::size_t i) { return i < kFlown ? kUnits[i] : command_unit(i - kFlown); };
    alignas(64) FlownLanes d_flown{};
    alignas(64) Lanes<4> d_command{};
    std::array<std::array<double, kLanes>, kGiven> expected;
    for (std::size_t lane = 0; lane < kLanes; lane += Doubles::kCount) {
      const Rows<kFlown> weights = random_rows<kFlown>(random, [](std::size_t i) { return 1.0 / kUnits[i]; });
      const Rows<kGiven> along = random_rows<kGiven>(random, unit);
      const Rows<kGiven> found = flight.pull_back(lane, weights, memory_);
      Doubles sum(0.0), size(1.0);
      for (std::size_t i = 0; i < kGiven; ++i) {
        sum = sum + found[i] * along[i];
        size = size + abs(found[i]) * Doubles(unit(i));
      }
      constexpr double kDistance = 2e-3;
      const Doubles far = flight.difference(lane, weights, along, kDistance);
      const Doubles near = flight.difference(lane, weights, along, 0.5 * kDistance);
      // For a rotor at rest, rounding decides the root of its thrust: differences are then too rough at a small distance.
      const Doubles rough = flight.difference(lane, weights, along, 0.01 * kDistance);
      const auto is_smooth = (abs(far - near) < 3e-9 * size) & (abs(rough - near) < 3e-8 * size);
      const auto agrees = abs(sum - near) < 1e-8 * size;
      for (std::size_t i = 0; i < Doubles::kCount; ++i) {
        ++counts.states;
        if ((bits(is_smooth) >> i & 1U) == 0) {
          ++counts.kinks;
        } else {
          EXPECT_TRUE(bits(agrees) >> i & 1U) << "lane " << lane + i;
        }
      }
      alignas(64) double numbers[Doubles::kCount];
      for (std::size_t i = 0; i < kFlown; ++i) {
        weights[i].store(numbers);
        for (std::size_t k = 0; k < Doubles::kCount; ++k) d_flown[i][lane + k] = static_cast<float>(numbers[k]);
      }
      for (std::size_t i = 0; i < kGiven; ++i) {
        found[i].store(numbers);
        for (std::size_t k = 0; k < Doubles::kCount; ++k) expected[i][lane + k] = unit(i) * numbers[k];
      }
    }
    dynamics::pull_back(flight.gradient, control_, flight.start, flight.numbers, flight.command, memory32_, d_flown, d_command);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      double size = 1.0, error = 0.0;
      for (std::size_t i = 0; i < kGiven; ++i) {
        const float found = i < kFlown ? d_flown[i][lane] : d_command[i - kFlown][lane];
        size = std::max(size, std::abs(expected[i][lane]));
        error = std::max(error, std::abs(unit(i) * static_cast<double>(found) - expected[i][lane]));
      }
      if (!(error < 1e-4 * size)) ++counts.other_sides;
    }
  }

  std::vector<Airframe> airframes_;
  Control control_;
  State state_;
  LaneDrones drones_;
  std::unique_ptr<Fleet> fleet_;
  TapeMemory<double> memory_;
  TapeMemory<float> memory32_;
};

TEST(StepGradient, AgreesWithDifferencesForEveryAirframeAndControl) {
  const std::vector<Airframe> all = different_airframes();
  Random random(5 + part_tried());
  long states = 0;
  int made = 0;
  for (const Control control :
       {Control::rotor_speeds, Control::rotor_thrusts, Control::body_rates, Control::velocity, Control::heading_velocity}) {
    Compared counts;
    for (std::size_t row = 0; row <= all.size(); ++row) {  // each alone, and all in one fleet
      for (const bool differ : {false, true}) {
        DynamicsConfig config{.motion = Motion::rotors, .control = control};
        config.max_speed_mps = 10.0F;
        config.downwash = differ;
        if (differ) config.controller.command_lag_s = 0.02F;
        SCOPED_TRACE(::testing::Message() << static_cast<int>(control) << ' ' << row << ' ' << differ);
        Comparison comparison(row < all.size() ? std::span(all).subspan(row, 1) : std::span(all), config, differ);
        comparison.run(random, 1 + made++ % 3, times_tried(57), counts);
      }
    }
    EXPECT_LT(counts.kinks, counts.states / 20);
    EXPECT_LT(counts.other_sides, counts.states / 200);
    states += counts.states;
  }
  EXPECT_GT(states, 100'000);
  tried("states", states);
}

}  // namespace
}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

namespace flockstep {
namespace {

using namespace testing;

TEST(StepGradient, RefusesWhatHasNoDerivative) {
  const std::vector<Airframe> frame{*DroneModel::load("crazyflie").airframe()};
  const std::vector<std::int32_t> row{0};
  const ClockConfig clock;
  DynamicsConfig config{.motion = Motion::rotors, .control = Control::position};
  EXPECT_REFUSED(dynamics::StepGradient(dynamics::Fleet(frame, row, config, clock, 1), 1), "control: ... have derivatives");
}

}  // namespace
}  // namespace flockstep
