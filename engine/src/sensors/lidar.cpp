#include "sensors/lidar.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/require.hpp"
#include "sensors/rate.hpp"

namespace flockstep::sensors {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

bool same_beams(const LidarConfig& a, const LidarConfig& b) {
  return a.hfov_deg == b.hfov_deg && a.vfov_deg == b.vfov_deg && a.quat_wxyz == b.quat_wxyz;
}

}  // namespace

Lidar::Lidar(const LidarConfig& config, const ClockConfig& clock, std::size_t num_drones, TracerKind tracer)
    : config_(config),
      ways_(trace::ways_of(tracer, static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns()))),
      period_(period_in_ticks(config.rate_hz, clock, "lidar.rate_hz")),
      rays_(static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns())),
      ranges_(num_drones * rays_, kInfinity),
      settings_{{config, make_pattern(config, ways_.most_in_tiles > 0), num_drones}},
      setting_(num_drones, 0U),
      max_range_(num_drones, config.max_range_m),
      offset_(num_drones, Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2])) {}

LidarConfig Lidar::config_of(DroneIndex drone) const {
  LidarConfig config = settings_[setting_[drone]].config;
  config.max_range_m = max_range_[drone];
  for (int axis = 0; axis < 3; ++axis) config.offset_m[static_cast<std::size_t>(axis)] = offset_[drone][axis];
  return config;
}

void Lidar::set_config(DroneIndex drone, const LidarConfig& config) {
  const auto find = [&](const auto& wanted) { return std::find_if(settings_.begin(), settings_.end(), wanted); };
  auto setting = find([&](const Setting& other) { return same_beams(other.config, config); });
  if (setting == settings_.end()) {
    Setting made{config, make_pattern(config, ways_.most_in_tiles > 0), 0};
    setting = find([](const Setting& other) { return other.drones == 0; });
    if (setting == settings_.end()) setting = settings_.insert(setting, Setting{});
    *setting = std::move(made);
  }
  ++setting->drones;
  --settings_[setting_[drone]].drones;
  setting_[drone] = static_cast<std::uint32_t>(setting - settings_.begin());
  max_range_[drone] = config.max_range_m;
  offset_[drone] = Vec3(config.offset_m[0], config.offset_m[1], config.offset_m[2]);
}

void Lidar::change(const LidarChange& change, std::span<const DroneIndex> drones) {
  const bool beams_move = change.hfov_deg || change.vfov_deg;
  require(!(beams_move && config_.has_pattern()), change.hfov_deg ? "hfov_deg" : "vfov_deg",
          "no field of view for a LiDAR made from a beam pattern", change.hfov_deg.value_or(change.vfov_deg.value_or(0.0F)));
  const auto changed = [&](LidarConfig config) {
    config.max_range_m = change.max_range_m.value_or(config.max_range_m);
    config.hfov_deg = change.hfov_deg.value_or(config.hfov_deg);
    config.vfov_deg = change.vfov_deg.value_or(config.vfov_deg);
    config.offset_m = change.offset_m.value_or(config.offset_m);
    config.quat_wxyz = change.quat_wxyz.value_or(config.quat_wxyz);
    return config;
  };
  // Each field is valid or not by itself, whatever a drone's others are; so this refuses even where no drone is listed.
  changed(config_).validate();
  for (const DroneIndex drone : drones) set_config(drone, changed(config_of(drone)));
}

void Lidar::clear(DroneIndex drone) {
  std::fill_n(ranges_.begin() + static_cast<std::ptrdiff_t>(drone * rays_), rays_, kInfinity);
}

void Lidar::write_directions(std::span<float> out) const {
  for (std::size_t i = 0; i < setting_.size(); ++i) {
    const DroneIndex drone(i);
    sensors::write_directions(pattern_of(drone), out.data() + 3 * drone * rays_);
  }
}

void Lidar::write_points(const State& state, std::span<float> out) const {
  write_directions(out);
  for (std::size_t i = 0; i < setting_.size(); ++i) {
    const DroneIndex drone(i);
    const Pose pose = pose_of(state, drone);
    const Vec3 origin = pose.position + pose.rotation * offset_[drone];
    for (std::size_t ray = 0; ray < rays_; ++ray) {
      float* const row = out.data() + 3 * (drone * rays_ + ray);
      const float range = ranges_[drone * rays_ + ray];
      const Vec3 point = std::isfinite(range) ? Vec3(origin + range * (pose.rotation * Vec3(row[0], row[1], row[2])))
                                              : Vec3::Constant(kInfinity);
      for (int axis = 0; axis < 3; ++axis) row[axis] = point[axis];
    }
  }
}

void Lidar::visit(ArrayVisitor& visitor) {
  saved_.clear();
  for (std::size_t i = 0; i < setting_.size(); ++i) {
    const DroneIndex drone(i);
    const LidarConfig config = config_of(drone);
    saved_.push_back({config.hfov_deg, config.vfov_deg, config.max_range_m, config.offset_m, config.quat_wxyz});
  }
  visitor.array("lidar_ranges", ranges_);
  visitor.array("lidar_settings", saved_);
}

LidarConfig Lidar::with(const Saved& saved) const {
  LidarConfig config = config_;
  config.hfov_deg = saved.hfov_deg;
  config.vfov_deg = saved.vfov_deg;
  config.max_range_m = saved.max_range_m;
  config.offset_m = saved.offset_m;
  config.quat_wxyz = saved.quat_wxyz;
  return config;
}

void Lidar::check_restored(std::span<const std::byte> settings) const {
  for (std::size_t at = 0; at < settings.size(); at += sizeof(Saved)) {
    Saved saved;
    std::memcpy(&saved, settings.data() + at, sizeof(saved));
    with(saved).validate();
  }
}

void Lidar::restored() {
  for (std::size_t i = 0; i < saved_.size(); ++i) set_config(DroneIndex(i), with(saved_[i]));
  saved_ = {};
  has_scanned_ = true;
}

void Lidar::scan(std::span<const DroneIndex> drones, std::span<const trace::Scene* const> scenes,
                 std::span<const std::int32_t> slots, std::size_t drones_per_env, const State& state, trace::Tracer& tracer) {
  if (!drones.empty() && !has_scanned()) has_scanned_.store(true, std::memory_order_relaxed);
  const auto scene_of = [&](DroneIndex drone) {
    const std::size_t env = drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
    return scenes[static_cast<std::size_t>(slots[env])];
  };
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const DroneIndex drone = drones[i];
    const trace::Scene& scene = *scene_of(drone);
    if (i + 2 < drones.size() && scene_of(drones[i + 2]) != &scene) scene_of(drones[i + 2])->prefetch_parts();
    scan(scene, pose_of(state, drone), drone, ranges_.data() + drone * rays_, tracer);
  }
  tracer.finish();
}

void Lidar::scan(const trace::Scene& scene, const Pose& pose, DroneIndex drone, float* ranges, trace::Tracer& tracer) const {
  const BeamPattern& pattern = pattern_of(drone);
  const Mat3 rotation = pose.rotation.toRotationMatrix();
  tracer.settle(scene, {.origin = pose.position + trace::rotated(rotation, offset_[drone]),
                        .rotation = rotation,
                        .range = max_range_[drone],
                        .ways = ways_});
  for (const BeamTile& tile : pattern.tiles) {
    tracer.trace_later({.x = pattern.x.data() + tile.first,
                        .y = pattern.y.data() + tile.first,
                        .z = pattern.z.data() + tile.first,
                        .rows = tile.rows,
                        .width = tile.width,
                        .frustum = &tile.frustum,
                        .view = tile.view < 0 ? nullptr : &pattern.views[static_cast<std::size_t>(tile.view)]},
                       ranges + tile.channel * pattern.columns + tile.beam, pattern.columns);
  }
}

}  // namespace flockstep::sensors
