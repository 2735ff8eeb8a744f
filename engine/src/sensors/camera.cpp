#include "sensors/camera.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "base/pose_access.hpp"
#include "base/require.hpp"
#include "compiled/compiled_world.hpp"
#include "sensors/rate.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::sensors {
namespace {

Mat3 matrix_of(const std::array<float, 4>& q) { return Quat(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix(); }

Vec3 vector_of(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

// f(array, values per pixel) for every image of the camera.
template <class F>
void for_each_image(CameraImages& images, const F& f) {
  f(images.rgb, 3U);
  f(images.depth, 1U);
  f(images.semantic, 1U);
  f(images.instance, 1U);
  f(images.normal, 3U);
  f(images.grey, 1U);
  f(images.hsv, 3U);
}

std::size_t area(int width, int height) { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }

// The renderer's part of a camera.
CameraConfig rendering_of(CameraConfig config) {
  config.resize.reset();
  config.outputs.rgb = config.outputs.rgb || config.outputs.hsv;
  config.outputs.hsv = false;
  return config;
}

// Room for the images of some outputs. Nothing is seen yet.
void allocate(CameraImages& images, const CameraOutputs& outputs, std::size_t pixels) {
  if (outputs.rgb) images.rgb.resize(3 * pixels);
  if (outputs.depth) images.depth.resize(pixels, std::numeric_limits<float>::infinity());
  if (outputs.semantic) images.semantic.resize(pixels);
  if (outputs.instance) images.instance.resize(pixels);
  if (outputs.normal) images.normal.resize(3 * pixels);
  if (outputs.grey) images.grey.resize(pixels);
  if (outputs.hsv) images.hsv.resize(3 * pixels);
}

}  // namespace

Camera::Camera(const CameraConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones,
               TracerKind tracer)
    : config_(config),
      rendering_(rendering_of(config)),
      ways_(trace::ways_of(tracer, area(config.width_px, config.height_px))),
      period_(period_in_ticks(config.rate_hz, clock, "camera.rate_hz")),
      drones_per_env_(drones_per_env),
      pixels_(area(config.image_width_px(), config.image_height_px())),
      rendered_pixels_(area(config.width_px, config.height_px)),
      setting_(num_drones, 0U),
      offset_(num_drones, vector_of(config.offset_m)),
      mounting_(num_drones, matrix_of(config.quat_wxyz)),
      quat_wxyz_(num_drones, config.quat_wxyz) {
  settings_.push_back(
      std::make_unique<Setting>(Setting{config.hfov_deg, config.vfov_deg, render::make_pinhole_camera(config), num_drones}));
  taken_.position.resize(3 * num_drones);
  taken_.quat_wxyz.resize(4 * num_drones);
  taken_.world.resize(num_drones);
  taken_.tick.resize(num_drones);
  allocate(images_, config.outputs, num_drones * pixels_);
  if (config.resize) {
    resample_.emplace(config.width_px, config.height_px, (*config.resize)[0], (*config.resize)[1], config.pool);
    allocate(frames_, rendering_.outputs, num_drones * rendered_pixels_);
  } else if (config.outputs.hsv && !config.outputs.rgb) {
    frames_.rgb.resize(3 * num_drones * rendered_pixels_);
  }
  images_.frame_step.resize(num_drones, -1);
}

CameraConfig Camera::config_of(DroneIndex drone) const {
  CameraConfig config = config_;
  config.hfov_deg = settings_[setting_[drone]]->hfov_deg;
  config.vfov_deg = settings_[setting_[drone]]->vfov_deg;
  config.offset_m = {offset_[drone].x(), offset_[drone].y(), offset_[drone].z()};
  config.quat_wxyz = quat_wxyz_[drone];
  return config;
}

void Camera::set_config(DroneIndex drone, const CameraConfig& config) {
  const auto find = [&](const auto& wanted) { return std::find_if(settings_.begin(), settings_.end(), wanted); };
  auto setting =
      find([&](const auto& other) { return other->hfov_deg == config.hfov_deg && other->vfov_deg == config.vfov_deg; });
  if (setting == settings_.end()) {
    Setting made{config.hfov_deg, config.vfov_deg, render::make_pinhole_camera(config), 0};
    setting = find([](const auto& other) { return other->drones == 0; });
    if (setting == settings_.end()) setting = settings_.insert(setting, std::make_unique<Setting>());
    **setting = std::move(made);
  }
  ++(*setting)->drones;
  --settings_[setting_[drone]]->drones;
  setting_[drone] = static_cast<std::uint32_t>(setting - settings_.begin());
  offset_[drone] = vector_of(config.offset_m);
  mounting_[drone] = matrix_of(config.quat_wxyz);
  quat_wxyz_[drone] = config.quat_wxyz;
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
  changed(config_).validate();  // as with LiDARs: also where no drone is listed
  if (!change.any()) return;
  for (const DroneIndex drone : drones) set_config(drone, changed(config_of(drone)));
}

void Camera::clear(DroneIndex drone) {
  for_each_image(images_, [&](auto& image, std::size_t values) {
    using Value = typename std::remove_reference_t<decltype(image)>::value_type;
    const bool is_depth = static_cast<const void*>(&image) == &images_.depth;
    const Value nothing = is_depth ? static_cast<Value>(std::numeric_limits<float>::infinity()) : Value{};
    if (!image.empty()) std::fill_n(image.data() + drone * pixels_ * values, pixels_ * values, nothing);
  });
  mark_stale(drone);
}

bool Camera::is_due(DroneIndex drone, const State& state) const {
  const std::size_t env = drone / drones_per_env_;
  switch (config_.capture_mode) {
    case CaptureMode::every_step:
      // With a rate: where a multiple of the period has passed since the last frame.
      return period_ == 0 || images_.frame_step[drone] < 0 || state.tick[env] / period_ != taken_.tick[drone] / period_;
    case CaptureMode::on_movement:
      return images_.frame_step[drone] < 0 || taken_.world[drone] != state.world_index[env] ||
             !std::equal(&taken_.position[3 * drone], &taken_.position[3 * drone] + 3, &state.position[3 * drone]) ||
             !std::equal(&taken_.quat_wxyz[4 * drone], &taken_.quat_wxyz[4 * drone] + 4, &state.quat_wxyz[4 * drone]);
    default:
      return false;
  }
}

render::RenderRequest Camera::take(DroneIndex drone, const World& world, const State& state) {
  const std::size_t env = drone / drones_per_env_;
  const Pose pose = pose_of(state, drone);
  store_pose(&taken_.position[3 * drone], &taken_.quat_wxyz[4 * drone], pose);
  taken_.world[drone] = state.world_index[env];
  taken_.tick[drone] = state.tick[env];
  images_.frame_step[drone] = std::max<std::int64_t>(state.sensed[env], 0);
  return request(drone, world, pose);
}

render::RenderRequest Camera::retake(DroneIndex drone, const World& world) {
  const float* const p = &taken_.position[3 * drone];
  const float* const q = &taken_.quat_wxyz[4 * drone];
  return request(drone, world, {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])});
}

render::RenderRequest Camera::request(DroneIndex drone, const World& world, const Pose& pose) {
  const Mat3 body = pose.rotation.toRotationMatrix();
  Mat3 rotation;
  for (int axis = 0; axis < 3; ++axis) rotation.col(axis) = trace::rotated(body, mounting_[drone].col(axis));
  render::RenderRequest request{.world = &world,
                                .scene = &compiled(world).scene(),
                                .shading = &compiled(world).shading(config_.shadows),
                                .camera = &rendering_,
                                .pinhole = &settings_[setting_[drone]]->pinhole,
                                .position = pose.position + trace::rotated(body, offset_[drone]),
                                .rotation = rotation,
                                .frame = {},
                                .ways = ways_};
  // A frame is rendered into the camera's images, unless it has to be converted first.
  const auto image = [&](auto CameraImages::* output, std::size_t values) {
    auto& frames = (frames_.*output).empty() && !resample_ ? images_.*output : frames_.*output;
    return frames.empty() ? nullptr : frames.data() + drone * rendered_pixels_ * values;
  };
  request.frame = {.rgb = image(&CameraImages::rgb, 3),
                   .depth = image(&CameraImages::depth, 1),
                   .semantic = image(&CameraImages::semantic, 1),
                   .instance = image(&CameraImages::instance, 1),
                   .normal = image(&CameraImages::normal, 3),
                   .grey = image(&CameraImages::grey, 1)};
  return request;
}

void Camera::convert(DroneIndex drone, ConversionScratch& scratch) {
  const auto written = [&](auto& images, std::size_t values) { return images.data() + drone * pixels_ * values; };
  const auto rendered = [&](auto& images, std::size_t values) { return images.data() + drone * rendered_pixels_ * values; };
  std::uint8_t* rgb = config_.outputs.rgb ? written(images_.rgb, 3) : nullptr;
  if (resample_) {
    if (config_.outputs.depth) (*resample_)(rendered(frames_.depth, 1), written(images_.depth, 1), 1, scratch.resample);
    if (config_.outputs.grey) (*resample_)(rendered(frames_.grey, 1), written(images_.grey, 1), 1, scratch.resample);
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
    imaging::rgb_to_hsv(rgb, config_.image_width_px(), config_.image_height_px(), config_.layout, written(images_.hsv, 3),
                        scratch.hsv);
  }
}

void Camera::visit(ArrayVisitor& visitor) {
  saved_.clear();
  for (std::size_t i = 0; i < setting_.size(); ++i) {
    const DroneIndex drone(i);
    const CameraConfig config = config_of(drone);
    saved_.push_back({config.hfov_deg.value_or(0.0F), config.vfov_deg.value_or(0.0F), config.offset_m, config.quat_wxyz});
  }
  mode_ = {config_.capture_mode};
  visitor.array("camera_capture_mode", mode_);
  visitor.array("camera_settings", saved_);
  visitor.fields(taken_);
  visitor.array("frame_step", images_.frame_step);
}

CameraConfig Camera::with(const Saved& saved) const {
  CameraConfig config = config_;
  config.hfov_deg = saved.hfov_deg > 0.0F ? std::optional(saved.hfov_deg) : std::nullopt;
  config.vfov_deg = saved.vfov_deg > 0.0F ? std::optional(saved.vfov_deg) : std::nullopt;
  config.offset_m = saved.offset_m;
  config.quat_wxyz = saved.quat_wxyz;
  return config;
}

void Camera::check_restored(std::span<const std::byte> settings) const {
  for (std::size_t at = 0; at < settings.size(); at += sizeof(Saved)) {
    Saved saved;
    std::memcpy(&saved, settings.data() + at, sizeof(saved));
    with(saved).validate();
  }
}

void Camera::restored() {
  config_.capture_mode = mode_.at(0);
  const std::vector<std::int64_t> frame_step = images_.frame_step;  // a change of the setting would make frames stale
  for (std::size_t i = 0; i < saved_.size(); ++i) set_config(DroneIndex(i), with(saved_[i]));
  std::copy(frame_step.begin(), frame_step.end(), images_.frame_step.begin());
  saved_ = {};
}

void Camera::check() const {
  for (std::size_t i = 0; i < setting_.size(); ++i) {
    const DroneIndex drone(i);
    const std::int64_t step = images_.frame_step[drone];
    require(step >= -1 && step <= std::int64_t{1} << 62, "snapshot: frame_step", "a number in [-1, 2^62]", step);
    require(taken_.tick[drone] >= 0, "snapshot: taken_tick", "a number >= 0", taken_.tick[drone]);
    if (step < 0) continue;  // stale: it is not rendered again
    const float* const p = &taken_.position[3 * drone];
    const float* const q = &taken_.quat_wxyz[4 * drone];
    require(is_in_world(Vec3(p[0], p[1], p[2])), "snapshot: taken_position", "finite coordinates within +-1e+06 m", p[0]);
    const float norm = Quat(q[0], q[1], q[2], q[3]).norm();
    require(std::abs(norm - 1.0F) < 1e-2F, "snapshot: taken_quat_wxyz", "unit quaternions", norm);
  }
}

}  // namespace flockstep::sensors
