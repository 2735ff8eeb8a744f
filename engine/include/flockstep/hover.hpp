// The hover task: a drone is thrown, and has to catch itself and hold a point.
#pragma once

#include <memory>

#include "flockstep/export.hpp"
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
  float start_offset_m = 0.5F;
  float start_tilt_deg = 90.0F;
  float start_speed_mps = 2.0F;
  float start_rate_dps = 0.0F;
  float max_distance_m = 6.0F;
  float hold_m = 0.05F;
  float hold_s = 1.0F;
  float near_weight = 1.0F;
  float hold_weight = 2.0F;
  float speed_weight = 0.1F;
  float spin_weight = 0.1F;
  float change_weight = 0.0F;
  float crash_weight = 10.0F;

  static constexpr auto fields() {
    using C = HoverConfig;
    return field_list(
        field("start_offset_m", &C::start_offset_m,
              {.about =
                   "Greatest offset of the start from the point along each axis. This and the next three are drawn uniformly up "
                   "to the value.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("start_tilt_deg", &C::start_tilt_deg,
              {.about = "Greatest tilt at the start.", .unit = "deg", .limits = between(0, 180)}),
        field("start_speed_mps", &C::start_speed_mps,
              {.about = "Greatest speed at the start, in any direction.", .unit = "m/s", .limits = between(0, 1000)}),
        field(
            "start_rate_dps", &C::start_rate_dps,
            {.about = "Greatest rate at the start, about each axis of the body.", .unit = "deg/s", .limits = between(0, 100000)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the point beyond which an episode ends as a crash.", .unit = "m", .limits = above(0)}),
        field("hold_m", &C::hold_m, {.about = "Distance within which the point is held.", .unit = "m", .limits = above(0)}),
        field("hold_s", &C::hold_s,
              {.about = "Time at the end of an episode for which the point has to be held.",
               .unit = "s",
               .limits = above_up_to(0, 1000000)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("hold_weight", &C::hold_weight, {.about = "Weight of 1 / (1 + (d / 2 hold_m)^2)."}),
        field("speed_weight", &C::speed_weight, {.about = "Weight of minus the speed, m/s."}),
        field("spin_weight", &C::spin_weight, {.about = "Weight of minus the length of the angular velocity, 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of minus the mean squared difference to the previous action, which is 0 before the first."}),
        field("crash_weight", &C::crash_weight, {.about = "Weight of -1 on a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

// By default in "arena/hall", a crazyflie by rotor thrusts at 50 Hz, for 6 s. Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_hover(const HoverConfig& config);

}  // namespace flockstep
