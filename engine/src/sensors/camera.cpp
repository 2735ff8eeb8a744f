#include "sensors/camera.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>

#include "base/check_fields.hpp"
#include "base/in_world.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/camera.hpp"
#include "prepared/prepared_world.hpp"
#include "render/lens.hpp"
#include "sensors/presets.hpp"

namespace flockstep {
namespace {

// Returns the focal length in pixels for a side with this many pixels.
float focal_length(int pixels, float fov_deg, Projection projection) {
  const double angle = 0.5 * static_cast<double>(fov_deg) * std::numbers::pi / 180.0;
  return static_cast<float>(0.5 * pixels / (projection == Projection::fisheye ? angle : std::tan(angle)));
}

// Checks the projection and its distortion.
void require_lens(const CameraConfig& camera) {
  const bool fisheye = camera.projection == Projection::fisheye;
  const std::size_t count = camera.distortion.size();
  require(count == 0 || count == 4 || (count == 5 && !fisheye), "camera.distortion",
          fisheye ? "4 numbers, k1 to k4, or none" : "5 numbers, k1, k2, p1, p2 and k3, 4 without k3, or none", count);
  require(!fisheye || !camera.outputs.depth || camera.depth_kind == DepthKind::range, "camera.depth_kind",
          "\"range\" with projection=\"fisheye\"", "\"planar\"");
  if (!camera.has_lens()) return;
  constexpr long long kMaxRays = 1LL << 27;
  const long long rays = (1LL + camera.samples_per_pixel) * camera.width_px * camera.height_px;
  require(rays <= kMaxRays, "camera.width_px x height_px", "at most 134217728 rays of all samples with a lens", rays);
  if (render::Lens(camera.projection, camera.distortion, camera.corner()).shows_every_pixel()) return;
  if (count == 0) {
    refuse(camera.vfov_deg && !camera.hfov_deg ? "camera.vfov_deg" : "camera.hfov_deg",
           "an angle that keeps the corners of a fisheye within 180 degrees of the axis",
           camera.hfov_deg.value_or(camera.vfov_deg.value_or(90.0F)));
  }
  refuse("camera.distortion",
         std::string("coefficients that do not fold the image, with rays less than ") + (fisheye ? "180" : "89.5") +
             " degrees from the axis",
         "k1 = " + std::to_string(camera.distortion[0]));
}

}  // namespace

float CameraConfig::fx() const {
  return hfov_deg || !vfov_deg ? focal_length(width_px, hfov_deg.value_or(90.0F), projection) : fy();
}

float CameraConfig::fy() const { return vfov_deg ? focal_length(height_px, *vfov_deg, projection) : fx(); }

double CameraConfig::corner() const {
  return std::hypot(0.5 * width_px / static_cast<double>(fx()), 0.5 * height_px / static_cast<double>(fy()));
}

bool CameraConfig::has_lens() const {
  return projection == Projection::fisheye || std::ranges::any_of(distortion, [](float k) { return k != 0.0F; });
}

void DepthErrors::validate() const { check_fields(*this, "camera.depth_errors."); }

void ColorErrors::validate() const { check_fields(*this, "camera.color_errors."); }

void CameraConfig::validate() const {
  check_fields(*this, "camera.");
  // Checks both fields of view, since one may be derived from the other.
  for (const float slope : {0.5F * static_cast<float>(width_px) / fx(), 0.5F * static_cast<float>(height_px) / fy()}) {
    require(slope < 115.0F || projection == Projection::fisheye, hfov_deg ? "camera.hfov_deg" : "camera.vfov_deg",
            "an angle that keeps the other below 179 degrees (pixels are square)",
            hfov_deg ? *hfov_deg : vfov_deg.value_or(90.0F));
  }
  require_lens(*this);
  require(far_m > near_m, "camera.far_m", "a number > near_m (" + std::to_string(near_m) + ")", far_m);
  require(samples_per_pixel * num_poses() <= kMaxColorSamples, "camera.blur_samples",
          "at most 256 / samples_per_pixel (" + std::to_string(kMaxColorSamples / samples_per_pixel) + ")", blur_samples);
  require(shadows || sun_size_deg == 0.0F, "camera.sun_size_deg", "0 without shadows", sun_size_deg);
  bool any = false;
  for_each_field(outputs, [&](const auto&, bool chosen) { any = any || chosen; });
  require(any, "camera.outputs", "at least one of rgb, depth, semantic, instance, normal, grey, hsv, events", "none");
  if (depth_errors != DepthErrors()) {
    require(outputs.depth, "camera.depth_errors", "DepthErrors() without the output depth", "others");
    require(depth_kind == DepthKind::planar, "camera.depth_kind", "\"planar\" with depth_errors", "\"range\"");
    require(depth_errors.min_range_m < far_m, "camera.depth_errors.min_range_m", "less than camera.far_m",
            depth_errors.min_range_m);
  }
  require(outputs.any_color() || outputs.hsv || outputs.events || color_errors == ColorErrors(), "camera.color_errors",
          "ColorErrors() without an output rgb, grey, hsv or events", "others");
  if (!resize) {
    require(pool == Pool::mean, "camera.pool", "\"mean\" without resize (set resize=(width, height) of the images)",
            std::string("\"") + EnumNames<Pool>::kNames[static_cast<std::size_t>(pool)] + '"');
    return;
  }
  const std::string size = "(" + std::to_string((*resize)[0]) + ", " + std::to_string((*resize)[1]) + ")";
  require((*resize)[0] >= 1 && (*resize)[0] <= width_px && (*resize)[1] >= 1 && (*resize)[1] <= height_px, "camera.resize",
          "width and height in [1, " + std::to_string(width_px) + "] and [1, " + std::to_string(height_px) + "]", size);
  for (const auto& [output, chosen] :
       {std::pair("semantic", outputs.semantic), std::pair("instance", outputs.instance), std::pair("normal", outputs.normal)}) {
    require(!chosen, "camera.resize",
            std::string("None with the output ") + output + " (ids and directions cannot be averaged: use a second camera)",
            size);
  }
}

// docs/reference/sensors.md has the sources of the numbers.
CameraConfig CameraConfig::preset(std::string_view product) {
  constexpr CameraOutputs kDepth{.rgb = false, .depth = true};
  // A RealSense. Its greatest disparity is 126 px, which limits the range.
  const auto realsense = [&](const char* name, float baseline_m) {
    CameraConfig camera{.name = name, .width_px = 848, .height_px = 480, .hfov_deg = 87.0F, .far_m = 10.0F, .outputs = kDepth};
    camera.depth_errors = {.baseline_m = baseline_m,
                           .focal_px = camera.fx(),
                           .edge_shadow = true,
                           .blotches = 0.02F,
                           .blotch_size_px = 40.0F,
                           .disparity_noise_px = 0.1F,
                           .disparity_step_px = 1.0F / 32,
                           .min_range_m = camera.fx() * baseline_m / 126,
                           .dropout = 0.01F,
                           .hole_m = 0.0F};
    return camera;
  };
  CameraConfig kinect{.name = "kinect", .width_px = 640, .height_px = 480, .hfov_deg = 57.0F, .far_m = 5.0F, .outputs = kDepth};
  kinect.depth_errors = {.baseline_m = 0.075F,
                         .focal_px = kinect.fx(),
                         .edge_shadow = true,
                         .blotches = 0.02F,
                         .blotch_size_px = 40.0F,
                         .disparity_noise_px = 1.0F / 48,  // a sixth of a step
                         .disparity_step_px = 1.0F / 8,
                         .min_range_m = 0.5F,
                         .hole_m = 0.0F};
  CameraConfig tof{.name = "tof", .width_px = 224, .height_px = 172, .hfov_deg = 56.0F, .far_m = 4.0F, .outputs = kDepth};
  tof.depth_errors = {.noise_std_m = 0.0053F, .min_range_m = 0.1F, .dropout = 0.01F, .hole_m = 0.0F};
  const std::array presets{realsense("d435", 0.05F), realsense("d455", 0.095F), kinect, tof};
  return sensors::preset_named(product, presets, "CameraConfig.preset");
}

std::array<CameraConfig, 2> CameraConfig::stereo_pair(float baseline_m) const {
  check_number(baseline_m, kFields<DepthErrors>.get<0>().info.limits, "baseline_m");
  validate();  // the rotation is one
  std::array<CameraConfig, 2> pair{*this, *this};
  const Quat rotation = Quat(quat_wxyz[0], quat_wxyz[1], quat_wxyz[2], quat_wxyz[3]).normalized();
  Vec3::Map(pair[1].offset_m.data()) -= rotation * Vec3(0, baseline_m, 0);
  pair[0].name += "_left";
  pair[1].name += "_right";
  return pair;
}

}  // namespace flockstep

namespace flockstep::sensors {
namespace {

Mat3 matrix_of(const std::array<float, 4>& q) { return Quat(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix(); }

std::size_t area(int width, int height) { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }

// Returns the part of the configuration that the renderer handles.
CameraConfig rendering_of(CameraConfig config) {
  config.resize.reset();
  config.outputs.rgb = config.outputs.rgb || config.outputs.hsv;
  config.outputs.grey = config.outputs.grey || config.outputs.events;
  config.outputs.hsv = config.outputs.events = false;
  return config;
}

// Allocates the images of the outputs, filled with absent values.
void allocate_images(CameraImages& images, const CameraOutputs& outputs, std::size_t num_drones, std::size_t pixels) {
  const ArraySizes sizes{.num_drones = num_drones, .num_pixels = pixels};
  for_each_output(images, outputs, [&](const auto& entry, auto& image) { flockstep::allocate(entry, image, sizes); });
}

}  // namespace

Camera::Camera(const CameraConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones,
               TracerKind tracer)
    : Sensor("camera", config.name, config.rate_hz, clock),
      config_(config),
      rendering_(rendering_of(config)),
      policy_(trace::trace_policy_of(tracer, area(config.width_px, config.height_px))),
      drones_per_env_(drones_per_env),
      pixels_(area(config.image_width_px(), config.image_height_px())),
      rendered_pixels_(area(config.width_px, config.height_px)),
      settings_(config, num_drones, false, &render::make_camera_optics),
      mounting_(num_drones, matrix_of(config.quat_wxyz)),
      motion_(config.takes_time() ? num_drones : 0),
      ticks_hz_(static_cast<float>(clock.ticks_hz())),
      delay_(config, label(), 0, clock, drones_per_env, num_drones),  // frames are taken after steps, whatever the rate
      has_depth_errors_(config.depth_errors != DepthErrors()),
      has_color_errors_(config.color_errors != ColorErrors()),
      errors_(stream_named("errors of " + label())),
      blotch_threshold_(blotch_threshold(config.depth_errors.blotches)),
      color_levels_(has_color_errors_ ? make_levels(config.color_errors) : std::vector<std::uint8_t>()) {
  // Triangles are traced in tiles of 16 x 16 rays ahead only.
  if (config.projection == Projection::fisheye || config.rolling_shutter_s > 0.0F) policy_.tile_triangle_limit = 0;
  flockstep::allocate(taken_, {.num_drones = num_drones});
  allocate_images(images_, config.outputs, num_drones, pixels_);
  if (config.resize) {
    resample_.emplace(config.width_px, config.height_px, (*config.resize)[0], (*config.resize)[1], config.pool);
    allocate_images(frames_, rendering_.outputs, num_drones, rendered_pixels_);
  } else {
    if (config.outputs.hsv && !config.outputs.rgb) frames_.rgb.resize(3 * num_drones * rendered_pixels_);
    if (config.outputs.events && !config.outputs.grey) frames_.grey.resize(num_drones * rendered_pixels_);
  }
  if (config.outputs.events) {
    events_.emplace(config.event_pixels, pixels_, config.layout, label(), clock, drones_per_env, num_drones);
  }
  images_.frame_step.resize(num_drones, -1);
  images_.age_s.resize(num_drones);
  if (is_late()) rings_.allocate(images_, num_drones, delay_.num_rows());
}

CameraConfig Camera::config_of(DroneIndex drone) const {
  CameraConfig config = settings_.config_of(drone);
  config.capture_mode = config_.capture_mode;
  return config;
}

void Camera::set_config(DroneIndex drone, const CameraConfig& config) {
  settings_.set(drone, config);
  mounting_[drone] = matrix_of(config.quat_wxyz);
  mark_stale(drone);
}

void Camera::change(const CameraChange& change, std::span<const DroneIndex> drones) {
  const auto changed = [&](CameraConfig config) {
    if (change.hfov_deg || change.vfov_deg) {
      config.hfov_deg = change.hfov_deg;
      config.vfov_deg = change.vfov_deg;
    }
    config.offset_m = change.offset_m.value_or(config.offset_m);
    config.quat_wxyz = change.quat_wxyz.value_or(config.quat_wxyz);
    return config;
  };
  changed(config_).validate();  // checked even if no drone is listed, as with LiDARs
  if (!change.any()) return;
  for (const DroneIndex drone : drones) set_config(drone, changed(config_of(drone)));
}

void Camera::clear(DroneIndex drone) {
  for_each_output(images_, config_.outputs, [&]<class Image>(const auto& entry, Image& image) {
    const std::size_t width = ArraySizes{.num_pixels = pixels_}.width(entry.info);
    std::fill_n(image.data() + drone * width, width, absent_value<typename Image::value_type>(entry.info));
  });
  mark_stale(drone);
}

bool Camera::is_due(DroneIndex drone, const State& state, std::uint64_t seen) const {
  const std::size_t env = drone / drones_per_env_;
  switch (config_.capture_mode) {
    case CaptureMode::every_step:
      // With a rate: due if a multiple of the period has passed since the last frame.
      return period() == 0 || images_.frame_step[drone] < 0 || state.tick[env] / period() != taken_.tick[drone] / period();
    case CaptureMode::on_movement:
      return images_.frame_step[drone] < 0 || taken_.world[drone] != state.world_index[env] ||
             !std::equal(&taken_.position[3 * drone], &taken_.position[3 * drone] + 3, &state.position[3 * drone]) ||
             !std::equal(&taken_.quat_wxyz[4 * drone], &taken_.quat_wxyz[4 * drone] + 4, &state.quat_wxyz[4 * drone]) ||
             (bodies_per_env_ > 0 && taken_.bodies[drone] != state.bodies.changes[env]) ||
             taken_.drones[drone] != static_cast<std::int64_t>(seen);
    default:
      return false;
  }
}

std::optional<render::RenderRequest> Camera::take(DroneIndex drone, const World& world, const State& state, std::uint64_t seen) {
  const std::size_t env = drone / drones_per_env_;
  const Pose pose = pose_of(state, drone);
  taken_.tick[drone] = state.tick[env];
  if (config_.takes_time()) motion_.add(drone, pose, state.tick[env]);
  if (is_late() && !delay_.add(state, drone)) return std::nullopt;
  if (events_) events_->take(drone, state);
  store_pose(&taken_.position[3 * drone], &taken_.quat_wxyz[4 * drone], pose);
  taken_.world[drone] = state.world_index[env];
  if (bodies_per_env_ > 0) taken_.bodies[drone] = state.bodies.changes[env];
  taken_.drones[drone] = static_cast<std::int64_t>(seen);
  written().frame_step[row_of(drone)] = std::max<std::int64_t>(state.sensed[env], 0);
  return request(drone, world, pose);
}

void Camera::publish_arrived(DroneIndex drone, std::int64_t tick) {
  const std::optional<std::size_t> row = delay_.arrived(drone, tick);
  if (!row) return;
  rings_.get(*row, images_, drone);
  images_.age_s[drone] = delay_.age_s(*row, tick);
}

render::RenderRequest Camera::retake(DroneIndex drone, const World& world) {
  const float* const p = &taken_.position[3 * drone];
  const float* const q = &taken_.quat_wxyz[4 * drone];
  return request(drone, world, {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])});
}

render::RenderRequest Camera::request(DroneIndex drone, const World& world, const Pose& pose) {
  const render::Mount mount{Vec3::Map(settings_[drone].offset_m.data()), mounting_[drone]};
  const auto [position, rotation] = mount.on(pose);
  render::RenderRequest request{.world = &world,
                                .scene = &prepared(world).scene(),
                                .shading = &prepared(world).shading(config_.shadows),
                                .camera = &rendering_,
                                .optics = &settings_.optics(drone),
                                .position = position,
                                .rotation = rotation,
                                .frame = {},
                                .policy = policy_,
                                .bodies = bodies_.of_env(drone / drones_per_env_, bodies_per_env_),
                                .drones = drones_.seen_by(drone, drones_per_env_)};
  request.frame = targets(drone);
  if (config_.takes_time()) {
    request.exposure = render::Exposure{.path = motion_.path_of(drone, pose, taken_.tick[drone]),
                                        .mount = mount,
                                        .rolling_ticks = config_.rolling_shutter_s * ticks_hz_,
                                        .row_ticks = config_.exposure_s * ticks_hz_,
                                        .rows = config_.height_px,
                                        .poses = config_.num_poses()};
  }
  return request;
}

render::RenderTargets Camera::targets(DroneIndex drone) {
  // Frames are rendered directly into the camera's images, unless they must be resized or only hsv is written.
  const auto image = [&](auto CameraImages::* output, std::size_t values) {
    const bool is_direct = (frames_.*output).empty() && !resample_;
    auto& frames = is_direct ? written().*output : frames_.*output;
    return frames.empty() ? nullptr
                          : frames.data() + (is_direct ? row_of(drone) : std::size_t{drone}) * rendered_pixels_ * values;
  };
  return {.rgb = image(&CameraImages::rgb, 3),
          .depth = image(&CameraImages::depth, 1),
          .semantic = image(&CameraImages::semantic, 1),
          .instance = image(&CameraImages::instance, 1),
          .normal = image(&CameraImages::normal, 3),
          .grey = image(&CameraImages::grey, 1)};
}

// Errors are added in place: nothing reads the exact images, so that they need no memory of their own.
void Camera::add_errors(DroneIndex drone, const State& state, ConversionScratch& scratch) {
  const render::RenderTargets frame = targets(drone);
  const render::CameraOptics& optics = settings_.optics(drone);
  const auto reading = static_cast<std::uint32_t>(written().frame_step[row_of(drone)]);
  const auto first = static_cast<std::uint32_t>(4 * rendered_pixels_) * reading;  // more draws than any of the errors uses
  const auto draw = [&](std::uint32_t number) {
    return input_of_draw(state, RandomKey::of(drone, drones_per_env_), errors_, first, number);
  };
  const auto width = static_cast<std::size_t>(config_.width_px), height = static_cast<std::size_t>(config_.height_px);
  if (has_depth_errors_) {
    add_depth_errors(config_.depth_errors, blotch_threshold_,
                     {.depths = {frame.depth, rendered_pixels_}, .width = width, .fx = optics.fx, .far_m = config_.far_m},
                     draw(0), draw(1), scratch.depth_errors);
  }
  if (!has_color_errors_) return;
  const auto add = [&](std::uint8_t* values, std::size_t planes, std::size_t channels, std::uint32_t number) {
    if (values == nullptr) return;
    add_color_errors(config_.color_errors, color_levels_, optics,
                     {.values = values, .width = width, .height = height, .planes = planes, .channels = channels}, draw(number),
                     scratch.color_errors);
  };
  const bool apart = config_.layout == ImageLayout::chw;
  add(frame.rgb, apart ? 3 : 1, apart ? 1 : 3, 2);
  add(frame.grey, 1, 1, 3);
}

void Camera::convert(DroneIndex drone, const State& state, ConversionScratch& scratch) {
  if (errs()) add_errors(drone, state, scratch);
  if (!resample_ && !config_.outputs.hsv && !events_) return;
  CameraImages& images = written();
  const auto of_row = [&](auto& image, std::size_t values) { return image.data() + row_of(drone) * pixels_ * values; };
  const auto rendered = [&](auto& images, std::size_t values) { return images.data() + drone * rendered_pixels_ * values; };
  std::uint8_t* rgb = config_.outputs.rgb ? of_row(images.rgb, 3) : nullptr;
  if (resample_) {
    if (config_.outputs.depth) (*resample_)(rendered(frames_.depth, 1), of_row(images.depth, 1), 1, scratch.resample);
    if (config_.outputs.grey) (*resample_)(rendered(frames_.grey, 1), of_row(images.grey, 1), 1, scratch.resample);
    if (rendering_.outputs.rgb) {
      if (rgb == nullptr) {
        scratch.rgb.resize(3 * pixels_);
        rgb = scratch.rgb.data();
      }
      const std::uint8_t* const frame = rendered(frames_.rgb, 3);
      const bool apart = config_.layout == ImageLayout::chw;  // three images of one channel
      for (std::size_t plane = 0; plane < (apart ? 3U : 1U); ++plane) {
        (*resample_)(frame + plane * rendered_pixels_, rgb + plane * pixels_, apart ? 1 : 3, scratch.resample);
      }
    }
  } else if (rgb == nullptr) {
    rgb = rendered(frames_.rgb, 3);
  }
  if (config_.outputs.hsv) {
    imaging::rgb_to_hsv(rgb, config_.image_width_px(), config_.image_height_px(), config_.layout, of_row(images.hsv, 3),
                        scratch.hsv);
  }
  if (events_) {
    const std::uint8_t* grey = config_.outputs.grey ? of_row(images.grey, 1) : rendered(frames_.grey, 1);
    if (resample_ && !config_.outputs.grey) {
      scratch.grey.resize(pixels_);
      (*resample_)(rendered(frames_.grey, 1), scratch.grey.data(), 1, scratch.resample);
      grey = scratch.grey.data();
    }
    events_->write(drone, state, grey, of_row(images.events, 2));
  }
}

void Camera::list_arrays(const std::function<void(const ArrayView&)>& list) const {
  for_each_view(images_, items_of(config_), [&](const ArrayView& image) {
    if (image.size > 0) list(image);
  });
}

void Camera::visit(ArrayVisitor& visitor) {
  mode_ = {config_.capture_mode};
  visitor.array("camera_capture_mode", mode_);
  settings_.visit(label(), visitor);
  visitor.fields(taken_);
  visitor.array("frame_step", images_.frame_step);
  visitor.array("frame_age_s", images_.age_s);
  if (is_late()) rings_.visit(visitor);
  delay_.visit(visitor);
  if (events_) events_->visit(visitor);
  if (config_.takes_time()) motion_.visit(visitor);
  if (keeps_images()) visit_images(visitor);
}

void Camera::visit_images(ArrayVisitor& visitor) {
  for_each_output(images_, config_.outputs, [&](const auto& entry, auto& image) { visitor.array(entry.name, image); });
}

void Camera::restored() {
  config_.capture_mode = mode_.at(0);
  settings_.restored();
  for (std::size_t i = 0; i < settings_.size(); ++i) mounting_[i] = matrix_of(settings_[DroneIndex(i)].quat_wxyz);
}

void Camera::check() const {
  delay_.check();
  if (events_) events_->check();
  motion_.check();
  check_values(std::span<const float>(images_.age_s), "snapshot: frame_age_s", Values::finite);
  for (std::size_t i = 0; i < settings_.size(); ++i) {
    const DroneIndex drone(i);
    const std::int64_t step = images_.frame_step[drone];
    require(step >= -1 && step <= std::int64_t{1} << 62, "snapshot: frame_step", "a number in [-1, 2^62]", step);
    require(taken_.tick[drone] >= 0, "snapshot: taken_tick", "a number >= 0", taken_.tick[drone]);
    if (step < 0) continue;  // stale frames are not rendered again
    const float* const p = &taken_.position[3 * drone];
    const float* const q = &taken_.quat_wxyz[4 * drone];
    if (!is_in_world(Vec3(p[0], p[1], p[2]))) refuse("snapshot: taken_position", in_world("finite coordinates"), p[0]);
    const float norm = Quat(q[0], q[1], q[2], q[3]).norm();
    require(std::abs(norm - 1.0F) < 1e-2F, "snapshot: taken_quat_wxyz", "unit quaternions", norm);
  }
}

}  // namespace flockstep::sensors
