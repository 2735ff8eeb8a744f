// Readings: the arrays that the sensors of a batch publish for tasks and users. Those of other sensors are beside their
// configurations.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/arrays.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/lidar.hpp"

namespace flockstep {

// Readings of the pose sensor.
struct PoseReadings {
  std::vector<float> position;
  std::vector<float> quat_wxyz;
  std::vector<float> velocity;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = PoseReadings;
    return field_list(array("sensed_position", &C::position,
                            {.columns = 3,
                             .unit = "m",
                             .frame = Frame::world,
                             .writer = "pose sensor",
                             .about = "latest reading of the position"}),
                      array("sensed_quat_wxyz", &C::quat_wxyz,
                            {.columns = 4,
                             .unit = "1",
                             .frame = Frame::world,
                             .writer = "pose sensor",
                             .about = "latest reading of the orientation, body to world"}),
                      array("sensed_velocity", &C::velocity,
                            {.columns = 3,
                             .unit = "m/s",
                             .frame = Frame::world,
                             .writer = "pose sensor",
                             .about = "latest reading of the velocity. Empty without `velocity_noise_std_mps`"}),
                      array("sensed_age_s", &C::age_s, {.unit = "s", .writer = "pose sensor", .about = "age of the reading"}));
  }
};

// Readings of one LiDAR. Outputs that its LidarConfig does not choose are empty.
struct LidarReadings {
  std::vector<float> ranges;
  std::vector<float> max_range_m;
  std::vector<float> age_s;
  std::vector<float> turn_deg;
  std::vector<std::uint16_t> semantic;
  std::vector<std::uint16_t> instance;
  std::vector<float> intensity;

  static constexpr auto fields() {
    using C = LidarReadings;
    return field_list(
        array("ranges", &C::ranges,
              {.per = Per::ray,
               .unit = "m",
               .values = Values::range,
               .writer = "LiDAR",
               .about = "inf on a miss. Raises `RuntimeError` before the first scan"}),
        array("max_range_m", &C::max_range_m, {.unit = "m", .writer = "set_lidar()", .about = "maximum range of each drone"}),
        array("ranges_age_s", &C::age_s, {.unit = "s", .writer = "LiDAR", .about = "age of the reading"}),
        array("turn_deg", &C::turn_deg,
              {.unit = "deg",
               .writer = "LiDAR",
               .about = "angle by which the reading's beams are turned. Empty if the configuration's is 0"}),
        array("semantic", &C::semantic,
              {.per = Per::ray, .values = Values::any, .writer = "LiDAR", .about = "semantic id of the hit, 0 on a miss"}),
        array("instance", &C::instance,
              {.per = Per::ray, .values = Values::any, .writer = "LiDAR", .about = "number of the object, 0 on a miss"}),
        array("intensity", &C::intensity,
              {.per = Per::ray,
               .unit = "1",
               .values = Values::fraction,
               .writer = "LiDAR",
               .about = "light that returns, as a share of that from a white surface 1 m ahead, 0 on a miss"}));
  }
};

// Images of one camera. Outputs that its CameraConfig does not enable are empty. Row 0 is the top. In the layout chw, channels
// come before rows.
struct CameraImages {
  std::vector<std::uint8_t> rgb;
  std::vector<float> depth;
  std::vector<std::uint16_t> semantic;
  std::vector<std::uint16_t> instance;
  std::vector<float> normal;
  std::vector<std::uint8_t> grey;
  std::vector<std::uint8_t> hsv;
  std::vector<std::uint8_t> events;
  std::vector<std::int64_t> frame_step;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = CameraImages;
    constexpr const char* kWriter = "camera";
    return field_list(
        array("rgb", &C::rgb,
              {.per = Per::pixel, .columns = 3, .values = Values::any, .writer = kWriter, .about = "sRGB colour"}),
        array("depth", &C::depth,
              {.per = Per::pixel,
               .unit = "m",
               .values = Values::range,
               .writer = kWriter,
               .about = "inf if nothing is seen: sky, or beyond far_m"}),
        array("semantic", &C::semantic,
              {.per = Per::pixel, .values = Values::any, .writer = kWriter, .about = "semantic id, 0 if nothing is seen"}),
        array(
            "instance", &C::instance,
            {.per = Per::pixel, .values = Values::any, .writer = kWriter, .about = "number of the object, 0 if nothing is seen"}),
        array("normal", &C::normal,
              {.per = Per::pixel,
               .columns = 3,
               .unit = "1",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "surface normal, towards the camera, 0 if nothing is seen"}),
        array("grey", &C::grey,
              {.per = Per::pixel, .values = Values::any, .writer = kWriter, .about = "luma of rgb (ITU-R BT.601), rounded"}),
        array("hsv", &C::hsv,
              {.per = Per::pixel,
               .columns = 3,
               .values = Values::any,
               .writer = kWriter,
               .about = "hue / 2 in degrees, saturation, value, as in OpenCV"}),
        array("events", &C::events,
              {.per = Per::pixel,
               .columns = 2,
               .values = Values::any,
               .writer = kWriter,
               .about = "ON and OFF events since the last image, at most 255 each"}),
        array("frame_step", &C::frame_step,
              {.values = Values::last_count,
               .writer = kWriter,
               .about = "number of the image's reading, 0 at the reset, -1 if stale"}),
        array("frame_age_s", &C::age_s, {.unit = "s", .writer = kWriter, .about = "time since the image was taken"}));
  }
};

// Returns the arrays that a search for readings of a type has found; empty ones if it has found none.
template <HasFields Arrays>
const Arrays& or_empty(const void* found) {
  static const Arrays kNone;
  return found == nullptr ? kNone : *static_cast<const Arrays*>(found);
}

// Shape of a LiDAR's scans and of a camera's images.
inline ItemShape items_of(const LidarConfig& config) { return {.sizes = {config.rows(), config.columns()}, .dimensions = 2}; }
inline ItemShape items_of(const CameraConfig& config) {
  return {.sizes = {config.image_height_px(), config.image_width_px()},
          .dimensions = 2,
          .columns_first = config.layout == ImageLayout::chw};
}

}  // namespace flockstep
