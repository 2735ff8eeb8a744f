// PoseSensorConfig: the pose sensor, which measures position and orientation, or estimates them as an odometry does.
#pragma once

#include <optional>

#include "flockstep/dynamics.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// The exact pose, with optional Gaussian noise, drift and velocity. Drifts are 0 when an episode begins.
struct PoseSensorConfig {
  static constexpr const char* kAbout = "Exact pose, with optional noise and drift.";

  float position_noise_std_m = 0.0F;
  float orientation_noise_std_deg = 0.0F;
  std::optional<float> velocity_noise_std_mps;
  float position_random_walk = 0.0F;
  float yaw_random_walk = 0.0F;
  float drift_std_m = 0.0F;
  float drift_time_s = 30.0F;
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
        field("velocity_noise_std_mps", &C::velocity_noise_std_mps,
              {.about = "The same of the velocity. None: tasks observe the exact one. Needs ``motion=\"rotors\"``.",
               .unit = "m/s",
               .limits = between(0, 1000)}),
        field("position_random_walk", &C::position_random_walk,
              {.about = "Random walk of the position along each axis: standard deviation after 1 s.",
               .unit = "m/sqrt(s)",
               .limits = between(0, 1000)}),
        field("yaw_random_walk", &C::yaw_random_walk,
              {.about = "The same of the yaw, which turns orientation and velocity.",
               .unit = "deg/sqrt(s)",
               .limits = between(0, 1000)}),
        field("drift_std_m", &C::drift_std_m,
              {.about = "Further drift of the position from 0, which approaches this deviation (Gauss-Markov).",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("drift_time_s", &C::drift_time_s, kDriftTime), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API void check_motion(const DynamicsConfig& dynamics) const;  // refuses a velocity of kinematic motion
};

}  // namespace flockstep
