#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/lidar.hpp"

namespace flockstep {

void LidarConfig::validate() const {
  check_fields(*this, "lidar.");
  require(azimuth_deg.size() == elevation_deg.size(), "lidar.elevation_deg",
          "as many values as azimuth_deg (" + std::to_string(azimuth_deg.size()) + ")", elevation_deg.size());
  if (has_pattern()) {  // a pattern replaces the fields of the grid
    const LidarConfig grid;
    const auto beams_of_pattern = static_cast<int>(azimuth_deg.size());
    const char* const unset = "its default, since azimuth_deg and elevation_deg define the beams (leave it out)";
    require(beams == grid.beams || beams == beams_of_pattern, "lidar.beams", unset, beams);
    require(channels == grid.channels, "lidar.channels", unset, channels);
    require(hfov_deg == grid.hfov_deg, "lidar.hfov_deg", unset, hfov_deg);
    require(vfov_deg == grid.vfov_deg, "lidar.vfov_deg", unset, vfov_deg);
  }
  const long long rays = static_cast<long long>(rows()) * columns();
  require(rays <= kMaxRays, "lidar.channels x lidar.beams", "at most 262144 rays", rays);
}

}  // namespace flockstep
