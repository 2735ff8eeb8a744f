// Camera: one camera of every drone: how it is mounted, the frames it has taken, and when the next is due.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "render/render_request.hpp"

namespace flockstep::sensors {

class Camera {
 public:
  // The configuration outlives the camera and stays where it is; all of it but the capture mode stays as it is.
  Camera(const CameraConfig& config, std::size_t num_drones);

  const CameraConfig& config() const { return *config_; }  // but for what a drone has of its own
  const CameraImages& images() const { return images_; }

  // A drone's own setting, as changed at run time. Setting it marks its frame stale.
  CameraConfig config_of(std::size_t drone) const;
  void set_config(std::size_t drone, const CameraConfig& config);  // of the same resolution and outputs

  // The drone's frame shows nothing that counts any more, as after a reset.
  void mark_stale(std::size_t drone) { images_.frame_step[drone] = -1; }
  // A removed drone sees nothing: black, depth inf, ids 0.
  void clear(std::size_t drone);

  // Whether a step or sense() is to render the drone's frame.
  bool is_due(std::size_t drone, const State& state) const;
  // The picture of where the drone is now; from now on its frame counts as taken there, at this step of its episode.
  render::RenderRequest take(std::size_t drone, const World& world, std::int64_t step, const State& state);
  // The picture its frame already shows, once more.
  render::RenderRequest retake(std::size_t drone, const World& world);

  // Where the frames were taken; with frame_step and the settings, all that they depend on. (N, ...)
  struct Taken {
    std::vector<float> position;      // (N, 3) m
    std::vector<float> quat_wxyz;     // (N, 4)
    std::vector<std::int32_t> world;  // (N,)
  };
  Taken& taken() { return taken_; }
  const Taken& taken() const { return taken_; }
  std::vector<std::int64_t>& frame_step() { return images_.frame_step; }

 private:
  render::RenderRequest request(std::size_t drone, const World& world, const Pose& pose);

  const CameraConfig* config_;
  struct Setting {  // drones of equal FOV share one; one that no drone has any more makes room for the next
    std::optional<float> hfov_deg, vfov_deg;
    render::PinholeCamera pinhole;
    std::size_t drones;
  };
  std::vector<std::unique_ptr<Setting>> settings_;  // requests point to them
  std::vector<std::uint32_t> setting_;              // (N,) into settings_
  std::vector<Vec3> offset_;                        // (N,) m, body frame
  std::vector<Mat3> mounting_;                      // (N,) camera to body
  std::vector<std::array<float, 4>> quat_wxyz_;     // (N,) the same, as given
  Taken taken_;
  CameraImages images_;
};

}  // namespace flockstep::sensors
