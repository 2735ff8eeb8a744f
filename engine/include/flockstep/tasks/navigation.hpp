// NavigationConfig: fly from the start via the waypoints to the goal, with LiDAR ranges and the chosen `observation`.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/color.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

// Meaning of actions.
enum class ActionKind : std::uint8_t { discrete, displacement, displacement_yaw, discrete_forward };
template <>
struct EnumNames<ActionKind> {
  static constexpr std::array kNames{"discrete", "displacement", "displacement_yaw", "discrete_forward"};
};

// Observations in addition to the LiDAR ranges. blob and pixels use the batch's first camera, which needs the output rgb and a
// capture mode other than on_demand.
enum class ObservationKind : std::uint8_t { goal, blob, pixels };
template <>
struct EnumNames<ObservationKind> {
  static constexpr std::array kNames{"goal", "blob", "pixels"};
};

// Norm that is 1 in the observed direction to the goal.
enum class GoalNorm : std::uint8_t { euclidean, maximum };
template <>
struct EnumNames<GoalNorm> {
  static constexpr std::array kNames{"euclidean", "maximum"};
};

// The reward is the sum of these terms, each multiplied by its weight.
// Source: the LiDAR and camera experiments of the thesis "Drone Simulation Using Unreal Engine", chapter 6.
// l are the LiDAR ranges over max_range_m, |L| is their number, M = min_clearance, R = goal_reward.
struct NavigationReward {
  float distance_weight = 1.0F;
  float crash_weight = 1.0F;
  float free_space_weight = 1.0F;
  float step_weight = 1.0F;
  float action_change_weight = 1.0F;
  float overshoot_weight = 0.0F;
  float goal_reward = 10000.0F;
  float waypoint_share = 0.1F;
  float goal_radius_m = 0.5F;
  float min_clearance = 0.2F;
  float step_scale = 3000.0F;
  bool carry_over_distance = false;

  static constexpr auto fields() {
    using C = NavigationReward;
    return field_list(
        field("distance_weight", &C::distance_weight, {.about = "Weight of ``distance``."}),
        field("crash_weight", &C::crash_weight, {.about = "Weight of ``crash``."}),
        field("free_space_weight", &C::free_space_weight, {.about = "Weight of ``free_space``."}),
        field("step_weight", &C::step_weight, {.about = "Weight of ``step``."}),
        field("action_change_weight", &C::action_change_weight, {.about = "Weight of ``action_change``."}),
        field("overshoot_weight", &C::overshoot_weight,
              {.about = "Weight of ``overshoot``. If it is not 0, passing the goal ends the episode."}),
        field("goal_reward", &C::goal_reward, {.about = "R."}),
        field("waypoint_share", &C::waypoint_share, {.about = "Share of R that is split among the waypoints."}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which goal and waypoints are reached.", .unit = "m", .limits = above(0)}),
        field("min_clearance", &C::min_clearance,
              {.about = "M, in units of the LiDAR's maximum range.", .limits = between_excluding(0, 1)}),
        field("step_scale", &C::step_scale, {.about = "Step number at which the step term reaches -1.", .limits = above(0)}),
        field("carry_over_distance", &C::carry_over_distance,
              {.about = "Keep the last distance when the current goal changes, as the thesis did."}));
  }

  FLOCKSTEP_API void validate() const;
};

struct NavigationConfig {
  static constexpr const char* kName = "navigation";
  static constexpr const char* kAbout = "Fly from the start via the waypoints to the goal.";

  static TaskWords words() {
    return {
        .about =
            "A drone with a LiDAR flies from the start marker over the waypoints to the goal. Instead of the direction, the "
            "camera tasks observe where an image shows the green goal (``observation=\"blob\"``) or the image itself "
            "(``\"pixels\"``).",
        .start = "At the world's start marker, or anywhere in its spawn box with ``random_start=True``.",
        .action = "``action`` chooses: one of six directions, one of three, or a displacement.",
        .observed =
            "Ranges are divided by the LiDAR's maximum range and 1 on a miss. With ``\"pixels\"`` the observation is a dict of "
            "``ranges`` and the first camera's ``image``, (3, H, W) uint8.",
        .observation =
            {
                {"3, \"goal\"",
                 "unit direction in the body frame, by the pose sensor, to the current goal: the next waypoint, or the final "
                 "goal"},
                {"2, \"blob\"",
                 "``offset`` and ``area`` of the `color_blob` of ``color`` in the first camera's image, 0 without such a pixel"},
                {"one for each beam", "LiDAR ranges"},
            },
        .reward =
            {
                {"distance",
                 "at the final goal R = ``goal_reward`` of ``reward``. At a waypoint R * ``waypoint_share`` / number of "
                 "waypoints. In all other steps the centimetres gained towards the current goal"},
                {"crash",
                 "-R on a collision. In all other steps min(0, min(l) - M), with the observed ranges l and M = "
                 "``min_clearance``"},
                {"free_space", "sum(l / M - 1) / (|L| / M - |L|) for |L| ranges, which is 1 in the open"},
                {"step", "-(step number) / ``step_scale``, with 0 as the first number"},
                {"action_change", "-1 if the action changes, or is the first"},
                {"overshoot", "-R / 10 when x exceeds the current goal's x + ``goal_radius_m``"},
            },
        .end =
            "An episode ends as a success at the final goal. It also ends at a collision, and when the drone has passed the "
            "goal, unless ``overshoot_weight`` is 0. ``batch.task_state`` holds ``goal_index``, the number of waypoints reached, "
            "and ``last_distance``, m.",
    };
  }

  ActionKind action = ActionKind::discrete;
  ObservationKind observation = ObservationKind::goal;
  GoalNorm goal_norm = GoalNorm::euclidean;
  float step_m = 0.1F;
  float yaw_step_deg = 10.0F;
  NavigationReward reward;
  bool random_start = false;
  ColorRange color;

  static constexpr auto fields() {
    using C = NavigationConfig;
    return field_list(
        field("action", &C::action,
              {.about = "``\"discrete\"``: 0 to 5 for +x, -x, +y, -y, +z, -z by ``step_m`` in the body frame. "
                        "``\"displacement\"``: (3,), clipped to [-1, 1], times ``step_m``, body frame. ``\"displacement_yaw\"``: "
                        "(4,), the same and a turn of up to ``yaw_step_deg``, counter-clockwise positive. "
                        "``\"discrete_forward\"``: 0 to 2 for +x, +y, -y by ``step_m``."}),
        field("observation", &C::observation,
              {.about = "Values before the LiDAR ranges, which are divided by the maximum range and 1 on a miss. ``\"goal\"``: "
                        "unit direction (3,) to the current goal, body frame, by the pose sensor. ``\"blob\"``: ``offset`` and "
                        "``area`` of the `color_blob` of ``color`` in the first camera's image. ``\"pixels\"``: none. The first "
                        "camera's image, of layout ``\"chw\"``, is a separate field."}),
        field("goal_norm", &C::goal_norm,
              {.about = "Norm by which the direction to the goal is divided. ``\"maximum\"``: its largest component, as in the "
                        "thesis's program."}),
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("yaw_step_deg", &C::yaw_step_deg,
              {.about = "Angle of a full turn action.", .unit = "deg", .limits = above_up_to(0, 180)}),
        field("reward", &C::reward, {.about = "The terms of the reward."}),
        field("random_start", &C::random_start,
              {.about = "Start anywhere in the world's spawn box instead of at its start marker."}),
        field("color", &C::color, {.about = "Colour of ``observation=\"blob\"``, by default the goal's green."}));
  }

  // Returns the thesis's task with this observation. Camera tasks use `discrete_forward` and end when x passes the goal.
  FLOCKSTEP_API static NavigationConfig observing(ObservationKind observation);

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const NavigationConfig& config);

}  // namespace flockstep
