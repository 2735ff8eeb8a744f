// The hover task: a drone is thrown, and has to catch itself and hold a point.
#pragma once

#include <memory>

#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

// The point to hold is the world's goal marker, or the centre of its bounds where it has none. Episodes begin near it, turned
// and moving anyhow. Actions are four numbers in [-1, 1], which the dynamics' `control` gives a meaning: 0 hovers, or does
// nothing, and 1 is the most it can tell; see FlightAction.
//
// Observed, float32 (16,), in the body frame, so that the heading does not matter: the way to the point, m (3); velocity, m/s
// (3); the world's up (3); angular velocity, 10 rad/s (3); rotor speeds, -1 slowest, 0 in hovering, 1 fastest (4).
//
// d is the distance to the point, m. An episode ends as a crash on a contact, or where d > max_distance_m; it is a success if it
// ends with d <= hold_m in each step of the last hold_s.
struct HoverConfig {
  // How it begins: drawn evenly up to these.
  float start_offset_m = 0.5F;   // from the point, along each axis, in [0, 1000]
  float start_tilt_deg = 90.0F;  // from level, in [0, 180]
  float start_speed_mps = 2.0F;  // in any direction
  float start_rate_dps = 0.0F;   // about each axis of the body
  float max_distance_m = 6.0F;   // > 0
  float hold_m = 0.05F;          // > 0
  float hold_s = 1.0F;           // > 0
  // The terms of the reward, each times its weight.
  float near_weight = 1.0F;    // exp(-2 d)
  float hold_weight = 2.0F;    // 1 / (1 + (d / 2 hold_m)^2)
  float speed_weight = 0.1F;   // -speed, m/s
  float spin_weight = 0.1F;    // -length of the angular velocity, 10 rad/s
  float change_weight = 0.0F;  // -mean square of what the action changed by; the first action changes from 0
  float crash_weight = 10.0F;  // -1 on a crash

  static constexpr auto fields() {
    using C = HoverConfig;
    return field_list(field("start_offset_m", &C::start_offset_m), field("start_tilt_deg", &C::start_tilt_deg),
                      field("start_speed_mps", &C::start_speed_mps), field("start_rate_dps", &C::start_rate_dps),
                      field("max_distance_m", &C::max_distance_m), field("hold_m", &C::hold_m), field("hold_s", &C::hold_s),
                      field("near_weight", &C::near_weight), field("hold_weight", &C::hold_weight),
                      field("speed_weight", &C::speed_weight), field("spin_weight", &C::spin_weight),
                      field("change_weight", &C::change_weight), field("crash_weight", &C::crash_weight));
  }

  void validate() const;
};

// By default in "arena/hall", a crazyflie by rotor thrusts at 50 Hz, for 6 s. Throws std::invalid_argument on a bad config.
std::unique_ptr<Task> make_hover(const HoverConfig& config);

}  // namespace flockstep
