// CameraRig: all cameras of a batch, what renders their frames, and the frames on their way.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/workers.hpp"
#include "flockstep/camera.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "render/renderer.hpp"
#include "sensors/camera.hpp"

namespace flockstep::sensors {

class CameraRig {
 public:
  // Env e is in worlds[slots[e]]; null where no env is. These and the state outlive the rig, and the worlds stay where they are
  // in memory.
  CameraRig(const std::vector<CameraConfig>& configs, const ClockConfig& clock, std::span<const World* const> worlds,
            const std::vector<std::int32_t>& slots, const State& state, std::size_t drones_per_env, std::size_t num_drones,
            TracerKind tracer);

  // Throws std::invalid_argument where a camera cannot show a world.
  void require_world(const World& world) const;

  // Chooses who renders, now that every drone has its place; typical: drones spread over the batch, to time backends by.
  void choose_backend(CameraBackend backend, std::span<const DroneIndex> typical, Workers& workers);

  bool empty() const { return cameras_.empty(); }
  std::size_t size() const { return cameras_.size(); }
  Camera& operator[](std::size_t camera) { return *cameras_[camera]; }
  const Camera& operator[](std::size_t camera) const { return *cameras_[camera]; }

  void mark_stale(DroneIndex drone);
  void clear(DroneIndex drone);  // a removed drone sees nothing

  // --- the next frames: ask for them, start, finish. In between a backend with a thread of its own renders already.
  // Those that are due, of the drones with which for_each_drone calls its argument.
  template <class ForEachDrone>
  void ask(const ForEachDrone& for_each_drone) {
    clear_requests();
    for (const auto& camera : cameras_) {
      for_each_drone([&](DroneIndex drone) {
        if (camera->is_due(drone, *state_)) request(*camera, drone, camera->take(drone, world_of(drone), *state_));
      });
    }
  }
  void ask_now(std::size_t camera, std::span<const DroneIndex> drones);  // by one camera, whether they are due or not
  void ask_again();                                                      // all frames that are not stale, as they were
  void start();
  void finish(Workers& workers);

  // Which backend renders, and why; what the user has not been told yet.
  const std::string& report() const;
  std::string take_warning();
  trace::EmbreeUse embree_use() const { return renderer_ ? renderer_->embree_use() : trace::EmbreeUse{}; }
  // A JPEG file of one frame; quality in [1, 100].
  std::string jpeg(std::size_t camera, DroneIndex drone, int quality) const;

 private:
  const World& world_of(DroneIndex drone) const;
  void clear_requests();
  void request(Camera& camera, DroneIndex drone, const render::RenderRequest& frame) {
    requests_.push_back(frame);
    if (camera.converts()) conversions_.push_back({&camera, drone});
  }

  std::span<const World* const> worlds_;
  const std::vector<std::int32_t>* slots_;  // (E,)
  const State* state_;
  std::size_t drones_per_env_;
  std::size_t num_drones_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::optional<render::Renderer> renderer_;     // once it is chosen
  std::vector<render::RenderRequest> requests_;  // asked for, camera by camera
  struct Conversion {
    Camera* camera;
    DroneIndex drone;
  };
  std::vector<Conversion> conversions_;     // of those requests, once they are rendered
  std::vector<ConversionScratch> scratch_;  // one for each thread
};

}  // namespace flockstep::sensors
