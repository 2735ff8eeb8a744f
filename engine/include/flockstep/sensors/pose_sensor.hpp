// PoseSensorConfig: the pose sensor, which measures position and orientation.
#pragma once

#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// The exact pose, with optional Gaussian noise.
struct PoseSensorConfig {
  float position_noise_std_m = 0.0F;
  float orientation_noise_std_deg = 0.0F;
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = PoseSensorConfig;
    return field_list(
        field("position_noise_std_m", &C::position_noise_std_m,
              {.about = "Standard deviation of the position along each axis.", .unit = "m", .limits = at_least(0)}),
        field("orientation_noise_std_deg", &C::orientation_noise_std_deg,
              {.about = "Standard deviation of each component of the rotation vector.", .unit = "deg", .limits = at_least(0)}),
        field("rate_hz", &C::rate_hz, kSensorRate), field("latency_s", &C::latency_s, kSensorLatency),
        field("jitter_s", &C::jitter_s, kSensorJitter), field("loss", &C::loss, kSensorLoss));
  }

  FLOCKSTEP_API void validate() const;
  bool is_exact() const {
    return position_noise_std_m == 0.0F && orientation_noise_std_deg == 0.0F;
  }  // true if there is no noise
};

}  // namespace flockstep
