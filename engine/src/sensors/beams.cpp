#include "sensors/beams.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/beams.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cmath>
#include <numbers>

HWY_BEFORE_NAMESPACE();
namespace swiftlet::sensors::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void append_rays(const BeamPattern& pattern, std::size_t first, std::size_t count, const Mat3& rotation, const Vec3& origin,
                 float max_range_m, trace::RayBlock& rays) {
  const hn::CappedTag<float, trace::RayBlock::kPadding> d;
  const auto rotated = [&](int row, auto x, auto y, auto z) HWY_ATTR {
    return hn::Add(hn::Add(hn::Mul(hn::Set(d, rotation(row, 0)), x), hn::Mul(hn::Set(d, rotation(row, 1)), y)),
                   hn::Mul(hn::Set(d, rotation(row, 2)), z));
  };
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const std::size_t at = rays.count + i;
    const auto x = hn::LoadU(d, pattern.x.data() + first + i);
    const auto y = hn::LoadU(d, pattern.y.data() + first + i);
    const auto z = hn::LoadU(d, pattern.z.data() + first + i);
    hn::StoreU(rotated(0, x, y, z), d, rays.dir_x + at);
    hn::StoreU(rotated(1, x, y, z), d, rays.dir_y + at);
    hn::StoreU(rotated(2, x, y, z), d, rays.dir_z + at);
    hn::StoreU(hn::Set(d, origin.x()), d, rays.org_x + at);
    hn::StoreU(hn::Set(d, origin.y()), d, rays.org_y + at);
    hn::StoreU(hn::Set(d, origin.z()), d, rays.org_z + at);
    hn::StoreU(hn::Set(d, max_range_m), d, rays.range + at);
  }
  rays.count += count;
}

}  // namespace swiftlet::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace swiftlet::sensors {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// Evenly spaced over [-fov/2, fov/2]; the end is left out where it would be the beginning again.
double spread_deg(int index, int count, double fov_deg) {
  if (count == 1) return 0.0;
  const int intervals = fov_deg >= 360.0 ? count : count - 1;
  return fov_deg * (static_cast<double>(index) / intervals - 0.5);
}

}  // namespace

BeamPattern make_pattern(const LidarConfig& config) {
  const auto& q = config.quat_wxyz;
  const Eigen::Matrix3d mounting = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  BeamPattern pattern;
  const auto add = [&](double azimuth_deg, double elevation_deg) {
    const double azimuth = azimuth_deg * kRadPerDeg;
    const double elevation = elevation_deg * kRadPerDeg;
    const Eigen::Vector3d beam = mounting * Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                                                            std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    pattern.x.push_back(static_cast<float>(beam.x()));
    pattern.y.push_back(static_cast<float>(beam.y()));
    pattern.z.push_back(static_cast<float>(beam.z()));
  };
  if (config.has_pattern()) {
    for (std::size_t i = 0; i < config.azimuth_deg.size(); ++i) add(config.azimuth_deg[i], config.elevation_deg[i]);
  } else {
    for (int channel = 0; channel < config.channels; ++channel) {
      const double elevation = spread_deg(channel, config.channels, config.vfov_deg);
      for (int beam = 0; beam < config.beams; ++beam) add(spread_deg(beam, config.beams, config.hfov_deg), elevation);
    }
  }
  for (auto* component : {&pattern.x, &pattern.y, &pattern.z}) component->resize(component->size() + trace::RayBlock::kPadding);
  return pattern;
}

HWY_EXPORT(append_rays);

void append_rays(const BeamPattern& pattern, std::size_t first, std::size_t count, const Mat3& rotation, const Vec3& origin,
                 float max_range_m, trace::RayBlock& rays) {
  HWY_DYNAMIC_DISPATCH(append_rays)(pattern, first, count, rotation, origin, max_range_m, rays);
}

}  // namespace swiftlet::sensors
#endif
