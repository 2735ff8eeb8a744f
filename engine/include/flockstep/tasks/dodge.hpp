// DodgeConfig: fly to a goal by LiDAR, among bodies that move.
#pragma once

#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

struct DodgeConfig {
  static constexpr const char* kName = "dodge";
  static constexpr const char* kAbout = "Fly to a goal by LiDAR, among bodies that move.";

  static TaskWords words() {
    return {
        .about =
            "The worlds hold bodies that move: pillars that slide, forklifts, people. The drone moves in the plane, straight to "
            "the commanded pose, and should have a planar LiDAR.",
        .start =
            "At a random free place at the height of the world's start marker, at least 1.5 m from the centre of every body. The "
            "goal is a random free place at the same height, at least ``goal_distance_m`` away.",
        .action = "Two numbers, clipped to [-1, 1]: the displacement along the body's x and y, in units of ``step_m``.",
        .observed = "Vectors are x and y of the body frame. Ranges are divided by the maximum range and 1 on a miss.",
        .observation =
            {
                {"2", "unit direction to the goal"},
                {"1", "distance to the goal, in units of 10 m, at most 1"},
                {"2", "last action"},
                {"one for each beam", "LiDAR ranges"},
                {"one for each beam", "LiDAR ranges before the last step, at the start equal to the others"},
            },
        .reward =
            {
                {"progress", "``progress_weight`` times the metres gained towards the goal"},
                {"goal", "``goal_weight`` at the goal"},
                {"crash", "-``crash_weight`` at a contact"},
                {"near", "-``near_weight`` max(0, 1 - (nearest range) / ``near_m``)"},
                {"time", "-``time_weight`` in each step"},
            },
        .end = "An episode ends within ``goal_radius_m`` of the goal, as a success, or at a contact.",
        .overlay = "goals",
    };
  }

  float step_m = 0.15F;
  float goal_distance_m = 5.0F;
  float goal_radius_m = 0.5F;
  float near_m = 1.0F;
  float progress_weight = 1.0F;
  float goal_weight = 10.0F;
  float crash_weight = 10.0F;
  float near_weight = 0.1F;
  float time_weight = 0.02F;

  static constexpr auto fields() {
    using C = DodgeConfig;
    return field_list(
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("goal_distance_m", &C::goal_distance_m,
              {.about = "Minimum distance from the start to the goal. If no such place is found, the goal is the farthest free "
                        "place among those drawn.",
               .unit = "m",
               .limits = at_least(0)}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which the goal counts as reached.", .unit = "m", .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Range below which the near term grows, from 0 to 1 at range 0.", .unit = "m", .limits = above(0)}),
        field("progress_weight", &C::progress_weight, {.about = "Reward for each metre gained towards the goal."}),
        field("goal_weight", &C::goal_weight, {.about = "Reward for reaching the goal."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest range."}),
        field("time_weight", &C::time_weight, {.about = "Penalty for each step."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const DodgeConfig& config);

}  // namespace flockstep
