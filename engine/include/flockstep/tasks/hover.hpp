// HoverConfig: a thrown drone has to recover and stay at a point.
#pragma once

#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

struct HoverConfig {
  static constexpr const char* kName = "hover";
  static constexpr const char* kAbout = "Recover a thrown drone and hold it at a point.";

  static TaskWords words() {
    return {
        .about =
            "The point is the world's goal marker, or the centre of its bounds. A world in which the drone would touch something "
            "there raises an error. Use any airframe with rotors and any ``control`` except ``\"pose\"``.",
        .start =
            "Within ``start_offset_m`` of the point along each axis, with a random heading and rotors at hover speed. Tilt about "
            "a random horizontal axis, speed in a random direction and rates about each body axis are uniform, up to "
            "``start_tilt_deg``, ``start_speed_mps`` and ``start_rate_dps``. After 64 starts that would touch something, the "
            "drone starts at the point, level.",
        .action =
            "Four numbers, clipped to [-1, 1]. By default each is the thrust of a rotor: -1 the least, 0 hovering, 1 the "
            "greatest. With another ``control``, 0 hovers or has no effect, and ±1 is the largest command. An airframe with "
            "more than four rotors has a number for each.",
        .observed =
            "All vectors are in the body frame, and nothing depends on the heading. Offset, up vector and velocity come from the "
            "pose sensor, which is exact unless you give it noise.",
        .observation =
            {
                {"3", "offset to the point, m"},
                {"3", "velocity, m/s"},
                {"3", "the world's up vector"},
                {"3", "angular velocity, in units of 10 rad/s"},
                {"4", "speed of each rotor, 4 of a quadrotor: -1 slowest, 0 hovering, 1 fastest"},
            },
        .reward =
            {
                {"near", "``near_weight`` exp(-2 d), with d the distance to the point, m"},
                {"hold", "``hold_weight`` / (1 + (d / (2 ``hold_m``))^2)"},
                {"speed", "-``speed_weight`` times the speed, m/s"},
                {"spin", "-``spin_weight`` times the magnitude of the angular velocity, in units of 10 rad/s"},
                {"change", "-``change_weight`` times the mean squared difference from the last action, 0 at first"},
                {"crash", "-``crash_weight`` if the episode ends as a failure"},
            },
        .end =
            "A contact, or d > ``max_distance_m``, ends an episode as a failure. An episode without a failure is a success if d "
            "is "
            "at most ``hold_m`` in every step of its last ``hold_s``.",
        .view = "third_person",
        .overlay = "target",
    };
  }

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
              {.about = "Maximum offset of the start from the point along each axis. The offset, tilt, speed and rate at the "
                        "start are drawn uniformly up to their maxima.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("start_tilt_deg", &C::start_tilt_deg,
              {.about = "Maximum tilt at the start.", .unit = "deg", .limits = between(0, 180)}),
        field("start_speed_mps", &C::start_speed_mps,
              {.about = "Maximum speed at the start, in any direction.", .unit = "m/s", .limits = between(0, 1000)}),
        field(
            "start_rate_dps", &C::start_rate_dps,
            {.about = "Maximum rate at the start, about each axis of the body.", .unit = "deg/s", .limits = between(0, 100000)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the point beyond which an episode ends as a failure.", .unit = "m", .limits = above(0)}),
        field("hold_m", &C::hold_m, {.about = "Distance within which the point is held.", .unit = "m", .limits = above(0)}),
        field("hold_s", &C::hold_s,
              {.about = "Time at the end of an episode during which the drone has to hold the point.",
               .unit = "s",
               .limits = above_up_to(0, 1000000)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("hold_weight", &C::hold_weight, {.about = "Weight of the reward term 1 / (1 + (d / (2 hold_m))^2)."}),
        field("speed_weight", &C::speed_weight, {.about = "Weight of the penalty on the speed, in m/s."}),
        field("spin_weight", &C::spin_weight,
              {.about = "Weight of the penalty on the magnitude of the angular velocity, in units of 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const HoverConfig& config);

}  // namespace flockstep
