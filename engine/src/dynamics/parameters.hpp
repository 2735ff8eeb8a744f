// Parameters of drones: the variations that draw them, the airframe that they make of a drone's own, and those that it observes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/drones/variation.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// The airframe of a drone with these parameters. Mass and inertia change as those of a body whose mass is moved: the second
// moments about its centre are stretched (pseudo-inertia), and the payload is a point below it. Thrust includes thrust_scale, but
// not rotor_thrust_scale.
Airframe varied(const Airframe& frame, const DroneParameters& parameters);
void set_varied(const Airframe& frame, const DroneParameters& parameters,
                Airframe& made);  // allocates nothing if `made` has room

// Number x with P(normal <= x) = u, 0 < u < 1, to 1e-7: M. J. Wichura, "Algorithm AS 241", Applied Statistics 37(3), 1988.
double normal_quantile(double u);

// The variations of a batch, by the floats of DroneParameters that they draw.
class Variations {
 public:
  Variations() = default;
  // Throws std::invalid_argument for an unknown parameter, one that is drawn twice, and values outside its limits. With several
  // airframes, episodes draw one unless a variation does.
  Variations(std::span<const Variation> variations, std::span<const Airframe> airframes, const ClockConfig& clock);

  bool empty() const { return entries_.empty(); }
  bool differ() const { return differ_; }  // drones differ from each other, or in time
  bool lists(std::size_t number) const;    // the float with this number in DroneParameters is one of them
  bool has_interval() const { return has_interval_; }
  // Least and greatest value that a parameter can have.
  DroneParameters least() const { return least_; }
  DroneParameters greatest() const { return greatest_; }

  // The parameters at the beginning of an episode.
  void begin(const State& state, RandomKey key, DroneParameters& parameters) const;
  // Draws those that change at this tick of the episode. Returns false if there are none.
  bool redraw(const State& state, RandomKey key, std::int64_t tick, DroneParameters& parameters) const;

 private:
  struct Entry {
    Variation variation;
    std::size_t number = 0;           // of the float in DroneParameters
    std::uint32_t key = 0, word = 0;  // of the random number, those of the first float of its group
    std::int64_t interval_ticks = 0;  // 0: not redrawn
  };

  void add(const Variation& variation, std::size_t number);
  void draw_entry(const State& state, RandomKey key, const Entry& entry, std::int64_t count, DroneParameters& parameters) const;

  std::vector<Entry> entries_;
  DroneParameters least_, greatest_;
  bool has_interval_ = false, differ_ = false;
};

// Numbers of the floats that a name stands for, such as "stretch" or "stretch[2]", without those of rotors that no drone has.
// Throws std::invalid_argument with the name of the field that holds it, unless it is a field of DroneParameters or an element of
// one.
std::vector<std::size_t> parameters_named(const std::string& name, const char* field, std::size_t num_rotors = kMaxRotors);
const Limits& limits_of_parameter(std::size_t number);

// The floats of parameters in the order of parameter_names().
inline std::span<float, kNumParameters> floats_of(DroneParameters& parameters) {
  return std::span<float, kNumParameters>(reinterpret_cast<float*>(&parameters), kNumParameters);
}
inline std::span<const float, kNumParameters> floats_of(const DroneParameters& parameters) {
  return std::span<const float, kNumParameters>(reinterpret_cast<const float*>(&parameters), kNumParameters);
}

// Throws std::invalid_argument unless each number is within the limits of its field; `name` precedes the field's name.
void check_parameters(std::span<const float> parameters, const std::string& name);

// Some of the floats of DroneParameters as numbers of an observation: their differences from the defaults.
class ShownParameters {
 public:
  // Throws std::invalid_argument if a name is unknown, or stands for a float that an earlier one stands for. num_rotors: of the
  // drones.
  explicit ShownParameters(std::span<const std::string> names, std::size_t num_rotors = kMaxRotors);

  bool empty() const { return numbers_.empty(); }
  std::size_t size() const { return numbers_.size(); }  // floats of a drone
  // A vector of the floats of some drones, one after another.
  Field field(std::size_t drones) const;
  template <class T>
  void write(const State& state, DroneIndex drone, T* to) const {
    const float* const params = state.parameters.params.data() + kNumParameters * drone;
    for (std::size_t i = 0; i < size(); ++i) {
      to[i] = static_cast<T>(static_cast<double>(params[numbers_[i]]) - defaults_[i]);
    }
  }

 private:
  std::vector<std::size_t> numbers_;  // in DroneParameters
  std::vector<double> defaults_;
};

}  // namespace flockstep::dynamics
