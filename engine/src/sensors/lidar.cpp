#include "sensors/lidar.hpp"

#include <algorithm>

#include "motion/pose_access.hpp"
#include "trace/scene.hpp"

namespace swiftlet::sensors {
namespace {

bool same_beams(const LidarConfig& a, const LidarConfig& b) {
  return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.quat_wxyz == b.quat_wxyz;
}

}  // namespace

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
  trace::RayBlock& rays = scratch.rays;
  std::size_t runs = 0;
  const World* world = nullptr;

  const auto flush = [&] {
    if (rays.count == 0) return;
    world->scene().intersect(rays);
    const float* t = rays.t_hit;
    for (std::size_t i = 0; i < runs; ++i) {
      std::copy_n(t, scratch.runs[i].count, scratch.runs[i].ranges);
      t += scratch.runs[i].count;
    }
    rays.count = runs = 0;
  };

  for (const std::uint32_t drone : drones) {
    const World* const its_world = worlds[static_cast<std::size_t>(state.world_index[drone])];
    const BeamPattern& pattern = pattern_of(drone);
    if (its_world != world) flush();
    world = its_world;

    const Pose pose = pose_of(state, drone);
    const Mat3 rotation = pose.rotation.toRotationMatrix();
    const Vec3 origin = pose.position + rotation * offset_[drone];
    float* const ranges = state.lidar_ranges.data() + drone * rays_;
    if (rays_ <= trace::RayBlock::kRays) {
      scratch.own.count = 0;
      append_rays(pattern, 0, rays_, rotation, origin, max_range_[drone], scratch.own);
      if (world->scene().intersect_nearby(origin, max_range_[drone], scratch.own)) {
        std::copy_n(scratch.own.t_hit, rays_, ranges);
        continue;
      }
    }
    for (std::size_t first = 0; first < rays_;) {
      const std::size_t count = std::min(trace::RayBlock::kRays - rays.count, rays_ - first);
      append_rays(pattern, first, count, rotation, origin, max_range_[drone], rays);
      scratch.runs[runs++] = {ranges + first, count};
      if (rays.count == trace::RayBlock::kRays) flush();
      first += count;
    }
  }
  flush();
}

}  // namespace swiftlet::sensors
