// CameraConfig: a pinhole camera; CameraImages: what it writes.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "flockstep/fields.hpp"

namespace flockstep {

enum class DepthKind : std::uint8_t {
  planar,  // along the optical axis
  range,   // from the camera
};
template <>
struct EnumNames<DepthKind> {
  static constexpr std::array kNames{"planar", "range"};
};

enum class ImageLayout : std::uint8_t {
  hwc,  // (N, H, W, 3)
  chw,  // (N, 3, H, W)
};
template <>
struct EnumNames<ImageLayout> {
  static constexpr std::array kNames{"hwc", "chw"};
};

// When frames are rendered. A reset, and a change of the camera itself, is always a reason to render (on_demand: at the next
// capture).
enum class CaptureMode : std::uint8_t {
  every_step,   // at every step or sense(), or as often as rate_hz says
  on_movement,  // when the drone's pose or world differs from what its frame shows
  on_demand,    // by capture() alone
};
template <>
struct EnumNames<CaptureMode> {
  static constexpr std::array kNames{"every_step", "on_movement", "on_demand"};
};

// What a pixel of a resized image is of the rendered pixels that it covers.
enum class Pool : std::uint8_t {
  mean,  // weighted by the area that each covers, as OpenCV's INTER_AREA
  min,   // the least, channel by channel
  max,   // the greatest, channel by channel
};
template <>
struct EnumNames<Pool> {
  static constexpr std::array kNames{"mean", "min", "max"};
};

// Who renders cameras.
enum class CameraBackend : std::uint8_t {
  raycast,    // the engine's own tracing: needs nothing, and repeats to the bit
  gl,         // OpenGL 4.5 by EGL, headless; without it, raycast with a warning
  automatic,  // the faster of the two on the batch's worlds, timed when it is made; likewise
};
template <>
struct EnumNames<CameraBackend> {
  static constexpr std::array kNames{"raycast", "gl", "auto"};
};

// What a camera writes; see CameraImages.
struct CameraOutputs {
  bool rgb = true;
  bool depth = false;
  bool semantic = false;
  bool instance = false;
  bool normal = false;
  bool grey = false;
  bool hsv = false;

  static constexpr auto fields() {
    using C = CameraOutputs;
    return field_list(field("rgb", &C::rgb), field("depth", &C::depth), field("semantic", &C::semantic),
                      field("instance", &C::instance), field("normal", &C::normal), field("grey", &C::grey),
                      field("hsv", &C::hsv));
  }

  bool any_color() const { return rgb || grey; }
};

// A pinhole camera. Its frame: x along the optical axis, y left, z up. The centre of the image is where the axis meets it.
struct CameraConfig {
  std::string name = "front";  // unique in the batch: letters, digits, _ and -
  int width_px = 640;          // in [1, 8192]
  int height_px = 480;         // in [1, 8192]
  // Each in [0.1, 179]. One alone: pixels are square, and the other, which follows, is below 179, too. Neither: hfov_deg is 90.
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::array<float, 3> offset_m{0, 0, 0};      // of the camera in the body frame, within +-100
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};  // camera to body; normalised if close to unit
  float near_m = 0.05F;                        // > 0; planar depth below which nothing is seen
  float far_m = 100.0F;                        // > near_m, at most 1e6; planar depth beyond which the sky is seen
  CameraOutputs outputs;
  DepthKind depth_kind = DepthKind::planar;
  ImageLayout layout = ImageLayout::hwc;  // of rgb, hsv and normal
  CaptureMode capture_mode = CaptureMode::every_step;
  int samples_per_pixel = 1;     // 1, 4, 9 or 16, a grid, averaged as written; colours only: the rest is of the pixel's centre
  bool shadows = false;          // hard shadows of the sun, by all but markers; a room lets it in
  std::optional<float> rate_hz;  // frames per second of simulated time, of capture mode every_step; none: one after every step
  // Width and height in pixels of the images that are written; none: as rendered. In [1, width_px] and [1, height_px]. Not with
  // semantic, instance or normal, which have no mean. hsv is computed from the resized rgb.
  std::optional<std::array<int, 2>> resize;
  Pool pool = Pool::mean;  // with resize; depth is inf where mean or max covers a miss, or min covers nothing else

  static constexpr auto fields() {
    using C = CameraConfig;
    return field_list(field("name", &C::name), field("width_px", &C::width_px), field("height_px", &C::height_px),
                      field("hfov_deg", &C::hfov_deg), field("vfov_deg", &C::vfov_deg), field("offset_m", &C::offset_m),
                      field("quat_wxyz", &C::quat_wxyz), field("near_m", &C::near_m), field("far_m", &C::far_m),
                      field("outputs", &C::outputs), field("depth_kind", &C::depth_kind), field("layout", &C::layout),
                      field("capture_mode", &C::capture_mode, Decides::nothing),  // a snapshot brings its own
                      field("samples_per_pixel", &C::samples_per_pixel), field("shadows", &C::shadows),
                      field("rate_hz", &C::rate_hz), field("resize", &C::resize), field("pool", &C::pool));
  }

  void validate() const;
  float fx() const;  // px
  float fy() const;  // px
  // Of the images that are written.
  int image_width_px() const { return resize ? (*resize)[0] : width_px; }
  int image_height_px() const { return resize ? (*resize)[1] : height_px; }
};

// Run-time changes to a camera of some drones; what is not set stays. The resolution is fixed per batch.
struct CameraChange {
  std::optional<float> hfov_deg;  // setting one unsets the other, unless both are given
  std::optional<float> vfov_deg;
  std::optional<std::array<float, 3>> offset_m;
  std::optional<std::array<float, 4>> quat_wxyz;

  bool any() const { return hfov_deg || vfov_deg || offset_m || quat_wxyz; }
};

}  // namespace flockstep
