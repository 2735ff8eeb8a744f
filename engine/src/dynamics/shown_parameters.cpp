#include "dynamics/shown_parameters.hpp"

#include <algorithm>

#include "base/require.hpp"
#include "dynamics/parameters.hpp"

namespace flockstep::dynamics {

ShownParameters::ShownParameters(std::span<const std::string> names, std::size_t num_rotors) {
  const DroneParameters defaults;
  for (const std::string& name : names) {
    for (const std::size_t number : parameters_named(name, "privileged", num_rotors)) {
      require(std::ranges::find(numbers_, number) == numbers_.end(), "privileged", "each parameter at most once",
              '"' + parameter_names()[number] + "\" twice");
      numbers_.push_back(number);
      defaults_.push_back(static_cast<double>(floats_of(defaults)[number]));
    }
  }
}

Field ShownParameters::field(std::size_t drones) const {
  Field field{.name = "privileged", .shape = {static_cast<std::int64_t>(drones * size())}, .low = {}, .high = {}};
  for (std::size_t drone = 0; drone < drones; ++drone) {
    for (std::size_t i = 0; i < size(); ++i) {
      // Parameters are compared with limits as float32.
      const Limits& limits = limits_of_parameter(numbers_[i]);
      field.low.push_back(static_cast<double>(static_cast<float>(limits.least)) - defaults_[i]);
      field.high.push_back(static_cast<double>(static_cast<float>(limits.greatest)) - defaults_[i]);
    }
  }
  return field;
}

}  // namespace flockstep::dynamics
