// CameraConfig: a camera. readings.hpp has its images, CameraImages.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/color_errors.hpp"
#include "flockstep/sensors/depth_errors.hpp"
#include "flockstep/sensors/event_pixels.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// Distance of a ray's pixel from the centre of the image: the focal length times the tangent of its angle from the optical axis,
// or times the angle.
enum class Projection : std::uint8_t { pinhole, fisheye };
template <>
struct EnumNames<Projection> {
  static constexpr std::array kNames{"pinhole", "fisheye"};
};

// Meaning of depth: distance along the optical axis, or from the camera.
enum class DepthKind : std::uint8_t { planar, range };
template <>
struct EnumNames<DepthKind> {
  static constexpr std::array kNames{"planar", "range"};
};

// Order of rows (h), columns (w) and channels (c) of an image.
enum class ImageLayout : std::uint8_t { hwc, chw };
template <>
struct EnumNames<ImageLayout> {
  static constexpr std::array kNames{"hwc", "chw"};
};

// Selects when a camera renders.
enum class CaptureMode : std::uint8_t { every_step, on_movement, on_demand };
template <>
struct EnumNames<CaptureMode> {
  static constexpr std::array kNames{"every_step", "on_movement", "on_demand"};
};

// Method that combines the rendered pixels covered by one pixel of a resized image.
enum class Pool : std::uint8_t { mean, min, max };
template <>
struct EnumNames<Pool> {
  static constexpr std::array kNames{"mean", "min", "max"};
};

// Renderer of the cameras.
enum class CameraBackend : std::uint8_t { raycast, gl, automatic };
template <>
struct EnumNames<CameraBackend> {
  static constexpr std::array kNames{"raycast", "gl", "auto"};
};

// Images that a camera writes; see CameraImages.
struct CameraOutputs {
  bool rgb = true;        // sRGB colour
  bool depth = false;     // distance, m
  bool semantic = false;  // class of the material
  bool instance = false;  // number of the object
  bool normal = false;    // surface normal, world frame
  bool grey = false;      // grey value
  bool hsv = false;       // hue, saturation, value
  bool events = false;    // changes of brightness

  static constexpr auto fields() {
    using C = CameraOutputs;
    return field_list(field("rgb", &C::rgb), field("depth", &C::depth), field("semantic", &C::semantic),
                      field("instance", &C::instance), field("normal", &C::normal), field("grey", &C::grey),
                      field("hsv", &C::hsv), field("events", &C::events));
  }

  bool any_color() const { return rgb || grey; }  // true if colours are rendered
};

// A camera. Camera frame: x along the optical axis, y left, z up. The optical axis passes through the centre of the
// image.
struct CameraConfig {
  std::string name = "front";
  int width_px = 640;
  int height_px = 480;
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  Projection projection = Projection::pinhole;
  std::vector<float> distortion;
  std::array<float, 3> offset_m{0, 0, 0};
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};
  float near_m = 0.05F;
  float far_m = 100.0F;
  CameraOutputs outputs;
  DepthKind depth_kind = DepthKind::planar;
  ImageLayout layout = ImageLayout::hwc;
  CaptureMode capture_mode = CaptureMode::every_step;
  int samples_per_pixel = 1;
  float rolling_shutter_s = 0.0F;
  float exposure_s = 0.0F;
  int blur_samples = 8;
  bool shadows = false;
  float sun_size_deg = 0.0F;
  int ambient_occlusion_rays = 0;
  bool adaptive_samples = false;
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;
  std::optional<std::array<int, 2>> resize;
  Pool pool = Pool::mean;
  DepthErrors depth_errors;
  ColorErrors color_errors;
  EventPixels event_pixels;

  static constexpr int kMaxSide = 8192;         // px, maximum width and height of an image
  static constexpr int kMaxColorSamples = 256;  // of a pixel, at all poses

  static constexpr auto fields() {
    using C = CameraConfig;
    return field_list(
        field("name", &C::name, {.about = "Name for `Batch.camera`, unique among the cameras.", .form = Form::plain_name}),
        field("width_px", &C::width_px, {.about = "Width of the rendered image.", .unit = "px", .limits = between(1, kMaxSide)}),
        field("height_px", &C::height_px,
              {.about = "Height of the rendered image.", .unit = "px", .limits = between(1, kMaxSide)}),
        field("hfov_deg", &C::hfov_deg,
              {.about = "Horizontal field of view. With only one of the two, pixels are square. With neither, this one is 90.",
               .unit = "deg",
               .limits = between(0.1, 179)}),
        field("vfov_deg", &C::vfov_deg, {.about = "Vertical field of view.", .unit = "deg", .limits = between(0.1, 179)}),
        field("projection", &C::projection,
              {.about = "``\"pinhole\"``, or ``\"fisheye\"``, whose depths are ranges. Only by ``\"raycast\"``."}),
        field("distortion", &C::distortion,
              {.about = "Coefficients as in OpenCV: k1, k2, p1, p2, k3, or a fisheye's k1 to k4. Only by ``\"raycast\"``.",
               .limits = within(1e6)}),
        field("offset_m", &C::offset_m, kMountOffset), field("quat_wxyz", &C::quat_wxyz, kMountRotation),
        field("near_m", &C::near_m,
              {.about = "Minimum planar depth, less than ``far_m``: nearer surfaces are not rendered.",
               .unit = "m",
               .limits = above(0)}),
        field("far_m", &C::far_m,
              {.about = "Maximum planar depth: beyond it is sky.", .unit = "m", .limits = above_up_to(0, 1e6)}),
        field("outputs", &C::outputs,
              {.about = "Images to write, at least one: ``\"rgb\"``, ``\"depth\"``, ``\"semantic\"``, ``\"instance\"``, "
                        "``\"normal\"``, ``\"grey\"``, ``\"hsv\"``, ``\"events\"``."}),
        field("depth_kind", &C::depth_kind, {.about = "``\"planar\"``: along the optical axis. ``\"range\"``: from the camera."}),
        field("layout", &C::layout,
              {.about = "Shape of images with C channels. ``\"hwc\"``: (N, H, W, C). ``\"chw\"``: (N, C, H, W)."}),
        field("capture_mode", &C::capture_mode,
              {.about = "``\"every_step\"``: renders after every step, or at ``rate_hz``. ``\"on_movement\"``: after a step, if "
                        "the drone's pose or world has changed. ``\"on_demand\"``: only in `Batch.capture`. The first two also "
                        "render at a reset and in `Batch.sense`.",
               .affects_hash = AffectsHash::no}),  // the mode is part of the snapshot
        field("samples_per_pixel", &C::samples_per_pixel,
              {.about = "Samples that a pixel's colours are averaged over. Other outputs are taken at its centre.",
               .limits = one_of(1, 4, 9, 16)}),
        field("adaptive_samples", &C::adaptive_samples,
              {.about = "Take all samples only where colours differ by more than 8 of 255 among 3 x 3 pixels. "
                        "``\"gl\"``, rolling shutters and blur take all."}),
        field("rolling_shutter_s", &C::rolling_shutter_s,
              {.about = "Time from the first row to the last, each seen from its own pose between the last two images. "
                        "Moving objects stand still. Only by ``\"raycast\"``.",
               .unit = "s",
               .limits = between(0, 1)}),
        field("exposure_s", &C::exposure_s,
              {.about = "Time in which the drone's motion blurs the colours of a row. Other outputs show its end. With "
                        "``rolling_shutter_s`` at most the time between images. Only by ``\"raycast\"``.",
               .unit = "s",
               .limits = between(0, 1)}),
        field("blur_samples", &C::blur_samples,
              {.about = "Poses that blurred colours are averaged over, at most 256 / ``samples_per_pixel``.",
               .limits = between(2, kMaxColorSamples)}),
        field("shadows", &C::shadows,
              {.about = "Shadows of the sun, cast by everything except markers and a room's walls and ceiling."}),
        field("sun_size_deg", &C::sun_size_deg,
              {.about = "Angle across the sun, which blurs the edges of shadows. 0: hard shadows. The real sun's is 0.53. Only "
                        "with ``shadows``.",
               .unit = "deg",
               .limits = between(0.0, 20.0)}),
        field("ambient_occlusion_rays", &C::ambient_occlusion_rays,
              {.about = "Rays per sample that darken corners: the light of sky and ground is multiplied by the share of rays "
                        "that hit nothing within 1.5 m. Only by ``\"raycast\"``.",
               .limits = between(0, 16)}),
        field("rate_hz", &C::rate_hz, kSensorRate), field("latency_s", &C::latency_s, kSensorLatency),
        field("jitter_s", &C::jitter_s, kSensorJitter), field("loss", &C::loss, kSensorLoss),
        field("resize", &C::resize,
              {.about = "(width, height) of the written images, at most as rendered. ``fx``, ``fy``, ``cx`` and ``cy`` stay. Not "
                        "with semantic, instance and normal.",
               .unit = "px"}),
        field("pool", &C::pool,
              {.about = "How ``resize`` combines pixels. ``\"mean\"``: by area, like OpenCV's INTER_AREA. "
                        "``\"min\"``, ``\"max\"``: of each channel. Depth with mean or max is inf if any pixel misses, with min "
                        "if all do."}),
        field("depth_errors", &C::depth_errors, {.about = "How planar depths err."}),
        field("color_errors", &C::color_errors, {.about = "How colours err. ``grey`` has noise of its own."}),
        field("event_pixels", &C::event_pixels, {.about = "How pixels count events."}));
  }

  // Returns the depth camera of a product, such as "d435", with its errors; docs/reference/sensors.md lists the products. Throws
  // std::invalid_argument that lists the names.
  FLOCKSTEP_API static CameraConfig preset(std::string_view product);
  // Returns this camera as the left one of a stereo pair, and the right one, baseline_m to its right. Their names end in _left
  // and _right. Throws std::invalid_argument if the baseline is not in (0, 10].
  FLOCKSTEP_API std::array<CameraConfig, 2> stereo_pair(float baseline_m) const;

  // True if images need rays for ambient occlusion or for a sun of some size.
  bool has_soft_light() const { return ambient_occlusion_rays > 0 || sun_size_deg > 0.0F; }
  // True if an image shows more than one pose of the drone.
  bool takes_time() const { return rolling_shutter_s > 0.0F || exposure_s > 0.0F; }
  int num_poses() const { return exposure_s > 0.0F ? blur_samples : 1; }  // that the colours of a row are averaged over
  // True if the camera is not a plain pinhole.
  FLOCKSTEP_API bool has_lens() const;
  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API float fx() const;  // px
  FLOCKSTEP_API float fy() const;  // px
  // Distance between the centre and the corners of the image, in focal lengths.
  FLOCKSTEP_API double corner() const;
  // Size of the written images.
  int image_width_px() const { return resize ? (*resize)[0] : width_px; }
  int image_height_px() const { return resize ? (*resize)[1] : height_px; }  // px
};

// Run-time changes to a camera of some drones; unset fields stay unchanged. All drones have the same resolution.
struct CameraChange {
  std::optional<float> hfov_deg;                  // deg; setting only one of hfov_deg and vfov_deg clears the other
  std::optional<float> vfov_deg;                  // deg
  std::optional<std::array<float, 3>> offset_m;   // m, body frame
  std::optional<std::array<float, 4>> quat_wxyz;  // camera to body
  std::optional<int> width_px;                    // all drones'; moves the arrays of the batch
  std::optional<int> height_px;                   // all drones'; moves the arrays of the batch

  static constexpr auto fields() {
    using C = CameraChange;
    return field_list(field("hfov_deg", &C::hfov_deg), field("vfov_deg", &C::vfov_deg), field("offset_m", &C::offset_m),
                      field("quat_wxyz", &C::quat_wxyz), field("width_px", &C::width_px), field("height_px", &C::height_px));
  }

  bool any() const { return hfov_deg || vfov_deg || offset_m || quat_wxyz; }  // true if a field of single drones is set
};

}  // namespace flockstep
