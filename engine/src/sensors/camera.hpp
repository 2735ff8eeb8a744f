// Camera: one camera of every drone: how it is mounted, the frames it has taken, and when the next is due.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/camera.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "imaging/hsv.hpp"
#include "imaging/resample.hpp"
#include "render/render_request.hpp"

namespace flockstep::sensors {

// Buffers to convert a frame; owned by one thread.
struct ConversionScratch {
  imaging::ResampleScratch resample;
  imaging::HsvScratch hsv;
  std::vector<std::uint8_t> rgb;  // a resized image that only hsv is made of
};

class Camera {
 public:
  Camera(const CameraConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones,
         TracerKind tracer = TracerKind::automatic);
  Camera(const Camera&) = delete;  // requests point into it
  Camera& operator=(const Camera&) = delete;

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
  void clear(DroneIndex drone);

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

  // Where frames were taken, and run-time settings; frames are taken again. To be followed by restored() after they were written.
  void visit(ArrayVisitor& visitor);
  void check_restored(std::span<const std::byte> settings) const;  // throws std::invalid_argument
  void restored();
  void check() const;  // throws std::invalid_argument where a frame was taken at no pose in the world

 private:
  // Where the frames were taken; with frame_step and the settings, all that they depend on. (N, ...)
  struct Taken {
    std::vector<float> position;      // (N, 3) m
    std::vector<float> quat_wxyz;     // (N, 4)
    std::vector<std::int32_t> world;  // (N,)
    std::vector<std::int64_t> tick;   // (N,)

    static constexpr auto fields() {
      return field_list(field("taken_position", &Taken::position), field("taken_quat_wxyz", &Taken::quat_wxyz),
                        field("taken_world", &Taken::world), field("taken_tick", &Taken::tick));
    }
  };
  // The run-time setting of one drone, as it stands in a snapshot. A field of view that is not given is 0.
  struct Saved {
    float hfov_deg, vfov_deg;
    std::array<float, 3> offset_m;
    std::array<float, 4> quat_wxyz;
  };
  CameraConfig with(const Saved& saved) const;
  render::RenderRequest request(DroneIndex drone, const World& world, const Pose& pose);

  CameraConfig config_;
  CameraConfig rendering_;  // what the renderer does: no resize, and rgb instead of hsv
  trace::RayWays ways_;
  std::int64_t period_;  // ticks, as period_in_ticks() has it
  std::size_t drones_per_env_;
  std::size_t pixels_;           // of an image as written
  std::size_t rendered_pixels_;  // of a frame
  struct Setting {               // drones of equal FOV share one; one that no drone has any more makes room for the next
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
  std::vector<Saved> saved_;       // (N,) as the last snapshot has them, until restored()
  std::vector<CaptureMode> mode_;  // (1,) likewise
  CameraImages images_;
  std::optional<imaging::Resample> resample_;
  CameraImages frames_;  // as rendered, where that is not what is written
};

}  // namespace flockstep::sensors
