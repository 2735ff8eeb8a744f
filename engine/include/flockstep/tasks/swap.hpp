// SwapConfig: drones exchange places without touching.
#pragma once

#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

struct SwapConfig {
  static constexpr const char* kName = "swap";
  static constexpr const char* kAbout = "Exchange places with other drones without touching.";

  static TaskWords words() {
    return {
        .about =
            "Each drone is an agent, and all fly by one policy. Up to 32 drones fit into the default world. The goal of drone "
            "m of M is the place of drone (m + M // 2) % M. One drone alone flies to the opposite place. The drones move in the "
            "plane.",
        .start =
            "On a circle around the middle of the world's bounds, at the height of its start marker, facing the goals. The "
            "radius is ``radius_m``, or larger if neighbouring places would be nearer than ``spacing_m`` along the circle. Each "
            "episode turns the circle at random and moves each start by up to ``jitter_m`` along x and y.",
        .action = "Two numbers, clipped to [-1, 1]: the displacement along the body's x and y, in units of ``step_m``.",
        .observed =
            "All vectors are x and y of the body frame. The unit of velocities, u, is the longest displacement: sqrt(2) "
            "``step_m`` per step. Poses come from the pose sensor. Velocities are exact.",
        .observation =
            {
                {"2", "unit direction to the goal"},
                {"1", "distance to the goal, in units of 10 m, at most 1"},
                {"2", "last action"},
                {"2", "velocity of the last step, in units of u"},
                {"5 for each of ``neighbors``",
                 "nearest drones, in order: relative position in units of ``sight_m``, at most 1 long (2), relative velocity in "
                 "units of 2 u (2), and 1. Zeros for missing drones"},
            },
        .reward =
            {
                {"progress", "``progress_weight`` times the metres gained towards the goal"},
                {"goal", "``goal_weight`` for each drone when all are at their goals"},
                {"crash", "-``crash_weight`` at a contact"},
                {"near", "-``near_weight`` max(0, 1 - (distance to the nearest drone's centre) / ``near_m``)"},
                {"time", "-``time_weight`` in each step after which the drone is not at its goal"},
            },
        .end =
            "The episode ends as a success when all drones are within ``goal_radius_m`` of their goals at once. If a drone "
            "touches another drone or the world, its episode ends by a contact, and the others end because of a teammate. "
            "With ``episodes=\"last\"`` the others fly on, and succeed when all of them are at their goals.",
        .overlay = "goals",
    };
  }

  float step_m = 0.15F;
  float radius_m = 4.0F;
  float spacing_m = 1.3F;
  float jitter_m = 0.1F;
  float goal_radius_m = 0.3F;
  int neighbors = 6;
  float sight_m = 4.0F;
  float near_m = 1.5F;
  float progress_weight = 1.0F;
  float goal_weight = 10.0F;
  float crash_weight = 20.0F;
  float near_weight = 0.1F;
  float time_weight = 0.05F;

  static constexpr auto fields() {
    using C = SwapConfig;
    return field_list(
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("radius_m", &C::radius_m, {.about = "Minimum radius of the circle.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("spacing_m", &C::spacing_m,
              {.about = "Minimum distance between neighbouring places, along the circle. With many drones the circle grows.",
               .unit = "m",
               .limits = above_up_to(0, 1000)}),
        field("jitter_m", &C::jitter_m,
              {.about = "Maximum offset of a start from its place along x and y, drawn uniformly.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which a drone counts as at its goal.", .unit = "m", .limits = above(0)}),
        field("neighbors", &C::neighbors, {.about = "Number of neighbours that are observed.", .limits = between(1, 32)}),
        field("sight_m", &C::sight_m,
              {.about = "Unit of observed positions. Only the direction of a farther neighbour is observed.",
               .unit = "m",
               .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Distance to the nearest drone, between the centres, below which the near term grows, from 0 to 1.",
               .unit = "m",
               .limits = above(0)}),
        field("progress_weight", &C::progress_weight, {.about = "Reward for each metre gained towards the goal."}),
        field("goal_weight", &C::goal_weight, {.about = "Reward of each drone when all are at their goals."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest drone."}),
        field("time_weight", &C::time_weight, {.about = "Penalty for each step after which the drone is not at its goal."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const SwapConfig& config);

}  // namespace flockstep
