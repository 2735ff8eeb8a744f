// PoseSensorConfig: the pose sensor, which tells position and orientation.
#pragma once

#include <optional>

#include "flockstep/fields.hpp"

namespace flockstep {

// The exact pose, with optional Gaussian noise.
struct PoseSensorConfig {
  float position_noise_std_m = 0.0F;       // per axis, >= 0
  float orientation_noise_std_deg = 0.0F;  // of each component of the rotation vector, >= 0
  std::optional<float> rate_hz;            // readings per second of simulated time; none: one after every step

  static constexpr auto fields() {
    using C = PoseSensorConfig;
    return field_list(field("position_noise_std_m", &C::position_noise_std_m),
                      field("orientation_noise_std_deg", &C::orientation_noise_std_deg), field("rate_hz", &C::rate_hz));
  }

  void validate() const;
  bool is_exact() const { return position_noise_std_m == 0.0F && orientation_noise_std_deg == 0.0F; }
};

}  // namespace flockstep
