#include "sensors/camera_rig.hpp"

#include <algorithm>
#include <new>

#include "base/hash.hpp"
#include "base/require.hpp"
#include "prepared/prepared_world.hpp"
#include "render/jpeg.hpp"

namespace flockstep::sensors {

CameraRig::CameraRig(const std::vector<CameraConfig>& configs, const ClockConfig& clock, std::span<const World* const> worlds,
                     const std::vector<std::int32_t>& slots, EnvLights& lights, const State& state, std::size_t drones_per_env,
                     std::size_t num_drones, TracerKind tracer)
    : worlds_(worlds),
      slots_(&slots),
      lights_(&lights),
      state_(&state),
      drones_per_env_(drones_per_env),
      num_drones_(num_drones) {
  for (const CameraConfig& config : configs) {
    try {
      cameras_.push_back(std::make_unique<Camera>(config, clock, drones_per_env, num_drones, tracer));
    } catch (const std::bad_alloc&) {
      refuse("num_drones x camera pixels", "frames that fit in memory",
             std::to_string(num_drones) + " of " + std::to_string(config.width_px) + " x " + std::to_string(config.height_px) +
                 " pixels");
    }
  }
  requests_.reserve(num_drones * cameras_.size());
  const auto converting = std::ranges::count_if(cameras_, [](const auto& camera) { return camera->converts(); });
  conversions_.reserve(num_drones * static_cast<std::size_t>(converting));
  const auto late = std::ranges::count_if(cameras_, [](const auto& camera) { return camera->is_late(); });
  late_.reserve(num_drones * static_cast<std::size_t>(late));
}

void CameraRig::prepare(Workers& workers) {
  if (empty()) return;
  for (const World* const world : worlds_) {  // built here, not by the first thread that needs it
    if (world == nullptr) continue;
    for (const auto& camera : cameras_) prepared(*world).shading(camera->config().shadows);
  }
  scratch_.resize(static_cast<std::size_t>(workers.num_threads()));
  for (const auto& camera : cameras_) {  // grows every thread's scratch now; the frame is stale
    if (num_drones_ == 0 || !camera->converts()) continue;
    for (ConversionScratch& scratch : scratch_) camera->convert(DroneIndex(0), *state_, scratch);
    camera->clear(DroneIndex(0));  // of errors
  }
}

void CameraRig::take_renderer(CameraRig& other) noexcept {
  if (!renderer_) renderer_ = std::move(other.renderer_);
}

void CameraRig::start_backend(CameraBackend backend, Workers& workers) {
  if (empty()) return;
  renderer_.emplace(backend, workers);
  prepare(workers);
}

void CameraRig::mark_stale(DroneIndex drone) {
  for (const auto& camera : cameras_) camera->mark_stale(drone);
}

void CameraRig::mark_stale(EnvIndex env) {
  for (std::size_t member = 0; member < drones_per_env_; ++member) mark_stale(DroneIndex(env * drones_per_env_ + member));
}

void CameraRig::mark_world_stale(std::int32_t world) {
  for (const auto& camera : cameras_) {
    for (std::size_t i = 0; i < num_drones_; ++i) {
      if (const DroneIndex drone(i); camera->taken_world(drone) == world) camera->mark_stale(drone);
    }
  }
}

void CameraRig::clear(DroneIndex drone) {
  for (const auto& camera : cameras_) camera->clear(drone);
}

std::uint64_t CameraRig::Sight::of_others(DroneIndex drone) {
  const std::size_t per_env = rig_.drones_per_env_;
  const std::size_t env = drone / per_env, first = env * per_env;
  if (env_ == env) return hash_;
  const State& state = *rig_.state_;
  Hash hash;
  hash.add(std::span(state.active).subspan(first, per_env));
  hash.add(std::span(state.position).subspan(3 * first, 3 * per_env));
  hash.add(std::span(state.quat_wxyz).subspan(4 * first, 4 * per_env));
  env_ = env;
  hash_ = hash.value();
  return hash_;
}

void CameraRig::ask_now(std::size_t camera, std::span<const DroneIndex> drones) {
  clear_requests();
  Camera& chosen = *cameras_[camera];
  Sight sight(*this);
  for (const DroneIndex drone : drones) {
    take(chosen, drone, sight.of(drone));
    publish(chosen, drone);
  }
}

void CameraRig::ask_again() {
  clear_requests();
  for (std::size_t camera = 0; camera < size(); ++camera) {
    if (cameras_[camera]->keeps_images()) continue;  // the snapshot has its images
    for (std::size_t i = 0; i < num_drones_; ++i) {
      const DroneIndex drone(i);
      if (!state_->active[drone] || cameras_[camera]->images().frame_step[drone] < 0) continue;
      request(*cameras_[camera], drone, retake(camera, drone));
    }
  }
}

render::RenderRequest CameraRig::retake(std::size_t camera, DroneIndex drone) const {
  const bool by_slot = slots_ == &state_->world_index;  // otherwise a frame of another world is stale
  Camera& taken = *cameras_[camera];
  return taken.retake(drone,
                      by_slot ? world_in_light(drone, static_cast<std::size_t>(taken.taken_world(drone))) : world_of(drone));
}

void CameraRig::clear_requests() {
  requests_.clear();
  conversions_.clear();
  late_.clear();
  if (!lights_->empty()) lights_->free_unused();
}

void CameraRig::start() {
  if (!requests_.empty()) renderer_->start(requests_);
}

void CameraRig::finish(Workers& workers) {
  try {
    if (!requests_.empty()) renderer_->finish(requests_, workers);
    if (!conversions_.empty()) {
      workers.run(conversions_.size(), [&](std::size_t i, std::size_t thread) {
        conversions_[i].camera->convert(conversions_[i].drone, *state_, scratch_[thread]);
      });
    }
    if (!late_.empty()) {
      workers.run(late_.size(), [&](std::size_t i, std::size_t) { late_[i].camera->publish(late_[i].drone, *state_); });
    }
  } catch (...) {  // some frames have not been rendered, and we cannot tell which
    for (std::size_t i = 0; i < num_drones_; ++i) mark_stale(DroneIndex(i));
    clear_requests();
    throw;
  }
  clear_requests();
}

const std::string& CameraRig::report() const {
  static const std::string none = "this Batch has no cameras";
  return renderer_ ? renderer_->report() : none;
}

std::string CameraRig::take_warning() { return renderer_ ? renderer_->take_warning() : std::string(); }

std::string CameraRig::jpeg(std::size_t camera, DroneIndex drone, int quality) const {
  require(quality >= 1 && quality <= 100, "quality", "an integer in [1, 100]", quality);
  require_frame(camera, drone);
  const CameraConfig& config = cameras_[camera]->config();
  const CameraImages& images = cameras_[camera]->images();
  const std::size_t pixels = cameras_[camera]->pixels();
  return config.outputs.rgb ? render::compress_rgb(images.rgb.data() + 3 * drone * pixels, config, quality)
                            : render::compress_grey(images.grey.data() + drone * pixels, config, quality);
}

std::vector<std::uint8_t> CameraRig::rgb(std::size_t camera, DroneIndex drone) const {
  require_frame(camera, drone);
  const CameraConfig& config = cameras_[camera]->config();
  const CameraImages& images = cameras_[camera]->images();
  const std::size_t pixels = cameras_[camera]->pixels();
  const bool is_grey = !config.outputs.rgb;
  const std::uint8_t* const from = is_grey ? images.grey.data() + drone * pixels : images.rgb.data() + 3 * drone * pixels;
  const bool is_apart = is_grey || config.layout == ImageLayout::chw;  // an image for each channel
  std::vector<std::uint8_t> rgb(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) rgb[3 * i + c] = is_apart ? from[(is_grey ? 0 : c * pixels) + i] : from[3 * i + c];
  }
  return rgb;
}

void CameraRig::require_frame(std::size_t camera, DroneIndex drone) const {
  const CameraConfig& config = cameras_[camera]->config();
  require(config.outputs.any_color(), "camera", "one that writes rgb or grey", '"' + config.name + '"');
  require(cameras_[camera]->images().frame_step[drone] >= 0, "index",
          "a drone whose frame is not stale (call sense or capture first)", drone);
}

const World& CameraRig::world_of(DroneIndex drone) const {
  return world_in_light(drone, static_cast<std::size_t>((*slots_)[drone / drones_per_env_]));
}

const World& CameraRig::world_in_light(DroneIndex drone, std::size_t slot) const {
  return lights_->empty() ? *worlds_[slot] : *lights_->world(EnvIndex(drone / drones_per_env_), slot);
}

}  // namespace flockstep::sensors
