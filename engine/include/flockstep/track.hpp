// The track task: a drone follows a point that moves along a smooth path.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

enum class TrackPath : std::uint8_t { figure8, random };
template <>
struct EnumNames<TrackPath> {
  static constexpr std::array kNames{"figure8", "random"};
};

enum class TrackYaw : std::uint8_t { fixed, along };
template <>
struct EnumNames<TrackYaw> {
  static constexpr std::array kNames{"fixed", "along"};
};

// Paths lie about the world's goal marker, or about the centre of its bounds where it has none. Each episode begins somewhere on
// its path, with the path's velocity and yaw. Actions are those of the hover task.
//
// Observed, float32 (15 + 3 points,), in the body frame: the way to the points where the path is now, ahead_s later, and so on,
// m (3 points); velocity, m/s (3); the world's up (3); angular velocity, 10 rad/s (3); rotor speeds as in the hover task (4);
// sine and cosine of the yaw that is missing (2).
//
// d is the distance to where the path is now, m. An episode ends as a crash on a contact, or where d > max_distance_m; it is a
// success if it ends with a root mean square of d, over all its steps, of at most close_m.
struct TrackConfig {
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
              {.about = "``\"figure8\"``: level, x = s cos(w t), y = s / 2 sin(2 w t) with s = ``size_m``. ``\"random\"``: three "
                        "waves of random phases along each axis, up to ``size_m`` in all and half of that in height."}),
        field("yaw", &C::yaw, {.about = "``\"fixed\"``: along the world's x axis. ``\"along\"``: the way the path goes."}),
        field("size_m", &C::size_m, {.about = "Size of the path.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("speed_mps", &C::speed_mps,
              {.about = "Speed of the path: the mean of a lap of a figure-8, the root mean square of random paths.",
               .unit = "m/s",
               .limits = above_up_to(0, 1000)}),
        field("start_offset_m", &C::start_offset_m,
              {.about = "Episodes begin off the path, drawn uniformly up to this along each axis.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("points", &C::points, {.about = "Number of points of the path that are observed.", .limits = between(1, 20)}),
        field("ahead_s", &C::ahead_s, {.about = "Time from one observed point to the next.", .unit = "s", .limits = at_least(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the path beyond which an episode ends as a crash.", .unit = "m", .limits = above(0)}),
        field("close_m", &C::close_m,
              {.about = "Greatest root mean square of d of an episode that is a success.", .unit = "m", .limits = above(0)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("close_weight", &C::close_weight, {.about = "Weight of 1 / (1 + (d / close_m)^2)."}),
        field("yaw_weight", &C::yaw_weight, {.about = "Weight of minus the yaw that is missing, rad."}),
        field("spin_weight", &C::spin_weight, {.about = "Weight of minus the length of the angular velocity, 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of minus the mean squared difference to the previous action, which is 0 before the first."}),
        field("crash_weight", &C::crash_weight, {.about = "Weight of -1 on a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

// By default in "arena/hall", a crazyflie by body rates at 100 Hz, for 10 s. Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_track(const TrackConfig& config);

}  // namespace flockstep
