// LiDAR: where its beams point, and a scan of many drones as packets of rays.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "sensors/beams.hpp"
#include "trace/scene.hpp"

namespace flockstep::sensors {

// Rays of several drones in one world that wait until they fill a block.
struct WaitingRays {
  struct Run {  // consecutive rays, and where their results go
    float* ranges;
    std::size_t count;
  };
  trace::RayBlock rays;
  std::array<Run, trace::kMaxRays> runs;
  std::size_t num_runs = 0;
};

// One worker's rays on their way to the tracer.
struct ScanScratch {
  trace::RayBundle bundle;         // of one drone
  trace::CandidateSet candidates;  // of that drone
  WaitingRays crowd, meshes;       // to go through Embree: for everything, for what is nearer among triangles
};

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
            ScanScratch& scratch) const;

 private:
  void scan(const trace::Scene& scene, const Pose& pose, std::uint32_t drone, float* ranges, ScanScratch& scratch) const;

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
