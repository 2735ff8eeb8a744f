#include "sensors/lidar.hpp"

#include <algorithm>

#include "base/pose_access.hpp"
#include "compiled/compiled_world.hpp"

namespace flockstep::sensors {
namespace {

bool same_beams(const LidarConfig& a, const LidarConfig& b) {
  return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.quat_wxyz == b.quat_wxyz;
}

}  // namespace

Lidar::Lidar(const LidarConfig& config, int num_drones)
    : rays_(static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns())),
      settings_{{config, make_pattern(config), static_cast<std::size_t>(num_drones)}},
      setting_(static_cast<std::size_t>(num_drones), 0U),
      max_range_(static_cast<std::size_t>(num_drones), config.max_range_m),
      offset_(static_cast<std::size_t>(num_drones), Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2])) {}

LidarConfig Lidar::config_of(std::size_t drone) const {
  LidarConfig config = settings_[setting_[drone]].config;
  config.max_range_m = max_range_[drone];
  for (int axis = 0; axis < 3; ++axis) config.offset_m[static_cast<std::size_t>(axis)] = offset_[drone][axis];
  return config;
}

void Lidar::set_config(std::size_t drone, const LidarConfig& config) {
  --settings_[setting_[drone]].drones;
  const auto find = [&](const auto& wanted) { return std::find_if(settings_.begin(), settings_.end(), wanted); };
  auto setting = find([&](const Setting& other) { return same_beams(other.config, config); });
  if (setting == settings_.end()) {
    setting = find([](const Setting& other) { return other.drones == 0; });
    if (setting == settings_.end()) setting = settings_.insert(setting, Setting{});
    *setting = {config, make_pattern(config), 0};
  }
  ++setting->drones;
  setting_[drone] = static_cast<std::uint32_t>(setting - settings_.begin());
  max_range_[drone] = config.max_range_m;
  offset_[drone] = Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2]);
}

void Lidar::scan(std::span<const std::uint32_t> drones, std::span<const World* const> worlds, State& state,
                 trace::Tracer& tracer) const {
  const World* world = nullptr;
  const trace::Scene* scene = nullptr;
  for (const std::uint32_t drone : drones) {
    const World* const its_world = worlds[static_cast<std::size_t>(state.world_index[drone])];
    if (its_world != world) {
      world = its_world;
      scene = &compiled(*world).scene();
    }
    scan(*scene, pose_of(state, drone), drone, state.lidar_ranges.data() + drone * rays_, tracer);
  }
  tracer.finish();
}

void Lidar::scan(const trace::Scene& scene, const Pose& pose, std::uint32_t drone, float* ranges, trace::Tracer& tracer) const {
  const BeamPattern& pattern = pattern_of(drone);
  const Mat3 rotation = pose.rotation.toRotationMatrix();
  tracer.settle(
      scene,
      {.origin = pose.position + trace::rotated(rotation, offset_[drone]), .rotation = rotation, .range = max_range_[drone]});
  for (const BeamTile& tile : pattern.tiles) {
    tracer.trace_later({.x = pattern.x.data() + tile.first,
                        .y = pattern.y.data() + tile.first,
                        .z = pattern.z.data() + tile.first,
                        .rows = tile.rows,
                        .width = tile.width,
                        .frustum = &tile.frustum},
                       ranges + tile.channel * pattern.columns + tile.beam, pattern.columns);
  }
}

}  // namespace flockstep::sensors
