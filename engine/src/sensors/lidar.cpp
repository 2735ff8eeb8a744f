#include "sensors/lidar.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "motion/pose_access.hpp"
#include "trace/scene.hpp"

namespace swiftlet::sensors {
namespace {

// Beams closer than this are traced as coherent packets. Calibrated by `./dev bench lidar`, which tries both.
constexpr double kCoherentSpacingDeg = 2.0;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// Evenly spaced over [-fov/2, fov/2]; the end is left out where it would be the beginning again.
double spread_deg(int index, int count, double fov_deg) {
  if (count == 1) return 0.0;
  const int intervals = fov_deg >= 360.0 ? count : count - 1;
  return fov_deg * (static_cast<double>(index) / intervals - 0.5);
}

bool same_beams(const LidarConfig& a, const LidarConfig& b) {
  return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.quat_wxyz == b.quat_wxyz;
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
    if (config.beams > 1 && config.hfov_deg / static_cast<float>(config.beams - 1) < kCoherentSpacingDeg) {
      pattern.coherence = trace::Coherence::coherent;
    }
  }
  return pattern;
}

ScanScratch::ScanScratch() : packets{}, runs{} {
  for (trace::RayPacket& packet : packets) std::fill_n(packet.ray.mask, trace::kPacketSize, 0xFFFFFFFFU);
}

Lidar::Lidar(const LidarConfig& config, int num_drones)
    : rays_(static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns())),
      configs_{config},
      patterns_{make_pattern(config)},
      setting_(static_cast<std::size_t>(num_drones), 0U),
      max_range_(static_cast<std::size_t>(num_drones), config.max_range_m),
      offset_(static_cast<std::size_t>(num_drones), Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2])) {}

LidarConfig Lidar::config_of(std::size_t drone) const {
  LidarConfig config = configs_[setting_[drone]];
  config.max_range_m = max_range_[drone];
  for (int axis = 0; axis < 3; ++axis) config.offset_m[static_cast<std::size_t>(axis)] = offset_[drone][axis];
  return config;
}

void Lidar::set_config(std::size_t drone, const LidarConfig& config) {
  const auto known = std::find_if(configs_.begin(), configs_.end(), [&](const auto& other) { return same_beams(other, config); });
  setting_[drone] = static_cast<std::uint32_t>(known - configs_.begin());
  if (known == configs_.end()) {
    configs_.push_back(config);
    patterns_.push_back(make_pattern(config));
  }
  max_range_[drone] = config.max_range_m;
  offset_[drone] = Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2]);
}

void Lidar::scan(std::span<const std::uint32_t> drones, std::span<const World* const> worlds, State& state,
                 ScanScratch& scratch) const {
  constexpr std::size_t kLanes = trace::kPacketSize;
  std::size_t rays = 0;  // waiting in the packets
  std::size_t runs = 0;
  const World* world = nullptr;
  trace::Coherence coherence = trace::Coherence::incoherent;

  const auto flush = [&] {
    if (rays == 0) return;
    const std::size_t packets = (rays + kLanes - 1) / kLanes;
    for (std::size_t lane = rays % kLanes; lane != 0 && lane < kLanes; ++lane) {
      scratch.packets[packets - 1].ray.tfar[lane] = -1.0F;
    }
    world->scene().intersect({scratch.packets.data(), packets}, coherence);
    std::size_t ray = 0;
    for (std::size_t i = 0; i < runs; ++i) {
      for (std::size_t k = 0; k < scratch.runs[i].count; ++k, ++ray) {
        const trace::RayPacket& packet = scratch.packets[ray / kLanes];
        const std::size_t lane = ray % kLanes;
        const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
        scratch.runs[i].ranges[k] = hit ? packet.ray.tfar[lane] : std::numeric_limits<float>::infinity();
      }
    }
    rays = runs = 0;
  };

  for (const std::uint32_t drone : drones) {
    const World* const its_world = worlds[static_cast<std::size_t>(state.world_index[drone])];
    const BeamPattern& pattern = pattern_of(drone);
    if (its_world != world || pattern.coherence != coherence) flush();
    world = its_world;
    coherence = pattern.coherence;

    const float max_range = max_range_[drone];
    const Pose pose = pose_of(state, drone);
    const Mat3 r = pose.rotation.toRotationMatrix();
    const Vec3 origin = pose.position + r * offset_[drone];
    float* const ranges = state.lidar_ranges.data() + drone * rays_;
    for (std::size_t beam = 0; beam < rays_;) {
      if (rays == ScanScratch::kRays) flush();
      const std::size_t lane = rays % kLanes;
      const std::size_t count = std::min(kLanes - lane, rays_ - beam);
      trace::RayPacket& packet = scratch.packets[rays / kLanes];
      const auto fill = [&](std::size_t n) {
        const float* const x = pattern.x.data() + beam;
        const float* const y = pattern.y.data() + beam;
        const float* const z = pattern.z.data() + beam;
        for (std::size_t i = 0; i < n; ++i) {
          packet.ray.dir_x[lane + i] = r(0, 0) * x[i] + r(0, 1) * y[i] + r(0, 2) * z[i];
          packet.ray.dir_y[lane + i] = r(1, 0) * x[i] + r(1, 1) * y[i] + r(1, 2) * z[i];
          packet.ray.dir_z[lane + i] = r(2, 0) * x[i] + r(2, 1) * y[i] + r(2, 2) * z[i];
          packet.ray.org_x[lane + i] = origin.x();
          packet.ray.org_y[lane + i] = origin.y();
          packet.ray.org_z[lane + i] = origin.z();
          packet.ray.tfar[lane + i] = max_range;
          packet.hit.geomID[lane + i] = RTC_INVALID_GEOMETRY_ID;
        }
      };
      if (count == kLanes) {
        fill(kLanes);  // a constant count: the compiler makes whole vectors of it
      } else {
        fill(count);
      }
      if (runs > 0 && scratch.runs[runs - 1].ranges + scratch.runs[runs - 1].count == ranges + beam) {
        scratch.runs[runs - 1].count += count;
      } else {
        scratch.runs[runs++] = {ranges + beam, count};
      }
      rays += count;
      beam += count;
    }
  }
  flush();
}

}  // namespace swiftlet::sensors
