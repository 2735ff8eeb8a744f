#include "sensors/lidar.hpp"

#include <algorithm>
#include <limits>

#include "base/pose_access.hpp"
#include "compiled/compiled_world.hpp"

namespace flockstep::sensors {
namespace {

bool same_beams(const LidarConfig& a, const LidarConfig& b) {
  return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.quat_wxyz == b.quat_wxyz;
}

// Traces what waits and hands out the results.
template <class Trace>
void finish(WaitingRays& waiting, const Trace& trace) {
  if (waiting.rays.count == 0) return;
  trace(waiting.rays);
  const float* t = waiting.rays.t_hit;
  for (std::size_t i = 0; i < waiting.num_runs; ++i) {
    std::copy_n(t, waiting.runs[i].count, waiting.runs[i].ranges);
    t += waiting.runs[i].count;
  }
  waiting.rays.count = waiting.num_runs = 0;
}

void finish(const trace::Scene& scene, ScanScratch& scratch) {
  finish(scratch.crowd, [&](trace::RayBlock& block) { scene.intersect(block); });
  finish(scratch.meshes, [&](trace::RayBlock& block) { scene.intersect_meshes(block); });
}

// Lets a tile's rays join those that wait, with what they have hit so far.
template <class Trace>
void wait(const trace::RayBundle& bundle, const BeamTile& tile, float* out, std::size_t columns, WaitingRays& waiting,
          const Trace& trace) {
  for (std::size_t row = 0; row < tile.rows; ++row) {
    for (std::size_t beam = 0; beam < tile.width;) {
      const std::size_t count = std::min(trace::kMaxRays - waiting.rays.count, tile.width - beam);
      append(bundle, row * tile.width + beam, count, waiting.rays);
      waiting.runs[waiting.num_runs++] = {out + row * columns + beam, count};
      if (waiting.rays.count == trace::kMaxRays) finish(waiting, trace);
      beam += count;
    }
  }
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
                 ScanScratch& scratch) const {
  const World* world = nullptr;
  const trace::Scene* scene = nullptr;
  for (const std::uint32_t drone : drones) {
    const World* const its_world = worlds[static_cast<std::size_t>(state.world_index[drone])];
    if (its_world != world) {
      if (scene != nullptr) finish(*scene, scratch);
      world = its_world;
      scene = &compiled(*world).scene();
    }
    scan(*scene, pose_of(state, drone), drone, state.lidar_ranges.data() + drone * rays_, scratch);
  }
  if (scene != nullptr) finish(*scene, scratch);
}

void Lidar::scan(const trace::Scene& scene, const Pose& pose, std::uint32_t drone, float* ranges, ScanScratch& scratch) const {
  const BeamPattern& pattern = pattern_of(drone);
  trace::RayBundle& rays = scratch.bundle;
  rays.rotation = pose.rotation.toRotationMatrix();
  rays.origin = pose.position + trace::rotated(rays.rotation, offset_[drone]);
  rays.range = max_range_[drone];
  scene.gather(rays.origin, rays.range, scratch.candidates);
  for (const BeamTile& tile : pattern.tiles) {
    rays.x = pattern.x.data() + tile.first;
    rays.y = pattern.y.data() + tile.first;
    rays.z = pattern.z.data() + tile.first;
    rays.count = tile.rows * tile.width;
    rays.frustum = &tile.frustum;
    float* const out = ranges + tile.channel * pattern.columns + tile.beam;
    switch (scene.intersect(scratch.candidates, rays)) {
      case trace::Traced::fully:
        for (std::size_t row = 0; row < tile.rows; ++row) {
          std::copy_n(rays.t_hit + row * tile.width, tile.width, out + row * pattern.columns);
        }
        break;
      case trace::Traced::primitives_only:
        wait(rays, tile, out, pattern.columns, scratch.meshes, [&](trace::RayBlock& block) { scene.intersect_meshes(block); });
        break;
      case trace::Traced::nothing:
        std::fill_n(rays.t_hit, rays.count, std::numeric_limits<float>::infinity());
        std::fill_n(rays.element, rays.count, -1);
        wait(rays, tile, out, pattern.columns, scratch.crowd, [&](trace::RayBlock& block) { scene.intersect(block); });
    }
  }
}

}  // namespace flockstep::sensors
