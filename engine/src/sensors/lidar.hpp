// LiDAR: where its beams point, and a scan of many drones as packets of rays.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/lidar.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "sensors/beams.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

class Lidar {
 public:
  Lidar(const LidarConfig& config, const ClockConfig& clock, std::size_t num_drones, TracerKind tracer = TracerKind::automatic);

  std::size_t rays_per_drone() const { return rays_; }
  std::int64_t period() const { return period_; }               // ticks, as period_in_ticks() has it
  const std::vector<float>& ranges() const { return ranges_; }  // (N, channels, beams) m, inf on a miss
  // True once any drone has been scanned; before, the ranges are inf.
  bool has_scanned() const { return has_scanned_.load(std::memory_order_relaxed); }
  const BeamPattern& pattern_of(DroneIndex drone) const { return settings_[setting_[drone]].pattern; }
  std::span<const float> max_range() const { return max_range_; }  // (N,) m; stays where it is in memory
  // The drone's own setting, as changed at run time.
  LidarConfig config_of(DroneIndex drone) const;
  void set_config(DroneIndex drone, const LidarConfig& config);  // of the same number of rays

  // The changed setting is checked before any drone's is changed.
  void change(const LidarChange& change, std::span<const DroneIndex> drones);

  // Scans the listed drones; drone d is in scenes[slots[d / drones_per_env]]. Where rays go through Embree, consecutive
  // drones in the same world share packets.
  void scan(std::span<const DroneIndex> drones, std::span<const trace::Scene* const> scenes, std::span<const std::int32_t> slots,
            std::size_t drones_per_env, const State& state, trace::Tracer& tracer);
  void clear(DroneIndex drone);  // a removed drone sees nothing

  void write_directions(std::span<float> out) const;                  // (N, channels, beams, 3) unit, body frame
  void write_points(const State& state, std::span<float> out) const;  // likewise, m, world frame; inf on a miss

  // Ranges and run-time settings; to be followed by restored() after they were written.
  void visit(ArrayVisitor& visitor);
  void check_restored(std::span<const std::byte> settings) const;  // throws std::invalid_argument
  void restored();

 private:
  void scan(const trace::Scene& scene, const Pose& pose, DroneIndex drone, float* ranges, trace::Tracer& tracer) const;

  // The run-time setting of one drone, as it stands in a snapshot.
  struct Saved {
    float hfov_deg, vfov_deg, max_range_m;
    std::array<float, 3> offset_m;
    std::array<float, 4> quat_wxyz;
  };
  LidarConfig with(const Saved& saved) const;

  LidarConfig config_;
  trace::RayWays ways_;
  std::int64_t period_;
  std::size_t rays_;
  std::vector<float> ranges_;  // (N, rays) m
  std::atomic<bool> has_scanned_{false};
  std::vector<Saved> saved_;  // (N,) as the last snapshot has them, until restored()
  // Drones of equal FOV and mounting share a setting; one that no drone has any more makes room for the next.
  struct Setting {
    LidarConfig config;
    BeamPattern pattern;
    std::size_t drones;  // that have it
  };
  std::vector<Setting> settings_;
  std::vector<std::uint32_t> setting_;  // (N,) into settings_
  std::vector<float> max_range_;        // (N,) m
  std::vector<Vec3> offset_;            // (N,) m, body frame
};

}  // namespace flockstep::sensors
