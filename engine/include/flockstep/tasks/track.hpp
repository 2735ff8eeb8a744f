// TrackConfig: a drone follows a point that moves along a smooth path.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

// Shape of the path.
enum class TrackPath : std::uint8_t { figure8, random };
template <>
struct EnumNames<TrackPath> {
  static constexpr std::array kNames{"figure8", "random"};
};

// Heading that a drone should have on the path.
enum class TrackYaw : std::uint8_t { fixed, along };
template <>
struct EnumNames<TrackYaw> {
  static constexpr std::array kNames{"fixed", "along"};
};
struct TrackConfig {
  static constexpr const char* kName = "track";
  static constexpr const char* kAbout = "Follow a point that moves along a smooth path.";

  static TaskWords words() {
    return {
        .about =
            "The path is a figure-8 or random, around the world's goal marker or the centre of its bounds. A world raises an "
            "error if the path leaves the room or a figure-8 touches something. Use any airframe with rotors and any "
            "``control`` except ``\"pose\"``. ``batch.task_state[\"phase\"]`` (N, 9) holds the drawn phases: three waves along "
            "x, then y, then z, in turns. A figure-8 uses only the first phase.",
        .start =
            "At a random point of the path, offset by up to ``start_offset_m`` along each axis, level, with the path's velocity "
            "and yaw, and with rotors at hover speed.",
        .action =
            "Four numbers, clipped to [-1, 1]: a command of ``control`` (`Terms.command`). 0 hovers or has no "
            "effect, and ±1 is the largest command.",
        .observed =
            "All vectors are in the body frame. Offsets, directions and the velocity come from the pose sensor. Body rates and "
            "rotor speeds are exact.",
        .observation =
            {
                {"3 for each of ``points``",
                 "offset to the current point of the path, the point ``ahead_s`` later, and so on, m"},
                {"3", "velocity, m/s"},
                {"3", "the world's up vector"},
                {"3", "angular velocity, in units of 10 rad/s"},
                {"4", "speed of each rotor, 4 of a quadrotor: -1 slowest, 0 hovering, 1 fastest"},
                {"2", "sine and cosine of the yaw error"},
            },
        .reward =
            {
                {"near", "``near_weight`` exp(-2 d), with d the distance to the current point, m"},
                {"close", "``close_weight`` / (1 + (d / ``close_m``)^2)"},
                {"yaw", "-``yaw_weight`` times the yaw error, rad"},
                {"spin", "-``spin_weight`` times the magnitude of the angular velocity, in units of 10 rad/s"},
                {"change", "-``change_weight`` times the mean squared difference from the last action, 0 at first"},
                {"crash", "-``crash_weight`` if the episode ends as a failure"},
            },
        .end =
            "A contact, or d > ``max_distance_m``, ends an episode as a failure. An episode without a failure is a success if "
            "the "
            "root mean square of d over all its steps is at most ``close_m``.",
        .view = "third_person",
        .overlay = "target",
    };
  }

  TrackPath path = TrackPath::figure8;
  TrackYaw yaw = TrackYaw::fixed;
  float size_m = 1.0F;
  float speed_mps = 1.5F;
  float start_offset_m = 0.1F;
  int points = 5;
  float ahead_s = 0.1F;
  float max_distance_m = 1.0F;
  float close_m = 0.05F;
  float near_weight = 1.0F;
  float close_weight = 1.0F;
  float yaw_weight = 0.2F;
  float spin_weight = 0.02F;
  float change_weight = 0.0F;
  float crash_weight = 10.0F;

  static constexpr auto fields() {
    using C = TrackConfig;
    return field_list(
        field("path", &C::path,
              {.about = "``\"figure8\"``: level, x = s cos(w t), y = s / 2 sin(2 w t) with s = ``size_m``. ``\"random\"``: along "
                        "each axis, the sum of three waves with random phases. The path stays within ``size_m`` of the centre "
                        "along x and y, and within half of that along z."}),
        field("yaw", &C::yaw, {.about = "``\"fixed\"``: along the world's x axis. ``\"along\"``: the direction of the path."}),
        field("size_m", &C::size_m, {.about = "Size of the path.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("speed_mps", &C::speed_mps,
              {.about = "Speed along the path: the mean over a lap of a figure-8, the root mean square of a random path.",
               .unit = "m/s",
               .limits = above_up_to(0, 1000)}),
        field("start_offset_m", &C::start_offset_m,
              {.about = "Maximum offset of the start from the path along each axis, drawn uniformly up to this.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("points", &C::points, {.about = "Number of points of the path that are observed.", .limits = between(1, 20)}),
        field("ahead_s", &C::ahead_s, {.about = "Time from one observed point to the next.", .unit = "s", .limits = at_least(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the path beyond which an episode ends as a failure.", .unit = "m", .limits = above(0)}),
        field("close_m", &C::close_m,
              {.about = "Maximum root mean square of d of a successful episode.", .unit = "m", .limits = above(0)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("close_weight", &C::close_weight, {.about = "Weight of the reward term 1 / (1 + (d / close_m)^2)."}),
        field("yaw_weight", &C::yaw_weight, {.about = "Weight of the penalty on the yaw error, in rad."}),
        field("spin_weight", &C::spin_weight,
              {.about = "Weight of the penalty on the magnitude of the angular velocity, in units of 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const TrackConfig& config);

}  // namespace flockstep
