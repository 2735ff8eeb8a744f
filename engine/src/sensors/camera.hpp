// Camera: one camera of every drone, with its mounting, its frames, and the time of the next frame.
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
#include "flockstep/episode.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "imaging/resample.hpp"
#include "render/render_request.hpp"
#include "sensors/color_errors.hpp"
#include "sensors/delay.hpp"
#include "sensors/depth_errors.hpp"
#include "sensors/drone_settings.hpp"
#include "sensors/events.hpp"
#include "sensors/scan_motion.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

// Buffers for converting a frame, owned by one thread.
struct ConversionScratch {
  imaging::ResampleScratch resample;
  imaging::HsvScratch hsv;
  std::vector<std::uint8_t> rgb;   // resized image, used only to compute hsv
  std::vector<std::uint8_t> grey;  // resized image, used only to compute events
  DepthScratch depth_errors;
  ColorScratch color_errors;
};

class Camera final : public Sensor {
 public:
  Camera(const CameraConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones,
         TracerKind tracer = TracerKind::automatic);

  const CameraConfig& config() const { return config_; }  // without the settings of individual drones
  const CameraImages& images() const { return images_; }
  std::size_t pixels() const { return pixels_; }  // pixels of one written image
  // The bodies of all envs; the view must stay valid. A snapshot then holds the images, because bodies have moved on since their
  // frames were taken.
  void set_bodies(const render::VisibleBodies& bodies, std::size_t per_env) {
    bodies_ = bodies;
    bodies_per_env_ = per_env;
  }
  // The drones of all envs, which their cameras see; the view must stay valid. A snapshot then holds the images, too.
  void set_drones(const render::VisibleBodies& drones) {
    drones_ = drones;
    sees_drones_ = true;
  }
  void set_capture_mode(CaptureMode mode) { config_.capture_mode = mode; }

  // The drone's own setting, including changes at run time. Setting it marks the drone's frame stale.
  CameraConfig config_of(DroneIndex drone) const;
  void set_config(DroneIndex drone, const CameraConfig& config);  // config needs the same resolution and outputs

  // Changes some fields of some drones. The change is validated before any drone is changed.
  void change(const CameraChange& change, std::span<const DroneIndex> drones);

  // Marks the drone's frame as out of date, as after a reset. Frames that are under way do not arrive.
  void mark_stale(DroneIndex drone) {
    images_.frame_step[drone] = -1;
    images_.age_s[drone] = 0.0F;
    delay_.forget(drone);
    if (events_) events_->forget(drone);
    if (config_.takes_time()) motion_.forget(drone);
  }
  void use_default_settings(DroneIndex drone) override { set_config(drone, config_); }
  // Clears the images of a removed drone: black, depth inf, ids 0.
  void clear(DroneIndex drone) override;

  // Returns whether a step or sense() must render the drone's frame. seen: another number if a drone of the env has moved.
  bool is_due(DroneIndex drone, const State& state, std::uint64_t seen) const;
  // Returns a request for the view from the drone's current pose, and records its frame as taken there, at this reading of
  // the episode. None if the frame will be lost.
  std::optional<render::RenderRequest> take(DroneIndex drone, const World& world, const State& state, std::uint64_t seen);
  // Returns a request that renders the recorded frame again.
  render::RenderRequest retake(DroneIndex drone, const World& world);
  // True if frames arrive later than they are taken, or may be lost.
  bool is_late() const { return delay_.is_late(); }
  // True if images err. A snapshot then holds them, because the seed may have changed since their frames were taken.
  bool errs() const { return has_depth_errors_ || has_color_errors_; }
  // True if a snapshot has to hold the images, because rendering them again would give others.
  bool keeps_images() const { return bodies_per_env_ > 0 || sees_drones_ || is_late() || errs() || events_.has_value(); }
  // Brings the image and its age up to date, when the frames of this step are rendered.
  void publish(DroneIndex drone, const State& state) {
    const std::int64_t tick = state.tick[drones_per_env_ == 1 ? std::size_t{drone} : drone / drones_per_env_];
    if (is_late()) return publish_arrived(drone, tick);
    if (images_.frame_step[drone] >= 0) images_.age_s[drone] = delay_.seconds(tick - taken_.tick[drone]);
  }

  // True if the written images differ from the rendered ones because they err, are resized, or hsv or events are computed. Each
  // frame must then be converted after rendering.
  bool converts() const { return resample_.has_value() || config_.outputs.hsv || events_ || errs(); }
  void convert(DroneIndex drone, const State& state, ConversionScratch& scratch);

  // Returns the index of the world in the drone's frame. With visit() and retake(), this is all that a restored frame needs.
  std::int32_t taken_world(DroneIndex drone) const { return taken_.world[drone]; }

  void list_arrays(const std::function<void(const ArrayView&)>& list) const override;
  // A snapshot holds run-time settings and the poses at which frames were taken. The frames are rendered again.
  void visit(ArrayVisitor& visitor) override;
  void check_bytes(std::span<const std::byte> settings) const override {
    settings_.check_bytes(settings, [](const CameraConfig& config) { config.validate(); });
  }
  void restored() override;
  void check() const override;
  void visit_images(ArrayVisitor& visitor);  // the written images, which visit() leaves out

 private:
  // Poses at which frames were taken. Frames depend on these, on frame_step and on the settings.
  struct Taken {
    std::vector<float> position;
    std::vector<float> quat_wxyz;
    std::vector<std::int32_t> world;
    std::vector<std::int64_t> tick;
    std::vector<std::int64_t> bodies;
    std::vector<std::int64_t> drones;

    static constexpr auto fields() {
      using C = Taken;
      constexpr auto info = [](int columns, const char* about) {
        return ArrayInfo{.columns = columns, .access = Access::internal, .writer = "camera", .about = about};
      };
      return field_list(array("taken_position", &C::position, info(3, "position of the drone in its frame, m, world frame")),
                        array("taken_quat_wxyz", &C::quat_wxyz, info(4, "its orientation, body to world")),
                        array("taken_world", &C::world, info(0, "index of the world in the frame")),
                        array("taken_tick", &C::tick, info(0, "tick of the episode")),
                        array("taken_bodies", &C::bodies, info(0, "BodyState::changes of the env")),
                        array("taken_drones", &C::drones, info(0, "hash of the poses of the env's drones")));
    }
  };
  render::RenderRequest request(DroneIndex drone, const World& world, const Pose& pose);
  void publish_arrived(DroneIndex drone, std::int64_t tick);
  render::RenderTargets targets(DroneIndex drone);  // the images that the renderer writes
  void add_errors(DroneIndex drone, const State& state, ConversionScratch& scratch);
  // Frames are written to the published images, or to a ring until they arrive.
  CameraImages& written() { return is_late() ? rings_.arrays() : images_; }
  std::size_t row_of(DroneIndex drone) const { return is_late() ? delay_.newest(drone) : std::size_t{drone}; }

  CameraConfig config_;
  CameraConfig rendering_;  // configuration of the renderer: no resize, rgb instead of hsv, grey instead of events
  trace::TracePolicy policy_;
  std::size_t drones_per_env_;
  std::size_t pixels_;                                          // pixels of a written image
  std::size_t rendered_pixels_;                                 // pixels of a rendered frame
  DroneSettings<CameraConfig, render::CameraOptics> settings_;  // render requests point to the optics
  std::vector<Mat3> mounting_;                                  // (N,) rotations, camera to body
  Taken taken_;
  ScanMotion motion_;  // of no drones unless images take time
  float ticks_hz_;
  std::vector<CaptureMode> mode_;  // (1,) mode in the last snapshot, until restored()
  CameraImages images_;
  Delay delay_;
  Rings<CameraImages> rings_;
  std::optional<Events> events_;
  std::optional<imaging::Resample> resample_;
  bool has_depth_errors_, has_color_errors_;
  Stream errors_;                           // random numbers of the errors
  float blotch_threshold_;                  // see add_depth_errors()
  std::vector<std::uint8_t> color_levels_;  // see add_color_errors()
  CameraImages frames_;                     // rendered images, if they differ from the written ones
  render::VisibleBodies bodies_;
  std::size_t bodies_per_env_ = 0;
  render::VisibleBodies drones_;
  bool sees_drones_ = false;
};

}  // namespace flockstep::sensors
