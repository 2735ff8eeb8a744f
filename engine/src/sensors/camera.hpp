// Camera: one camera of every drone: how it is mounted, the frames it has taken, and when the next is due.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/camera.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "imaging/hsv.hpp"
#include "imaging/resample.hpp"
#include "render/render_request.hpp"
#include "sensors/drone_settings.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

// Buffers to convert a frame; owned by one thread.
struct ConversionScratch {
  imaging::ResampleScratch resample;
  imaging::HsvScratch hsv;
  std::vector<std::uint8_t> rgb;  // a resized image that only hsv is made of
};

class Camera final : public Sensor {
 public:
  Camera(const CameraConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones,
         TracerKind tracer = TracerKind::automatic);

  const CameraConfig& config() const { return config_; }  // but for what a drone has of its own
  const CameraImages& images() const { return images_; }
  std::size_t pixels() const { return pixels_; }  // of one image, as written
  void set_capture_mode(CaptureMode mode) { config_.capture_mode = mode; }

  // A drone's own setting, as changed at run time. Setting it marks its frame stale.
  CameraConfig config_of(DroneIndex drone) const;
  void set_config(DroneIndex drone, const CameraConfig& config);  // of the same resolution and outputs

  // The same for some drones, in some fields. What it makes of every setting has to be valid; that is checked first.
  void change(const CameraChange& change, std::span<const DroneIndex> drones);

  // The drone's frame shows nothing that counts any more, as after a reset.
  void mark_stale(DroneIndex drone) { images_.frame_step[drone] = -1; }
  // A removed drone sees nothing: black, depth inf, ids 0.
  void clear(DroneIndex drone) override;

  // Whether a step or sense() is to render the drone's frame.
  bool is_due(DroneIndex drone, const State& state) const;
  // The picture of where the drone is now; from now on its frame counts as taken there, at this reading of its episode.
  render::RenderRequest take(DroneIndex drone, const World& world, const State& state);
  // The picture its frame already shows, once more.
  render::RenderRequest retake(DroneIndex drone, const World& world);

  // Whether what is rendered is not yet what the camera writes: images are resized, or hsv is computed. Then each frame is to be
  // converted once it is rendered.
  bool converts() const { return resample_.has_value() || config_.outputs.hsv; }
  void convert(DroneIndex drone, ConversionScratch& scratch);

  // Which world the drone's frame shows; with visit() and retake(), all that a restored frame needs.
  std::int32_t taken_world(DroneIndex drone) const { return taken_.world[drone]; }

  void list_arrays(const std::function<void(const ArrayView&)>& list) const override;
  // A snapshot holds the poses at which frames were taken, and run-time settings: frames are rendered again.
  void visit(ArrayVisitor& visitor) override;
  void check_bytes(std::span<const std::byte> settings) const override { settings_.check_bytes(settings); }
  void restored() override;
  void check() const override;

 private:
  // The poses at which frames were taken. Frames depend on these, on frame_step and on the settings.
  struct Taken {
    std::vector<float> position;
    std::vector<float> quat_wxyz;
    std::vector<std::int32_t> world;
    std::vector<std::int64_t> tick;

    static constexpr auto fields() {
      using C = Taken;
      constexpr auto info = [](int columns, const char* about) {
        return ArrayInfo{.columns = columns, .access = Access::internal, .writer = "camera", .about = about};
      };
      return field_list(array("taken_position", &C::position, info(3, "position of the drone in its frame, m, world frame")),
                        array("taken_quat_wxyz", &C::quat_wxyz, info(4, "its orientation, body to world")),
                        array("taken_world", &C::world, info(0, "index of the world in the frame")),
                        array("taken_tick", &C::tick, info(0, "tick of the episode")));
    }
  };
  render::RenderRequest request(DroneIndex drone, const World& world, const Pose& pose);

  CameraConfig config_;
  CameraConfig rendering_;  // what the renderer does: no resize, and rgb instead of hsv
  trace::TracePolicy policy_;
  std::size_t drones_per_env_;
  std::size_t pixels_;                                           // of an image as written
  std::size_t rendered_pixels_;                                  // of a frame
  DroneSettings<CameraConfig, render::PinholeCamera> settings_;  // requests point to the optics
  std::vector<Mat3> mounting_;                                   // (N,) camera to body
  Taken taken_;
  std::vector<CaptureMode> mode_;  // (1,) as the last snapshot has it, until restored()
  CameraImages images_;
  std::optional<imaging::Resample> resample_;
  CameraImages frames_;  // as rendered, where that is not what is written
};

}  // namespace flockstep::sensors
