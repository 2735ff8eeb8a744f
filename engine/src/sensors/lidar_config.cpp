#include <cmath>
#include <string>

#include "base/require.hpp"
#include "flockstep/lidar.hpp"

namespace flockstep {
namespace {

constexpr int kMaxRays = 1 << 18;  // per drone

}  // namespace

void LidarConfig::validate() const {
  require_plain_name(name, "lidar.name");
  require(channels >= 1 && channels <= kMaxRays, "lidar.channels", "an integer in [1, 262144]", channels);
  require(beams >= 1 && beams <= kMaxRays, "lidar.beams", "an integer in [1, 262144]", beams);
  require(hfov_deg > 0.0F && hfov_deg <= 360.0F, "lidar.hfov_deg", "a number in (0, 360]", hfov_deg);
  require(vfov_deg >= 0.0F && vfov_deg <= 180.0F, "lidar.vfov_deg", "a number in [0, 180]", vfov_deg);
  require_positive(max_range_m, "lidar.max_range_m");
  require_mount(offset_m, "lidar.offset_m");
  require_unit_quaternion(quat_wxyz, "lidar.quat_wxyz");
  require(azimuth_deg.size() == elevation_deg.size(), "lidar.elevation_deg",
          "as many values as azimuth_deg (" + std::to_string(azimuth_deg.size()) + ")", elevation_deg.size());
  if (has_pattern()) {  // which says all that the fields of a grid would
    const LidarConfig grid;
    const auto beams_of_pattern = static_cast<int>(azimuth_deg.size());
    const char* const unset = "its default, since azimuth_deg and elevation_deg give the beams (leave it out)";
    require(beams == grid.beams || beams == beams_of_pattern, "lidar.beams", unset, beams);
    require(channels == grid.channels, "lidar.channels", unset, channels);
    require(hfov_deg == grid.hfov_deg, "lidar.hfov_deg", unset, hfov_deg);
    require(vfov_deg == grid.vfov_deg, "lidar.vfov_deg", unset, vfov_deg);
  }
  for (const float value : azimuth_deg) {
    require(std::abs(value) <= 360.0F, "lidar.azimuth_deg", "values in [-360, 360]", value);
  }
  for (const float value : elevation_deg) {
    require(std::abs(value) <= 90.0F, "lidar.elevation_deg", "values in [-90, 90]", value);
  }
  const long long rays = static_cast<long long>(rows()) * columns();
  require(rays <= kMaxRays, "lidar.channels x lidar.beams", "at most 262144 rays", rays);
  if (rate_hz) require_positive(*rate_hz, "lidar.rate_hz");
}

}  // namespace flockstep
