// Sensor: an instrument on every drone of a batch. A reading passes through these stages: measure, errors, delay, publish.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <typeinfo>
#include <utility>

#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/config.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "render/appearance.hpp"
#include "sensors/delay.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// --- rates: a sensor reads at its own rate, or after every flown step

// Returns the ticks between two readings; 0 if no rate is given. Throws std::invalid_argument if the clock cannot keep the
// rate.
inline std::int64_t period_in_ticks(const std::optional<float>& rate_hz, const ClockConfig& clock, const std::string& field) {
  if (!rate_hz) return 0;
  require_positive(*rate_hz, field);
  const double ticks = clock.ticks_hz() / static_cast<double>(*rate_hz);
  const double whole = std::round(ticks);
  require(whole >= 1.0 && whole < 1e9 && std::abs(ticks - whole) <= 1e-4 * whole, field,
          "a rate that divides the clock's " + std::to_string(clock.ticks_hz()) + " ticks per second", *rate_hz);
  return static_cast<std::int64_t>(whole);
}

// Returns whether a sensor with this period reads at this tick of an episode.
inline bool is_due(std::int64_t period, std::int64_t tick, bool step_is_over) {
  return period == 0 ? step_is_over : tick % period == 0;
}

class Sensor {
 public:
  // kind: its name in messages and snapshots, such as "lidar". name: unique among the sensors of that kind.
  Sensor(std::string kind, std::string name, const std::optional<float>& rate_hz, const ClockConfig& clock)
      : name_(std::move(name)), label_(kind + '.' + name_), period_(period_in_ticks(rate_hz, clock, kind + ".rate_hz")) {}
  virtual ~Sensor() = default;
  Sensor(const Sensor&) = delete;
  Sensor& operator=(const Sensor&) = delete;

  const std::string& name() const { return name_; }
  std::int64_t period() const { return period_; }  // ticks between two readings; 0 means one after every flown step
  // Number of the reading that an env's sensors take now, for random numbers. With its own rate, a sensor may read several times
  // between two readings of the env.
  std::uint32_t reading_of(const State& state, EnvIndex env) const {
    return static_cast<std::uint32_t>(period_ == 0 ? state.sensed[env] : state.tick[env]);
  }

  // Prepares for a new episode of the drone, before its first reading.
  virtual void begin(DroneIndex drone, const State& state) {
    static_cast<void>(drone);
    static_cast<void>(state);
  }
  // Gives a drone the settings of the configuration, without changes at run time.
  virtual void use_default_settings(DroneIndex drone) { static_cast<void>(drone); }
  // Clears the readings of a removed drone.
  virtual void clear(DroneIndex drone) { static_cast<void>(drone); }

  // Lists the published arrays.
  virtual void list_arrays(const std::function<void(const ArrayView&)>& list) const = 0;

  // --- snapshots: all data that the next reading depends on. To restore, the arrays are written, then restored() and check()
  // are called.
  virtual void visit(ArrayVisitor& visitor) = 0;
  virtual void restored() {}
  virtual void check() const = 0;  // throws std::invalid_argument at impossible values
  // Name of the array of run-time settings; unique in a batch.
  const std::string& label() const { return label_; }
  // Throws std::invalid_argument if that array cannot be restored from these bytes.
  virtual void check_bytes(std::span<const std::byte> settings) const { static_cast<void>(settings); }

 private:
  std::string name_;
  std::string label_;
  std::int64_t period_;
};

// The batch that a sensor is created for.
struct SensorSetup {
  const ClockConfig& clock;
  TracerKind tracer = TracerKind::automatic;
  std::size_t drones_per_env = 1;
  std::size_t num_drones = 0;
  bool has_velocities = false;  // the drones' motion has velocities
  std::uint32_t number = 0;     // number among the sensors of its kind on a drone
};

// The drones and worlds that sensors measure, and the working memory of one thread.
struct Surroundings {
  const State& state;
  std::span<const trace::Scene* const> scenes;  // indexed by slot
  std::span<const std::int32_t> slots;          // (E,) slot of each env's world
  std::size_t drones_per_env;
  trace::Tracer& tracer;
  trace::BallSlices& slices;       // working memory for the drones of one env
  render::VisibleBodies bodies{};  // bodies of all envs
  std::size_t bodies_per_env = 0;
  trace::Bodies drones{};  // drones of all envs, if they see each other

  std::size_t env_of(DroneIndex drone) const { return drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env; }
  const trace::Scene& scene_of(DroneIndex drone) const { return *scenes[static_cast<std::size_t>(slots[env_of(drone)])]; }
  render::VisibleBodies bodies_of(DroneIndex drone) const { return bodies.of_env(env_of(drone), bodies_per_env); }
  trace::Bodies drones_seen_by(DroneIndex drone) const { return drones.seen_by(drone, drones_per_env); }
};

// A sensor that is read block by block, on the threads of the step. Cameras are not: the frames of all blocks are rendered
// together.
class BlockSensor : public Sensor {
 public:
  using Sensor::Sensor;

  // Reads the listed drones. Other threads may read other drones at the same time.
  void read(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
    measure(drones, surroundings);
    add_errors(drones, surroundings.state);
    if (!has_age()) return;
    keep(drones, surroundings.state);
    publish(drones, surroundings.state);
  }
  // True if published readings may be older than the end of the last step. publish() brings them and their age up to date.
  virtual bool has_age() const = 0;
  virtual void publish(std::span<const DroneIndex> drones, const State& state) = 0;
  // Returns the published arrays if they are of this type, otherwise null.
  virtual const void* readings_of(const std::type_info& type) const = 0;

 private:
  // Writes the true values.
  virtual void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) = 0;
  // Keeps the new readings until they arrive. Without latency they are published already.
  virtual void keep(std::span<const DroneIndex> drones, const State& state) = 0;
  // Writes the readings, computed from the true values. The readings of a sensor without errors are the true values.
  virtual void add_errors(std::span<const DroneIndex> drones, const State& state) {
    static_cast<void>(drones);
    static_cast<void>(state);
  }
};

// Returns false for an array that the configuration's outputs name but do not choose.
template <class Config>
bool is_written(const Config& config, std::string_view array) {
  bool result = true;
  if constexpr (requires { config.outputs; }) {
    for_each_field(config.outputs, [&](const auto& output, bool is_chosen) {
      if (array == output.name) result = is_chosen;
    });
  }
  return result;
}

// Calls f(entry, values) for each array that is a chosen output.
template <HasFields Arrays, HasFields Outputs, class F>
void for_each_output(Arrays& arrays, const Outputs& outputs, const F& f) {
  for_each_listed(arrays, [&](const auto& entry, auto& values) {
    for_each_field(outputs, [&](const auto& output, bool is_chosen) {
      if (is_chosen && std::string_view(output.name) == entry.name) f(entry, values);
    });
  });
}

// Readings of a sensor: the true values, these with errors, and the published arrays. Without errors or latency they share the
// same memory.
template <HasFields Arrays>
class Readings {
 public:
  void allocate(const Arrays& cleared, bool has_errors, bool is_late) {
    truth_ = cleared;
    if (has_errors) noisy_ = cleared;
    if (is_late) published_ = cleared;
  }

  Arrays& truth() { return truth_; }
  const Arrays& truth() const { return truth_; }
  Arrays& noisy() { return noisy_ ? *noisy_ : truth_; }
  const Arrays& noisy() const { return noisy_ ? *noisy_ : truth_; }
  Arrays& published() { return published_ ? *published_ : noisy(); }
  const Arrays& published() const { return published_ ? *published_ : noisy(); }

  void visit(ArrayVisitor& visitor) {
    visitor.fields(published());
    if (noisy_ || published_) visitor.fields(truth_);
    if (noisy_ && published_) visitor.fields(*noisy_);
  }
  void check() const {
    check_arrays(published());
    check_arrays(noisy());
    check_arrays(truth());
  }

 private:
  Arrays truth_;
  std::optional<Arrays> noisy_, published_;
};

// A sensor with the published arrays of one struct. Snapshots have them; a sensor with more to save overrides visit().
template <HasFields Arrays>
class SensorOf : public BlockSensor {
 public:
  // cleared: its arrays before the first reading
  template <class Config>
  SensorOf(std::string kind, std::string name, const Config& config, const SensorSetup& setup, const Arrays& cleared,
           bool has_errors)
      : BlockSensor(std::move(kind), std::move(name), config.rate_hz, setup.clock),
        drones_per_env_(setup.drones_per_env),
        delay_(config, label(), period(), setup.clock, setup.drones_per_env, setup.num_drones) {
    readings_.allocate(cleared, has_errors, delay_.is_late());
    if (delay_.is_late()) rings_.allocate(readings_.published(), setup.num_drones, delay_.num_rows());
  }

  const Arrays& readings() const { return readings_.published(); }
  const void* readings_of(const std::type_info& type) const final { return type == typeid(Arrays) ? &readings() : nullptr; }
  void list_arrays(const std::function<void(const ArrayView&)>& list) const override { for_each_view(readings(), {}, list); }
  void begin(DroneIndex drone, const State&) override { delay_.forget(drone); }
  void clear(DroneIndex drone) override { delay_.forget(drone); }
  bool has_age() const final { return !delay_.is_none(); }
  void publish(std::span<const DroneIndex> drones, const State& state) final {
    for (const DroneIndex drone : drones) {
      const std::int64_t tick = state.tick[RandomKey::of(drone, drones_per_env_).env];
      const std::optional<std::size_t> row = delay_.arrived(drone, tick);
      if (!row) continue;
      if (delay_.is_late()) rings_.get(*row, readings_.published(), drone);
      readings_.published().age_s[drone] = delay_.age_s(*row, tick);
    }
  }
  void visit(ArrayVisitor& visitor) override {
    readings_.visit(visitor);
    visit_delay(visitor);
  }
  void check() const override {
    readings_.check();
    delay_.check();
    check_arrays(rings_.arrays());
  }

 protected:
  void visit_delay(ArrayVisitor& visitor) {
    if (delay_.is_late()) rings_.visit(visitor);
    delay_.visit(visitor);
  }

  std::size_t drones_per_env_;
  Delay delay_;
  Readings<Arrays> readings_;

 private:
  void keep(std::span<const DroneIndex> drones, const State& state) final {
    for (const DroneIndex drone : drones) {
      const std::optional<std::size_t> row = delay_.add(state, drone);
      if (row && delay_.is_late()) rings_.put(readings_.noisy(), drone, *row);
    }
  }

  Rings<Arrays> rings_;
};

}  // namespace flockstep::sensors
