// The track task: a drone follows a point that moves along a smooth path.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

enum class TrackPath : std::uint8_t {
  figure8,  // level: x = s cos(w t), y = s / 2 sin(2 w t), s = size_m
  random,   // three waves along each axis of random phases, up to size_m in all, half of that in height
};
template <>
struct EnumNames<TrackPath> {
  static constexpr std::array kNames{"figure8", "random"};
};

enum class TrackYaw : std::uint8_t {
  fixed,  // along the world's x axis
  along,  // the way the path goes
};
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
  float size_m = 1.0F;          // in (0, 1000]
  float speed_mps = 1.5F;       // > 0; of a figure-8 the mean of a lap, of random paths the root mean square
  float start_offset_m = 0.1F;  // episodes begin off the path, evenly drawn up to this along each axis, in [0, 1000]
  int points = 5;               // observed, in [1, 20]
  float ahead_s = 0.1F;         // >= 0, from one to the next
  float max_distance_m = 1.0F;  // > 0
  float close_m = 0.05F;        // > 0
  // The terms of the reward, each times its weight.
  float near_weight = 1.0F;    // exp(-2 d)
  float close_weight = 1.0F;   // 1 / (1 + (d / close_m)^2)
  float yaw_weight = 0.2F;     // -|yaw that is missing|, rad
  float spin_weight = 0.02F;   // -length of the angular velocity, 10 rad/s
  float change_weight = 0.0F;  // -mean square of what the action changed by; the first action changes from 0
  float crash_weight = 10.0F;  // -1 on a crash

  static constexpr auto fields() {
    using C = TrackConfig;
    return field_list(field("path", &C::path), field("yaw", &C::yaw), field("size_m", &C::size_m),
                      field("speed_mps", &C::speed_mps), field("start_offset_m", &C::start_offset_m), field("points", &C::points),
                      field("ahead_s", &C::ahead_s), field("max_distance_m", &C::max_distance_m), field("close_m", &C::close_m),
                      field("near_weight", &C::near_weight), field("close_weight", &C::close_weight),
                      field("yaw_weight", &C::yaw_weight), field("spin_weight", &C::spin_weight),
                      field("change_weight", &C::change_weight), field("crash_weight", &C::crash_weight));
  }

  void validate() const;
};

// By default in "arena/hall", a crazyflie by body rates at 100 Hz, for 10 s. Throws std::invalid_argument on a bad config.
std::unique_ptr<Task> make_track(const TrackConfig& config);

}  // namespace flockstep
