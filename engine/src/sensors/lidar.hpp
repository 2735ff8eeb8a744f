// LiDAR: where its beams point, and a scan of many drones as packets of rays.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "sensors/beams.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

class Lidar {
 public:
  Lidar(const LidarConfig& config, int num_drones);

  std::size_t rays_per_drone() const { return rays_; }
  const BeamPattern& pattern_of(std::size_t drone) const { return settings_[setting_[drone]].pattern; }
  std::span<const float> max_range() const { return max_range_; }  // (N,) m; stays where it is in memory
  // The drone's own setting, as changed at run time.
  LidarConfig config_of(std::size_t drone) const;
  void set_config(std::size_t drone, const LidarConfig& config);  // of the same number of rays

  // Scans the listed drones into state.lidar_ranges. Where rays go through Embree, consecutive drones in the same world share
  // packets.
  void scan(std::span<const std::uint32_t> drones, std::span<const World* const> worlds, State& state,
            trace::Tracer& tracer) const;

 private:
  void scan(const trace::Scene& scene, const Pose& pose, std::uint32_t drone, float* ranges, trace::Tracer& tracer) const;

  std::size_t rays_;
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
