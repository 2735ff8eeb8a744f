// CameraRig: all cameras of a batch, their renderer, and the pending frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/workers.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "render/renderer.hpp"
#include "sensors/camera.hpp"
#include "sensors/env_lights.hpp"

namespace flockstep::sensors {

class CameraRig {
 public:
  // Env e uses worlds[slots[e]]; slots without an env are null. The arguments must outlive the rig, and the worlds must keep
  // their addresses.
  CameraRig(const std::vector<CameraConfig>& configs, const ClockConfig& clock, std::span<const World* const> worlds,
            const std::vector<std::int32_t>& slots, EnvLights& lights, const State& state, std::size_t drones_per_env,
            std::size_t num_drones, TracerKind tracer);

  // See Camera::set_bodies().
  void set_bodies(const render::VisibleBodies& bodies, std::size_t per_env) {
    for (const auto& camera : cameras_) camera->set_bodies(bodies, per_env);
  }

  // See Camera::set_drones().
  void set_drones(const render::VisibleBodies& drones) {
    sees_drones_ = true;
    for (const auto& camera : cameras_) camera->set_drones(drones);
  }

  void start_backend(CameraBackend backend, Workers& workers);  // call it after all drones have been placed
  // Instead: prepare(), then take the renderer of a rig that this one replaces.
  void prepare(Workers& workers);
  void take_renderer(CameraRig& other) noexcept;

  bool empty() const { return cameras_.empty(); }
  std::size_t size() const { return cameras_.size(); }
  Camera& operator[](std::size_t camera) { return *cameras_[camera]; }
  const Camera& operator[](std::size_t camera) const { return *cameras_[camera]; }

  void mark_stale(DroneIndex drone);
  void mark_stale(EnvIndex env);              // the frames of its drones
  void mark_world_stale(std::int32_t world);  // marks the frames that show a world as stale; world: State::world_index
  void clear(DroneIndex drone);               // clears the images of a removed drone

  // --- the next frames: request, start, finish. A backend with its own thread already renders between start() and finish().
  // Requests the due frames of all drones for which for_each_drone calls its argument.
  template <class ForEachDrone>
  void ask(const ForEachDrone& for_each_drone) {
    clear_requests();
    for (const auto& camera : cameras_) {
      Sight sight(*this);
      for_each_drone([&](DroneIndex drone) {
        const std::uint64_t seen = sight.of(drone);
        if (camera->is_due(drone, *state_, seen)) take(*camera, drone, seen);
        publish(*camera, drone);
      });
    }
  }
  void ask_now(std::size_t camera, std::span<const DroneIndex> drones);  // for one camera, whether due or not
  void ask_again();                                                      // all frames that are not stale, unchanged
  void start();
  void finish(Workers& workers);

  // The chosen backend with the reason, and warnings that have not been reported yet.
  const std::string& report() const;
  std::string take_warning();
  trace::EmbreeUse embree_use() const { return renderer_ ? renderer_->embree_use() : trace::EmbreeUse{}; }
  // Returns a JPEG file of one frame; quality in [1, 100].
  std::string jpeg(std::size_t camera, DroneIndex drone, int quality) const;
  // Returns one frame in colour: (height, width, 3), from rgb or otherwise from grey.
  std::vector<std::uint8_t> rgb(std::size_t camera, DroneIndex drone) const;
  // Returns a request that renders a frame again.
  render::RenderRequest retake(std::size_t camera, DroneIndex drone) const;

 private:
  // Identifies the poses of the drones of an env by a hash. Consecutive drones of an env share it.
  class Sight {
   public:
    explicit Sight(const CameraRig& rig) : rig_(rig) {}
    // 0 if drones do not see each other.
    std::uint64_t of(DroneIndex drone) { return rig_.sees_drones_ && rig_.drones_per_env_ > 1 ? of_others(drone) : 0; }

   private:
    std::uint64_t of_others(DroneIndex drone);

    const CameraRig& rig_;
    std::size_t env_ = SIZE_MAX;  // none
    std::uint64_t hash_ = 0;
  };

  const World& world_of(DroneIndex drone) const;
  const World& world_in_light(DroneIndex drone, std::size_t slot) const;
  void require_frame(std::size_t camera, DroneIndex drone) const;  // in colour or grey, and not stale
  void clear_requests();
  void take(Camera& camera, DroneIndex drone, std::uint64_t seen) {
    const auto frame = camera.take(drone, world_of(drone), *state_, seen);
    if (frame) request(camera, drone, *frame);
  }
  // Publishes an image at once, or after rendering if it may be a frame of this step that waits in a ring.
  void publish(Camera& camera, DroneIndex drone) {
    if (camera.is_late()) {
      late_.push_back({&camera, drone});
    } else {
      camera.publish(drone, *state_);
    }
  }
  void request(Camera& camera, DroneIndex drone, const render::RenderRequest& frame) {
    requests_.push_back(frame);
    if (camera.converts()) conversions_.push_back({&camera, drone});
  }

  std::span<const World* const> worlds_;
  const std::vector<std::int32_t>* slots_;  // (E,)
  EnvLights* lights_;
  const State* state_;
  std::size_t drones_per_env_;
  std::size_t num_drones_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::optional<render::Renderer> renderer_;  // set by start_backend()
  bool sees_drones_ = false;
  std::vector<render::RenderRequest> requests_;  // grouped by camera
  struct Conversion {
    Camera* camera;
    DroneIndex drone;
  };
  std::vector<Conversion> conversions_;     // conversions to run after rendering
  std::vector<Conversion> late_;            // images of late cameras, to publish after these
  std::vector<ConversionScratch> scratch_;  // one per thread
};

}  // namespace flockstep::sensors
