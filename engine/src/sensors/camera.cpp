#include "sensors/camera.hpp"

#include <algorithm>
#include <limits>

#include "base/pose_access.hpp"
#include "compiled/compiled_world.hpp"
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
}

}  // namespace

Camera::Camera(const CameraConfig& config, std::size_t num_drones)
    : config_(&config),
      setting_(num_drones, 0U),
      offset_(num_drones, vector_of(config.offset_m)),
      mounting_(num_drones, matrix_of(config.quat_wxyz)),
      quat_wxyz_(num_drones, config.quat_wxyz) {
  settings_.push_back(
      std::make_unique<Setting>(Setting{config.hfov_deg, config.vfov_deg, render::make_pinhole_camera(config), num_drones}));
  taken_.position.resize(3 * num_drones);
  taken_.quat_wxyz.resize(4 * num_drones);
  taken_.world.resize(num_drones);
  const std::size_t pixels = num_drones * static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px);
  const CameraOutputs& outputs = config.outputs;
  if (outputs.rgb) images_.rgb.resize(3 * pixels);
  if (outputs.depth) images_.depth.resize(pixels, std::numeric_limits<float>::infinity());
  if (outputs.semantic) images_.semantic.resize(pixels);
  if (outputs.instance) images_.instance.resize(pixels);
  if (outputs.normal) images_.normal.resize(3 * pixels);
  if (outputs.grey) images_.grey.resize(pixels);
  images_.frame_step.resize(num_drones, -1);
}

CameraConfig Camera::config_of(std::size_t drone) const {
  CameraConfig config = *config_;
  config.hfov_deg = settings_[setting_[drone]]->hfov_deg;
  config.vfov_deg = settings_[setting_[drone]]->vfov_deg;
  config.offset_m = {offset_[drone].x(), offset_[drone].y(), offset_[drone].z()};
  config.quat_wxyz = quat_wxyz_[drone];
  return config;
}

void Camera::set_config(std::size_t drone, const CameraConfig& config) {
  --settings_[setting_[drone]]->drones;
  const auto find = [&](const auto& wanted) { return std::find_if(settings_.begin(), settings_.end(), wanted); };
  auto setting =
      find([&](const auto& other) { return other->hfov_deg == config.hfov_deg && other->vfov_deg == config.vfov_deg; });
  if (setting == settings_.end()) {
    setting = find([](const auto& other) { return other->drones == 0; });
    if (setting == settings_.end()) setting = settings_.insert(setting, std::make_unique<Setting>());
    **setting = {config.hfov_deg, config.vfov_deg, render::make_pinhole_camera(config), 0};
  }
  ++(*setting)->drones;
  setting_[drone] = static_cast<std::uint32_t>(setting - settings_.begin());
  offset_[drone] = vector_of(config.offset_m);
  mounting_[drone] = matrix_of(config.quat_wxyz);
  quat_wxyz_[drone] = config.quat_wxyz;
  mark_stale(drone);
}

void Camera::clear(std::size_t drone) {
  const std::size_t pixels = static_cast<std::size_t>(config_->width_px) * static_cast<std::size_t>(config_->height_px);
  for_each_image(images_, [&](auto& image, std::size_t values) {
    using Value = typename std::remove_reference_t<decltype(image)>::value_type;
    const bool is_depth = static_cast<const void*>(&image) == &images_.depth;
    const Value nothing = is_depth ? static_cast<Value>(std::numeric_limits<float>::infinity()) : Value{};
    if (!image.empty()) std::fill_n(image.data() + drone * pixels * values, pixels * values, nothing);
  });
  mark_stale(drone);
}

bool Camera::is_due(std::size_t drone, const State& state) const {
  switch (config_->capture_mode) {
    case CaptureMode::every_step:
      return true;
    case CaptureMode::on_movement:
      return images_.frame_step[drone] < 0 || taken_.world[drone] != state.world_index[drone] ||
             !std::equal(&taken_.position[3 * drone], &taken_.position[3 * drone] + 3, &state.position[3 * drone]) ||
             !std::equal(&taken_.quat_wxyz[4 * drone], &taken_.quat_wxyz[4 * drone] + 4, &state.quat_wxyz[4 * drone]);
    default:
      return false;
  }
}

render::RenderRequest Camera::take(std::size_t drone, const World& world, std::int64_t step, const State& state) {
  const Pose pose = pose_of(state, drone);
  store_pose(&taken_.position[3 * drone], &taken_.quat_wxyz[4 * drone], pose);
  taken_.world[drone] = state.world_index[drone];
  images_.frame_step[drone] = step;
  return request(drone, world, pose);
}

render::RenderRequest Camera::retake(std::size_t drone, const World& world) {
  const float* const p = &taken_.position[3 * drone];
  const float* const q = &taken_.quat_wxyz[4 * drone];
  return request(drone, world, {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])});
}

render::RenderRequest Camera::request(std::size_t drone, const World& world, const Pose& pose) {
  const Mat3 body = pose.rotation.toRotationMatrix();
  Mat3 rotation;
  for (int axis = 0; axis < 3; ++axis) rotation.col(axis) = trace::rotated(body, mounting_[drone].col(axis));
  render::RenderRequest request{.world = &world,
                                .scene = &compiled(world).scene(),
                                .shading = &compiled(world).shading(),
                                .camera = config_,
                                .pinhole = &settings_[setting_[drone]]->pinhole,
                                .position = pose.position + trace::rotated(body, offset_[drone]),
                                .rotation = rotation,
                                .frame = {}};
  const std::size_t pixels = static_cast<std::size_t>(config_->width_px) * static_cast<std::size_t>(config_->height_px);
  const auto image = [&](auto& images, std::size_t values) {
    return images.empty() ? nullptr : images.data() + drone * pixels * values;
  };
  request.frame = {.rgb = image(images_.rgb, 3),
                   .depth = image(images_.depth, 1),
                   .semantic = image(images_.semantic, 1),
                   .instance = image(images_.instance, 1),
                   .normal = image(images_.normal, 3),
                   .grey = image(images_.grey, 1)};
  return request;
}

}  // namespace flockstep::sensors
