// LiDAR: where its beams point, and a scan of many drones as packets of rays.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sensors/beams.hpp"
#include "swiftlet/config.hpp"
#include "swiftlet/state.hpp"
#include "swiftlet/world.hpp"
#include "trace/ray_block.hpp"

namespace swiftlet::sensors {

// One worker's rays on their way to the tracer.
struct ScanScratch {
  struct Run {  // consecutive rays of one drone
    float* ranges;
    std::size_t count;
  };
  trace::RayBlock rays;  // of several drones
  trace::RayBlock own;   // of one
  std::array<Run, trace::RayBlock::kRays> runs;
};

class Lidar {
 public:
  Lidar(const LidarConfig& config, int num_drones);

  std::size_t rays_per_drone() const { return rays_; }
  const BeamPattern& pattern_of(std::size_t drone) const { return patterns_[setting_[drone]]; }
  std::span<const float> max_range() const { return max_range_; }  // (N,) m; stays where it is in memory
  // The drone's own setting, as changed at run time.
  LidarConfig config_of(std::size_t drone) const;
  void set_config(std::size_t drone, const LidarConfig& config);  // of the same number of rays

  // Scans the listed drones into state.lidar_ranges. Rays of consecutive drones in the same world share packets.
  void scan(std::span<const std::uint32_t> drones, std::span<const World* const> worlds, State& state,
            ScanScratch& scratch) const;

 private:
  std::size_t rays_;
  // Drones of equal FOV and mounting share a pattern: these are the distinct ones, with the configs they came from.
  std::vector<LidarConfig> configs_;
  std::vector<BeamPattern> patterns_;
  std::vector<std::uint32_t> setting_;  // (N,) into the two above
  std::vector<float> max_range_;        // (N,) m
  std::vector<Vec3> offset_;            // (N,) m, body frame
};

}  // namespace swiftlet::sensors
