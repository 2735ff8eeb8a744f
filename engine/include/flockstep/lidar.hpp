// LidarConfig: a scanning LiDAR.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "flockstep/fields.hpp"

namespace flockstep {

// Either a grid of channels x beams, or (azimuth_deg, elevation_deg) lists of equal length. With lists, the fields of the grid
// keep their defaults; beams may also be the length of the lists.
struct LidarConfig {
  std::string name = "lidar";                  // letters, digits, _ and -
  int channels = 1;                            // rows, spread over vfov_deg from -vfov/2 to +vfov/2, both ends included
  int beams = 35;                              // per channel, counter-clockwise from -hfov/2 to +hfov/2, both ends included
                                               // (at 360 the end is left out)
  float hfov_deg = 270.0F;                     // in (0, 360]
  float vfov_deg = 0.0F;                       // in [0, 180]; one channel looks at elevation 0
  float max_range_m = 3.0F;                    // > 0; farther is a miss: inf in metres, 1 when normalised
  std::array<float, 3> offset_m{0, 0, 0};      // of the sensor in the body frame, within +-100
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};  // sensor to body; normalised if close to unit
  std::vector<float> azimuth_deg;              // a pattern instead of the grid: shape (N, 1, len)
  std::vector<float> elevation_deg;            // same length as azimuth_deg
  std::optional<float> rate_hz;                // scans per second of simulated time; none: one after every step

  static constexpr auto fields() {
    using C = LidarConfig;
    return field_list(field("name", &C::name), field("channels", &C::channels), field("beams", &C::beams),
                      field("hfov_deg", &C::hfov_deg), field("vfov_deg", &C::vfov_deg), field("max_range_m", &C::max_range_m),
                      field("offset_m", &C::offset_m), field("quat_wxyz", &C::quat_wxyz), field("azimuth_deg", &C::azimuth_deg),
                      field("elevation_deg", &C::elevation_deg), field("rate_hz", &C::rate_hz));
  }

  void validate() const;
  bool has_pattern() const { return !azimuth_deg.empty() || !elevation_deg.empty(); }
  int rows() const { return has_pattern() ? 1 : channels; }
  int columns() const { return has_pattern() ? static_cast<int>(azimuth_deg.size()) : beams; }
};

// Run-time changes to the LiDARs of some drones; what is not set stays. The number of rays is fixed per batch.
struct LidarChange {
  std::optional<float> max_range_m;
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::optional<std::array<float, 3>> offset_m;
  std::optional<std::array<float, 4>> quat_wxyz;
};

}  // namespace flockstep
