// FormationConfig: drones hold their places relative to a moving leader.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

// Shape of a formation. The leader flies in direction +x.
enum class FormationShape : std::uint8_t {
  line,    // abreast of the leader, alternately left and right
  column,  // one behind the other
  v,       // behind the leader, alternately left and right, on two lines at 45 degrees
  circle,  // around the leader, the first in front of it
};
template <>
struct EnumNames<FormationShape> {
  static constexpr std::array kNames{"line", "column", "v", "circle"};
};

// Returns the places of `count` drones, m, relative to the leader, which has no place among them. Neighbours in the formation are
// spacing_m (m) apart, and none is nearer than that to the leader; on a circle of fewer than six drones they are farther apart.
FLOCKSTEP_API std::vector<Vec3> formation_places(FormationShape shape, std::size_t count, float spacing_m);

// Way of the leader.
enum class FormationRoute : std::uint8_t { loop, path };
template <>
struct EnumNames<FormationRoute> {
  static constexpr std::array kNames{"loop", "path"};
};
struct FormationConfig {
  static constexpr const char* kName = "formation";
  static constexpr const char* kAbout = "Hold places relative to a moving leader.";

  static TaskWords words() {
    return {
        .about =
            "The leader is a point that flies along a smooth route and touches nothing. Drone m has place m of "
            "`formation_places`, which turns with the leader's heading, and so do the drones. On a planned path the shape "
            "narrows to a column where there is no room. Each drone is an agent, and all fly by one policy.",
        .start =
            "At the beginning of the route, each drone up to ``jitter_m`` from its place along x and y, more if that is not "
            "free.",
        .action = "Three numbers, clipped to [-1, 1]: the displacement along the body's x, y and z, in units of ``step_m``.",
        .observed =
            "All vectors are in the body frame. The unit of velocities, u, is the longest displacement: sqrt(3) ``step_m`` per "
            "step. Ranges are divided by the maximum range and 1 on a miss.",
        .observation =
            {
                {"3", "offset to the drone's place, in units of 2 m, at most 1 long"},
                {"3", "velocity of the place over the next step, in units of u"},
                {"3", "last action"},
                {"3", "velocity of the last step, in units of u"},
                {"7 for each of ``neighbors``",
                 "nearest drones, in order: relative position in units of ``sight_m``, at most 1 long (3), relative velocity in "
                 "units of 2 u (3), and 1. Zeros for missing drones"},
                {"one for each beam", "LiDAR ranges"},
            },
        .reward =
            {
                {"place", "``place_weight`` exp(-d), with d the distance of the drone from its place, m"},
                {"crash", "-``crash_weight`` at a contact, and when d exceeds ``max_distance_m``"},
                {"near", "-``near_weight`` max(0, 1 - (nearest range) / ``near_m``)"},
                {"change", "-``change_weight`` times the mean squared difference from the last action, 0 at first"},
            },
        .end =
            "An episode is terminated at a contact, or if d exceeds ``max_distance_m``. It is truncated when the leader has "
            "arrived at the end of a path, as a success if the mean of d over all steps is at most ``close_m``.",
        .overlay = "place",
    };
  }

  FormationShape shape = FormationShape::v;
  float spacing_m = 1.5F;
  FormationRoute route = FormationRoute::loop;
  float loop_radius_m = 4.0F;
  float leader_speed_mps = 0.6F;
  float step_m = 0.15F;
  float jitter_m = 0.2F;
  int neighbors = 3;
  float sight_m = 4.0F;
  float max_distance_m = 3.0F;
  float close_m = 0.2F;
  float near_m = 0.8F;
  float place_weight = 0.2F;
  float crash_weight = 5.0F;
  float near_weight = 0.1F;
  float change_weight = 0.02F;

  static constexpr auto fields() {
    using C = FormationConfig;
    return field_list(
        field("shape", &C::shape,
              {.about = "Places of the drones. ``\"line\"``: abreast of the leader. ``\"column\"``: one behind the other on its "
                        "route. ``\"v\"``: behind the leader, on two lines at 45 degrees. ``\"circle\"``: around the leader."}),
        field("spacing_m", &C::spacing_m,
              {.about = "Distance between neighbouring places.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field(
            "route", &C::route,
            {.about =
                 "``\"loop\"``: a random closed path around the middle of the world. ``\"path\"``: a planned path from the start "
                 "marker of the world over the waypoints to the goal. Where the shape has no room, it narrows to a column."}),
        field("loop_radius_m", &C::loop_radius_m,
              {.about = "Maximum distance of a loop's corners from the middle. The minimum is 0.6 times that.",
               .unit = "m",
               .limits = above_up_to(0, 1000)}),
        field("leader_speed_mps", &C::leader_speed_mps,
              {.about = "Speed of the leader on straight parts, lower in curves.", .unit = "m/s", .limits = between(0, 1000)}),
        field("step_m", &C::step_m, {.about = "Distance of a full action along an axis.", .unit = "m", .limits = above(0)}),
        field("jitter_m", &C::jitter_m,
              {.about = "Maximum offset of a start from its place along x and y, drawn uniformly, more if this is not free.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("neighbors", &C::neighbors, {.about = "Number of neighbours that are observed.", .limits = between(1, 32)}),
        field("sight_m", &C::sight_m,
              {.about = "Unit of observed positions. Only the direction of a farther neighbour is observed.",
               .unit = "m",
               .limits = above(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from its place beyond which a drone has lost the formation.", .unit = "m", .limits = above(0)}),
        field("close_m", &C::close_m, {.about = "Maximum mean of d of a successful episode.", .unit = "m", .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Range below which the near term grows, from 0 to 1 at range 0.", .unit = "m", .limits = above(0)}),
        field("place_weight", &C::place_weight, {.about = "Weight of the reward term exp(-d)."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact, and for losing the formation."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest range."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const FormationConfig& config);

}  // namespace flockstep
