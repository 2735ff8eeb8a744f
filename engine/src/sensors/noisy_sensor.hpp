// NoisySensor: a sensor whose readings have noise, and errors that last from reading to reading, such as biases.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/random.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

// How an error changes with the time: white noise drives it, and with a correlation time it returns to 0.
struct Drift {
  float density = 0.0F;    // of the noise, in units of the error per second and square root of Hz
  float time_s = 0.0F;     // correlation time; 0: a random walk, or a constant without noise
  float start_std = 0.0F;  // standard deviation when an episode begins

  // An error that approaches a standard deviation, a Gauss-Markov process. It has it at any time if it starts with it.
  static Drift gauss_markov(float deviation, float time_s, float start_std = 0.0F) {
    return {deviation * std::sqrt(2.0F / time_s), time_s, start_std};
  }
  bool is_none() const { return density == 0.0F && start_std == 0.0F; }
};

inline bool are_none(std::span<const Drift> drifts) { return std::ranges::all_of(drifts, &Drift::is_none); }

// The errors of all drones that drift, as many for each drone as there are Drifts. All are 0 if no Drift changes them.
class Drifts {
 public:
  // label: of the sensor. period: ticks between its readings; 0 means one after each step.
  Drifts(std::span<const Drift> drifts, const std::string& label, std::int64_t period, const SensorSetup& setup)
      : stream_(stream_named("start of " + label)),
        clock_(setup.clock),
        drones_per_env_(setup.drones_per_env),
        interval_(period == 0 ? clock_.substeps() : period),
        are_none_(sensors::are_none(drifts)) {
    const double interval_s = period == 0 ? clock_.step_s() : static_cast<double>(period) * clock_.dt_s();
    for (const Drift& drift : drifts) members_.push_back({drift, change_over(drift, interval_s)});
    const bool has_starts = std::ranges::any_of(drifts, [](const Drift& drift) { return drift.start_std > 0.0F; });
    values_.resize(drifts.size() * (are_none_ ? 1 : setup.num_drones));
    tick_.resize(are_none_ ? 0 : setup.num_drones);
    started_.resize(has_starts ? setup.num_drones : 0);
  }

  bool are_none() const { return are_none_; }

  // The errors of the drone begin at the current tick of its env.
  void begin(DroneIndex drone, const State& state) {
    if (are_none_) return;
    std::fill_n(values_.data() + size() * drone, size(), 0.0F);
    tick_[drone] = state.tick[RandomKey::of(drone, drones_per_env_).env];
    if (!started_.empty()) started_[drone] = 0;
  }

  // Advances the errors of a drone to the current tick of its env, and returns them. numbers: standard normal, one for each error
  // that does not stay constant; those come first. A second call in the same tick changes nothing.
  const float* advance(const State& state, DroneIndex drone, std::span<const float> numbers) {
    if (are_none_) return values_.data();
    float* const values = values_.data() + size() * drone;
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    if (!started_.empty() && std::exchange(started_[drone], std::uint8_t{1}) == 0) start(state, key, values);
    const std::int64_t elapsed = state.tick[key.env] - std::exchange(tick_[drone], state.tick[key.env]);
    if (elapsed <= 0) return values;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const auto& [drift, regular] = members_[i];
      const Change change = elapsed == interval_ ? regular : change_over(drift, static_cast<double>(elapsed) * clock_.dt_s());
      values[i] = change.keep * values[i] + change.gain * numbers[i];
    }
    return values;
  }

  void visit(ArrayVisitor& visitor) {
    if (are_none_) return;
    visitor.array("drift", values_);
    visitor.array("drift_tick", tick_);
    visitor.array("drift_started", started_);
  }
  // Throws std::invalid_argument if restored numbers cannot be used.
  void check() const {
    check_values(values_, "drift", Values::finite);
    check_values(tick_, "drift_tick", Values::count);
    check_values(started_, "drift_started", Values::flag);
  }

 private:
  // In some time an error is multiplied by `keep`, then noise of standard deviation `gain` is added.
  struct Change {
    float keep = 1.0F;
    float gain = 0.0F;
  };
  struct Member {
    Drift drift;
    Change per_interval;  // between two regular readings
  };

  // In d seconds, noise of density w adds the standard deviation w sqrt(d). With a correlation time T it is
  // w sqrt(T/2 (1 - e^(-2d/T))).
  static Change change_over(const Drift& drift, double d) {
    const auto t = static_cast<double>(drift.time_s);
    const double gain = t > 0.0 ? std::sqrt(0.5 * t * -std::expm1(-2.0 * d / t)) : std::sqrt(d);
    return {t > 0.0 ? static_cast<float>(std::exp(-d / t)) : 1.0F, static_cast<float>(static_cast<double>(drift.density) * gain)};
  }

  void start(const State& state, const RandomKey& key, float* values) const {
    for (std::size_t i = 0; i < size(); ++i) {
      values[i] = members_[i].drift.start_std * normal_pair(draw(state, key, stream_, static_cast<std::uint32_t>(i)))[0];
    }
  }

  std::size_t size() const { return members_.size(); }  // errors of a drone

  Stream stream_;  // of the errors with which episodes begin
  ClockConfig clock_;
  std::size_t drones_per_env_;
  std::int64_t interval_;  // ticks between regular readings
  bool are_none_;
  std::vector<Member> members_;
  std::vector<float> values_;       // (N, size); one row of zeros if they do not change
  std::vector<std::int64_t> tick_;  // (N,) tick of the episode to which they were advanced
  FlagArray started_;               // (N,) 1 if they have begun; empty if all begin at 0
};

// A sensor with noise in its readings and with errors that drift. Both are functions of the env's seed and episode, the drone's
// number in the env, the sensor and the number of the reading.
template <HasFields Arrays>
class NoisySensor : public SensorOf<Arrays> {
 public:
  // stream: of its noise. has_noise: its readings differ from the truth even if no error drifts.
  template <class Config>
  NoisySensor(const std::string& kind, const std::string& name, const Config& config, const SensorSetup& setup, Stream stream,
              const Arrays& cleared, bool has_noise, std::span<const Drift> drifts)
      : SensorOf<Arrays>(kind, name, config, setup, cleared, has_noise || !are_none(drifts)),
        has_errors_(has_noise || !are_none(drifts)),
        stream_(stream),
        number_(setup.number),
        drifts_(drifts, this->label(), this->period(), setup) {}

  void begin(DroneIndex drone, const State& state) override {
    SensorOf<Arrays>::begin(drone, state);
    drifts_.begin(drone, state);
  }
  void visit(ArrayVisitor& visitor) override {
    SensorOf<Arrays>::visit(visitor);
    drifts_.visit(visitor);
  }
  void check() const override {
    SensorOf<Arrays>::check();
    drifts_.check();
  }

 protected:
  // Returns the standard normal numbers of a drone's reading, an even count.
  template <std::size_t kCount>
  std::array<float, kCount> normals(const State& state, DroneIndex drone) const {
    static_assert(kCount % 2 == 0);
    constexpr std::uint32_t kDraws = kCount / 2;
    const RandomKey key = RandomKey::of(drone, this->drones_per_env_);
    const std::uint32_t index = kDraws * this->reading_of(state, key.env);
    std::array<float, kCount> numbers;
    for (std::uint32_t k = 0; k < kDraws; ++k) {
      const auto [first, second] = normal_pair(draw(state, key, stream_, index + k, number_));
      numbers[2 * k] = first;
      numbers[2 * k + 1] = second;
    }
    return numbers;
  }

  bool has_errors_;
  Stream stream_;
  std::uint32_t number_;  // number among the drone's sensors of its kind; each has its own noise
  Drifts drifts_;
};

}  // namespace flockstep::sensors
