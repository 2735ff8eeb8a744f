// Sensor: an instrument that every drone of a batch carries. A reading goes one way: measure, errors, delay, publish.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/config.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "sensors/rate.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

class Sensor {
 public:
  // kind: its name in messages and snapshots, such as "lidar"; name: unique among the sensors of that kind.
  Sensor(std::string kind, std::string name, const std::optional<float>& rate_hz, const ClockConfig& clock)
      : name_(std::move(name)), label_(kind + '.' + name_), period_(period_in_ticks(rate_hz, clock, kind + ".rate_hz")) {}
  virtual ~Sensor() = default;
  Sensor(const Sensor&) = delete;
  Sensor& operator=(const Sensor&) = delete;

  const std::string& name() const { return name_; }
  std::int64_t period() const { return period_; }  // ticks from one reading to the next; 0: one after every flown step

  // An episode of the drone begins, and it has not been read yet.
  virtual void begin(DroneIndex drone, const State& state) {
    static_cast<void>(drone);
    static_cast<void>(state);
  }
  // The drone is removed: its readings are absent.
  virtual void clear(DroneIndex drone) { static_cast<void>(drone); }

  // The published arrays.
  virtual void list_arrays(const std::function<void(const ArrayView&)>& list) const = 0;

  // --- snapshots: everything that the next reading depends on. Arrays are written, then restored() is called, then check().
  virtual void visit(ArrayVisitor& visitor) = 0;
  virtual void restored() {}
  virtual void check() const = 0;  // throws std::invalid_argument at values that no reading leaves
  // The name of the array of run-time settings; unique in a batch.
  const std::string& label() const { return label_; }
  // Throws std::invalid_argument if that array cannot be restored from these bytes.
  virtual void check_bytes(std::span<const std::byte> settings) const { static_cast<void>(settings); }

 private:
  std::string name_;
  std::string label_;
  std::int64_t period_;
};

// The batch that a sensor is made for.
struct SensorSetup {
  const ClockConfig& clock;
  TracerKind tracer = TracerKind::automatic;
  std::size_t drones_per_env = 1;
  std::size_t num_drones = 0;
  std::uint32_t number = 0;  // among the sensors of its kind on a drone
};

// The drones and worlds that sensors measure, and the working memory of a thread.
struct Surroundings {
  const State& state;
  std::span<const trace::Scene* const> scenes;  // by slot
  std::span<const std::int32_t> slots;          // (E,) the slot of each env's world
  std::size_t drones_per_env;
  trace::Tracer& tracer;

  const trace::Scene& scene_of(DroneIndex drone) const {
    const std::size_t env = drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
    return *scenes[static_cast<std::size_t>(slots[env])];
  }
};

// A sensor that is read block by block, on the threads of the step. Cameras are not: their frames are rendered for all blocks.
class BlockSensor : public Sensor {
 public:
  using Sensor::Sensor;

  // Reads the listed drones. Other threads may read other drones at the same time.
  void read(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
    measure(drones, surroundings);
    add_errors(drones, surroundings.state);
    // No sensor has a delay: readings are published at once.
  }

 private:
  // Writes the truth.
  virtual void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) = 0;
  // Writes the published readings, from the truth. A sensor without errors publishes the truth itself.
  virtual void add_errors(std::span<const DroneIndex> drones, const State& state) {
    static_cast<void>(drones);
    static_cast<void>(state);
  }
};

// The readings of a sensor: the truth and the published arrays. Without errors they are the same memory.
template <HasFields Arrays>
class Readings {
 public:
  void allocate(const ArraySizes& sizes, bool has_errors) {
    flockstep::allocate(truth_, sizes);
    if (has_errors) flockstep::allocate(published_.emplace(), sizes);
  }

  Arrays& truth() { return truth_; }
  const Arrays& truth() const { return truth_; }
  Arrays& published() { return published_ ? *published_ : truth_; }
  const Arrays& published() const { return published_ ? *published_ : truth_; }

  void visit(ArrayVisitor& visitor) {
    visitor.fields(published());
    if (published_) visitor.fields(truth_);
  }
  void check() const {
    check_arrays(published());
    check_arrays(truth());
  }

 private:
  Arrays truth_;
  std::optional<Arrays> published_;
};

}  // namespace flockstep::sensors
