// ShownParameters: some of the floats of DroneParameters as numbers of an observation: their differences from the defaults.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "flockstep/buffer.hpp"
#include "flockstep/drones/variation.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

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
