// Lidar: a LiDAR on every drone. Scans of many drones are traced as packets of rays.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/sensors/lidar.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "sensors/beam_targets.hpp"
#include "sensors/beams.hpp"
#include "sensors/drone_settings.hpp"
#include "sensors/scan_motion.hpp"
#include "sensors/sensor.hpp"
#include "trace/echoes.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// The beams of one setting, and rays at their edges if they have a width.
struct BeamOptics {
  BeamPattern beams, edges;
};

// Returns false for an array that such a LiDAR leaves empty.
inline bool writes(const LidarConfig& config, std::string_view array) {
  return array == "turn_deg" ? config.turn_deg != 0.0F : is_written(config, array);
}

class Lidar final : public SensorOf<LidarReadings> {
 public:
  Lidar(const LidarConfig& config, const SensorSetup& setup);

  std::size_t rays_per_drone() const { return rays_; }
  // True after any drone has been scanned; until then the ranges are inf.
  bool has_scanned() const { return has_scanned_.load(std::memory_order_relaxed); }

  // Overrides has_scanned(), for a LiDAR that takes the place of another one.
  void set_has_scanned(bool has_scanned) {
    has_scanned_.store(has_scanned, std::memory_order_relaxed);
    if (!has_scanned) delay_.forget_all();
  }

  // The drone's own setting, including changes at run time.
  LidarConfig config_of(DroneIndex drone) const { return settings_.config_of(drone); }
  // The change is validated before any drone is changed.
  void change(const LidarChange& change, std::span<const DroneIndex> drones);

  void write_directions(std::span<float> out) const;                    // (N, channels, beams, 3) unit, body frame
  void write_directions(DroneIndex drone, std::span<float> out) const;  // one drone's, (channels, beams, 3)
  void write_points(const State& state, std::span<float> out) const;    // same shape, m, world frame; inf on a miss

  // Scans now along write_directions(). ranges: exact, or with the errors of the drone's latest reading.
  void scan(DroneIndex drone, const Surroundings& surroundings, bool has_errors, std::span<float> ranges) const;

  void begin(DroneIndex drone, const State& state) override;
  void use_default_settings(DroneIndex drone) override { set_config(drone, config_); }
  void clear(DroneIndex drone) override;
  void list_arrays(const std::function<void(const ArrayView&)>& list) const override {
    for_each_view(readings(), items_of(config_), [&](const ArrayView& array) {
      if (writes(config_, array.name)) list(array);
    });
  }
  void visit(ArrayVisitor& visitor) override;
  void check_bytes(std::span<const std::byte> settings) const override {
    settings_.check_bytes(settings, [this](const LidarConfig& config) { check_setting(config); });
  }
  void restored() override;
  void check() const override {
    SensorOf::check();
    motion_.check();
  }

 private:
  // Consecutive drones in the same world share the ray packets that go through Embree.
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;

  bool is_rolling() const { return config_.scan_time_s > 0.0F; }
  bool turns() const { return config_.turn_deg != 0.0F; }
  float turn_deg_of(const LidarReadings& readings, DroneIndex drone) const { return turns() ? readings.turn_deg[drone] : 0.0F; }
  // Returns the rotation of turned beams, body frame; none if they are not turned.
  std::optional<Mat3> turn_of(DroneIndex drone, float turn_deg) const {
    return turn_deg == 0.0F ? std::nullopt : std::optional(turn_about_z(settings_[drone].quat_wxyz, turn_deg));
  }
  // Turns the beams of the readings that drones take now.
  void turn_readings(std::span<const DroneIndex> drones, const Surroundings& surroundings);
  std::int64_t tick_of(DroneIndex drone, const State& state) const {
    return state.tick[RandomKey::of(drone, drones_per_env_).env];
  }
  PosePath path_of(DroneIndex drone, const State& state) const {
    const Pose now = pose_of(state, drone);
    return is_rolling() ? motion_.path_of(drone, now, tick_of(drone, state)) : PosePath{now, now};
  }
  // Returns the drone's pose when a column of beams is traced.
  Pose pose_at(const PosePath& path, std::size_t column) const;
  // The places of a drone's beams. Spans of what is not needed are empty.
  struct Scan {
    std::span<float> ranges;
    std::span<float> edges;  // ranges of the rays at the edges of the beams
    trace::EchoTarget echoes;
    float turn_deg;  // see LidarReadings
  };
  // reader: null if only ranges are needed
  Scan scan_of(DroneIndex drone, trace::EchoReader* reader = nullptr) {
    const auto row = [&](std::vector<float>& values) { return std::span(values).subspan(drone * rays_, rays_); };
    const bool has_edges = !edges_.empty() && errors_of(drone).divergence_mrad > 0.0F;
    return {.ranges = row(readings_.truth().ranges),
            .edges = has_edges ? row(edges_) : std::span<float>(),
            .echoes = reader == nullptr ? trace::EchoTarget() : echoes_of(drone, *reader, drone * rays_),
            .turn_deg = turn_deg_of(readings_.truth(), drone)};
  }
  // first: place of the drone's beams in the reader's arrays
  trace::EchoTarget echoes_of(DroneIndex drone, trace::EchoReader& reader, std::size_t first) const;
  // Sets the tracer's viewpoint. turn: of the beams, body frame
  void aim(const BeamTargets& targets, DroneIndex drone, const Pose& pose, const std::optional<Mat3>& turn,
           trace::Tracer& tracer) const;
  // kPlain: for beams of ranges only, without a width, that neither turn nor roll
  template <bool kPlain>
  void trace_beams(const BeamTargets& targets, DroneIndex drone, const State& state, const Scan& scan,
                   trace::Tracer& tracer) const;
  // Readings of clutter are negative; see add_range_errors().
  void add_errors(DroneIndex drone, const State& state, const Scan& scan) const;
  // Throws std::invalid_argument if a drone's setting is invalid, or needs memory that the LiDAR does not have.
  void check_setting(const LidarConfig& config) const;
  void set_config(DroneIndex drone, const LidarConfig& config);
  const RangeErrors& errors_of(DroneIndex drone) const { return settings_[drone].errors; }
  Vec3 offset_of(DroneIndex drone) const { return Vec3::Map(settings_[drone].offset_m.data()); }

  LidarConfig config_;
  trace::TracePolicy policy_;
  std::size_t rays_;
  std::uint32_t number_;  // number among the drone's LiDARs; each has its own errors
  DroneSettings<LidarConfig, BeamOptics> settings_;
  std::vector<float> edges_;  // (N, rays) of the scans in progress; empty if not needed
  bool errs_;                 // some drone has, or had, errors
  float scan_ticks_;          // ticks that a scan takes
  ScanMotion motion_;         // of no drones unless scans take time
  std::atomic<bool> has_scanned_{false};
};

std::unique_ptr<BlockSensor> make_sensor(const LidarConfig& config, const SensorSetup& setup);

}  // namespace flockstep::sensors
